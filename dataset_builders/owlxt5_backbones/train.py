# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-backbones`: make the small eyes or the small tongue from nothing but this package."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import draccus
import torch
from transformers import (
    AutoTokenizer,
    Owlv2ForObjectDetection,
    PreTrainedModel,
    T5ForConditionalGeneration,
    Trainer,
    TrainingArguments,
)
from transformers.trainer_utils import get_last_checkpoint

from builder_tools.workers import usable_cores
from lerobot_owlxt5.backbones.small_t5 import SmallT5Config

from .card import commands, write_eyes_card, write_tongue_card
from .eyes import EyesSizes, load_eyes, make_eyes
from .eyes_batches import Collator
from .eyes_training import EyesTrainer, find_threshold
from .pictures import make_pictures
from .tongue import Lessons, Tokens, make_tongue, shipped_sizes

_OTHER_PICTURES = 480
# Patches to look at, of 256.
_PATCHES = 96


class Recipe(NamedTuple):
    """What the shipped weights of a part were trained with."""

    steps: int
    batch_size: int
    learning_rate: float


RECIPES = {"eyes": Recipe(5000, 48, 2e-3), "tongue": Recipe(8000, 64, 1.5e-3)}


@dataclass
class BackbonesConfig:
    """Train a small OWLv2 on rendered scenes, or a small T5 on sentences of a grammar."""

    # `eyes` or `tongue`.
    part: str
    # Folder for training data, checkpoints and, in `model`, the result.
    output_dir: Path
    # Steps of training; by default, here and below, those of the weights in this package.
    steps: int | None = None
    # Pictures, or sentences, in a step.
    batch_size: int | None = None
    # Highest learning rate of the tongue's AdamW or the eyes' Muon; it warms up and then falls with a cosine.
    learning_rate: float | None = None
    # Pictures to render for the eyes; each is seen several times, never with the same questions.
    pictures: int = 30_000
    # Seed of data and weights.
    seed: int = 0
    # Folder of eyes whose training to go on with: their weights, the pictures and steps of this command.
    start_from: Path | None = None

    @property
    def recipe(self) -> Recipe:
        """The options given, completed."""
        usual = RECIPES[self.part]
        return Recipe(
            self.steps or usual.steps,
            self.batch_size or usual.batch_size,
            self.learning_rate or usual.learning_rate,
        )

    @property
    def model_dir(self) -> Path:
        """Folder of the result."""
        return self.output_dir / "model"

    @property
    def command(self) -> str:
        """What makes the same again, in folders of the reader's choice."""
        before = "" if self.start_from is None else f"{commands(self.start_from)}\n"
        options = {"part": self.part, **self.recipe._asdict(), "seed": self.seed, "output_dir": "…"}
        if self.part == "eyes":
            options["pictures"] = self.pictures
        if self.start_from is not None:
            options["start_from"] = "…"
        return before + " ".join(
            ["owlxt5-backbones", *(f"--{key}={value}" for key, value in options.items())]
        )


def _arguments(config: BackbonesConfig) -> TrainingArguments:
    recipe = config.recipe
    return TrainingArguments(
        output_dir=str(config.output_dir / "checkpoints"),
        max_steps=recipe.steps,
        per_device_train_batch_size=recipe.batch_size,
        learning_rate=recipe.learning_rate,
        weight_decay=0.02,
        adam_beta2=0.98,
        warmup_steps=min(500, recipe.steps // 20),
        lr_scheduler_type="cosine",
        bf16=True,
        use_cpu=not torch.cuda.is_available(),
        save_steps=500,
        save_total_limit=1,
        logging_steps=max(1, min(50, recipe.steps // 20)),
        seed=config.seed,
        dataloader_num_workers=1,
        remove_unused_columns=False,
        label_names=[],
        report_to="none",
    )


def _train(trainer: Trainer) -> list[float]:
    """Train, from the last checkpoint on if there is one; the losses that were logged."""
    folder = Path(str(trainer.args.output_dir))
    trainer.train(resume_from_checkpoint=get_last_checkpoint(str(folder)) if folder.exists() else None)
    return [entry["loss"] for entry in trainer.state.log_history if "loss" in entry]


def train_eyes(config: BackbonesConfig, sizes: EyesSizes) -> tuple[Owlv2ForObjectDetection, list[float]]:
    """Render pictures and train on them; the eyes and the course of their loss."""
    workers = usable_cores()
    pictures = make_pictures(config.output_dir / "pictures", config.pictures, config.seed, workers)
    others = make_pictures(config.output_dir / "other_pictures", _OTHER_PICTURES, config.seed + 1, workers)
    start = config.start_from
    model, processor = load_eyes(start) if start else make_eyes(sizes, config.seed)
    collate = Collator(processor, model.num_patches_width, _PATCHES)
    trainer = EyesTrainer(model, _arguments(config), data_collator=collate, train_dataset=pictures)
    losses = _train(trainer)
    model.eval()
    model.config.score_threshold = find_threshold(model, processor, others, config.seed)
    processor.save_pretrained(config.model_dir)
    model.half().save_pretrained(config.model_dir)
    return model, losses


def train_tongue(
    config: BackbonesConfig, sizes: SmallT5Config
) -> tuple[T5ForConditionalGeneration, list[float]]:
    """Train on sentences; the tongue and the course of its loss."""
    model = make_tongue(sizes)
    tokenizer = AutoTokenizer.from_pretrained(sizes.output_dir)
    losses = _train(Trainer(model, _arguments(config), Tokens(tokenizer), train_dataset=Lessons(config.seed)))
    model.half().save_pretrained(config.model_dir)
    return model, losses


@draccus.wrap()
def main(config: BackbonesConfig) -> None:
    """Make the data, train, examine, and say where the result is."""
    if config.part not in RECIPES:
        sys.exit(f"owlxt5-backbones: --part is one of {', '.join(RECIPES)}, not {config.part!r}")
    if config.start_from is not None and config.part != "eyes":
        sys.exit("owlxt5-backbones: --start_from is for --part=eyes")
    # Reads the card of the eyes to start from: better missing now than after hours.
    command = config.command
    model: PreTrainedModel
    if config.part == "eyes":
        model, _ = train_eyes(config, EyesSizes())
    else:
        model, _ = train_tongue(config, shipped_sizes(config.model_dir, config.seed))
    facts = {"command": command, "size": f"{model.num_parameters():,}"}
    if config.part == "eyes":
        table = write_eyes_card(config.model_dir, config.seed, **facts)
    else:
        table = write_tongue_card(
            config.model_dir, config.seed, config.recipe.steps * config.recipe.batch_size, **facts
        )
    policy_option = "detector" if config.part == "eyes" else "language_model"
    print(f"{table}\n\nThe {config.part}: {config.model_dir}")
    print(f"Next: lerobot-train --policy.type=owlxt5 --policy.{policy_option}={config.model_dir} …")


if __name__ == "__main__":
    main()
