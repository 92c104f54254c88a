# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-backbones`: make the small detector or the small language model from nothing but this package."""

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import torch
from transformers import AutoTokenizer, PreTrainedModel, Trainer, TrainingArguments
from transformers.trainer_utils import get_last_checkpoint

from builder_tools.recipe import RECIPE, differences, read_recipe, write_recipe
from builder_tools.workers import usable_cores
from lerobot_owlxt5.backbones.small_t5 import SmallT5Config
from lerobot_owlxt5.command_line import check_numbers, command
from nico_tabletop.drawing import DrawingError

from .card import commands, write_detector_card, write_language_model_card
from .detector import DetectorSizes, load_detector_model, make_detector_model
from .detector_batches import Collator
from .detector_training import DetectorTrainer, find_threshold
from .evaluate_language_model import TRAINED
from .images import make_images
from .language_model import (
    ExampleCollator,
    Examples,
    load_language_model,
    make_language_model,
    shipped_sizes,
)
from .muon import check_optimizer, muon_options
from .understanding_caution import find_understanding_threshold, find_wish_words

_VALIDATION_IMAGES = 480
# Patches to look at, of 256.
_PATCHES = 96


class Recipe(NamedTuple):
    """What the shipped weights of a part were trained with."""

    steps: int
    batch_size: int
    learning_rate: float


RECIPES = {
    "detector": Recipe(5000, 48, 2e-3),
    "language_model": Recipe(8000, 64, 1.5e-3),
    "understanding": Recipe(8000, 64, 1.5e-3),
}


@dataclass
class BackbonesConfig:
    """Train a small OWLv2 on rendered scenes, or a small T5 on sentences of a grammar or on lessons."""

    # `detector`, `language_model` or `understanding`.
    part: str
    # Folder for training data, checkpoints and, in `model`, the result.
    output_dir: Path
    # Steps of training; by default, here and below, those of the weights in this package.
    steps: int | None = None
    # Images, or sentences, in a step.
    batch_size: int | None = None
    # Highest learning rate, of Muon; it warms up and then falls with a cosine.
    learning_rate: float | None = None
    # Images to render for the detector; each is seen several times, never with the same queries.
    images: int = 30_000
    # Seed of data and weights.
    seed: int = 0
    # Folder (or, for a T5, Hub id) of a model whose training to go on with: its weights, the data and steps
    # of this command.
    start_from: Path | None = None
    # Layers of the encoder of the T5 in start_from, if it is to have more than there.
    layers: int | None = None

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
    def settings(self) -> dict[str, Any]:
        """What tells this command from others, as JSON has it."""
        return {
            "part": self.part,
            **self.recipe._asdict(),
            "images": self.images,
            "seed": self.seed,
            "start_from": None if self.start_from is None else str(self.start_from),
            "layers": self.layers,
        }

    @property
    def model_dir(self) -> Path:
        """Folder of the result."""
        return self.output_dir / "model"

    @property
    def command(self) -> str:
        """What makes the same again, in folders of the reader's choice."""
        before = "" if self.start_from is None else commands(self.start_from)
        options = {"part": self.part, **self.recipe._asdict(), "seed": self.seed, "output_dir": "…"}
        if self.part == "detector":
            options["images"] = self.images
        if self.start_from is not None:
            options["start_from"] = "…"
        if self.layers is not None:
            options["layers"] = self.layers
        return before + " ".join(
            ["owlxt5-backbones", *(f"--{key}={value}" for key, value in options.items())]
        )


def _has_bf16() -> bool:
    """Whether bf16 is faster here: processors without it emulate it, eight times slower than float32."""
    processor = torch.cpu.get_capabilities()
    return torch.cuda.is_available() or any(processor.get(name) for name in ("avx512_bf16", "amx_bf16"))


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
        bf16=_has_bf16(),
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


def _last_checkpoint(arguments: TrainingArguments) -> str | None:
    folder = str(arguments.output_dir)
    return get_last_checkpoint(folder) if Path(folder).exists() else None


def _train(trainer: Trainer) -> list[float]:
    """Train, from the last checkpoint on if there is one; the losses that were logged."""
    trainer.train(resume_from_checkpoint=_last_checkpoint(trainer.args))
    return [entry["loss"] for entry in trainer.state.log_history if "loss" in entry]


def keep_to_recipe(config: BackbonesConfig) -> None:
    """Write down what is made in the output folder, or compare with what was begun there.

    Of a command that came no farther than its images, only these have to be the same.

    Raises:
        ValueError: If another command's checkpoints or images are there.
    """
    folder, recipe = config.output_dir, config.settings
    trained = any((folder / "checkpoints").glob("checkpoint-*"))
    rendered = any((folder / "images").glob("*.parquet"))
    begun = read_recipe(folder)
    if begun is None and trained:
        raise ValueError(
            f"{folder} has checkpoints and no {RECIPE}, which tells of what: choose another --output_dir"
        )
    kept = [*recipe] if trained else ["images", "seed"] if rendered else []
    if begun and (differing := differences(begun, recipe, kept)):
        raise ValueError(
            f"{folder} holds what another command began: {differing}; give the same command to go on, or "
            "choose another --output_dir"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_recipe(folder, recipe)


def train_detector(config: BackbonesConfig, sizes: DetectorSizes) -> tuple[PreTrainedModel, list[float]]:
    """Render images and train on them; the detector and the course of its loss."""
    folder, workers = config.output_dir, usable_cores()
    images = make_images(folder / "images", config.images, config.seed, workers)
    validation = make_images(folder / "validation_images", _VALIDATION_IMAGES, config.seed + 1, workers)
    start = config.start_from
    model, processor = load_detector_model(start) if start else make_detector_model(sizes, config.seed)
    collate = Collator(processor, model.num_patches_width, _PATCHES)
    arguments = _arguments(config)
    trainer = DetectorTrainer(
        model,
        arguments,
        data_collator=collate,
        train_dataset=images,
        optimizer_cls_and_kwargs=muon_options(model, arguments),
    )
    losses = _train(trainer)
    model.eval()
    model.config.score_threshold = find_threshold(model, processor, validation, config.seed)
    processor.save_pretrained(config.model_dir)
    model.half().save_pretrained(config.model_dir)
    return model, losses


def train_language_model(
    config: BackbonesConfig, sizes: SmallT5Config
) -> tuple[PreTrainedModel, list[float]]:
    """Train on sentences, or on lessons in understanding; the T5 and the course of its loss."""
    recipe, kinds = config.recipe, TRAINED[config.part]
    start = config.start_from
    model = (
        load_language_model(str(start), config.model_dir, config.layers)
        if start
        else make_language_model(sizes)
    )
    arguments = _arguments(config)
    # A resumed run begins with the next example, rather than draw and drop all before.
    arguments.ignore_data_skip = True
    last = _last_checkpoint(arguments)
    used = int(last.rpartition("-")[2]) * recipe.batch_size if last else 0
    collate = ExampleCollator(AutoTokenizer.from_pretrained(config.model_dir))
    examples = Examples(kinds, config.seed, recipe.batch_size, used)
    optimizer = muon_options(model, arguments)
    losses = _train(
        Trainer(model, arguments, collate, train_dataset=examples, optimizer_cls_and_kwargs=optimizer)
    )
    model.half().save_pretrained(config.model_dir)
    if config.part == "understanding":
        threshold = find_understanding_threshold(str(config.model_dir), config.seed)
        model.config.update(
            {"understanding_threshold": threshold, "wish_words": find_wish_words(config.seed)}
        )
        model.config.save_pretrained(config.model_dir)
    return model, losses


@command("owlxt5-backbones", DrawingError, ModuleNotFoundError)
def main(config: BackbonesConfig) -> None:
    """Make the data, train, evaluate, and say where the result is."""
    check_optimizer()
    if config.part not in RECIPES:
        sys.exit(f"owlxt5-backbones: --part is one of {', '.join(RECIPES)}, not {config.part!r}")
    check_numbers(config, "steps", "batch_size", "images", "learning_rate", "layers")
    if config.layers is not None and config.start_from is None:
        sys.exit(
            "owlxt5-backbones: --layers deepens a model that goes on learning: name it with --start_from"
        )
    # Reads the card of the model to start from: better missing now than after hours.
    command = config.command
    keep_to_recipe(config)
    if config.part == "detector":
        model, _ = train_detector(config, DetectorSizes())
    else:
        model, _ = train_language_model(config, shipped_sizes(config.model_dir, config.seed))
    facts = {"command": command, "size": f"{model.num_parameters():,}"}
    if config.part == "detector":
        table = write_detector_card(config.model_dir, config.seed, **facts)
    else:
        table = write_language_model_card(
            config.model_dir,
            config.part,
            config.seed,
            config.recipe.steps * config.recipe.batch_size,
            went_on=config.start_from is not None,
            **facts,
        )
    print(f"{table}\n\nThe {config.part.replace('_', ' ')}: {config.model_dir}")
    option = shlex.quote(f"--policy.{config.part}={config.model_dir}")
    print(f"Next: lerobot-train --policy.type=owlxt5 {option} …")


if __name__ == "__main__":
    main()
