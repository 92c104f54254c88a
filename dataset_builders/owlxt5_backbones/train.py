# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-backbones`: make the small eyes or the small tongue from nothing but this package."""

import json
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

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

from clant_claeo.workers import usable_cores
from lerobot_owlxt5.backbones import SmallT5Config

from .eyes import Collator, EyesSizes, EyesTrainer, make_eyes
from .pictures import make_pictures
from .tongue import Lessons, Tokens, make_tongue, shipped_sizes

PARTS = ("eyes", "tongue")


@dataclass
class BackbonesConfig:
    """Train a small OWLv2 on rendered scenes, or a small T5 on sentences of a grammar."""

    # `eyes` or `tongue`.
    part: str
    # Folder for training data, checkpoints and, in `model`, the result.
    output_dir: Path
    # Steps of training.
    steps: int = 3_000
    # Pictures, or sentences, in a step.
    batch_size: int = 32
    # Pictures to render for the eyes; each is seen several times, never with the same questions.
    pictures: int = 30_000
    # Highest learning rate of AdamW; it warms up and then falls with a cosine.
    learning_rate: float = 8e-4
    # Seed of data and weights.
    seed: int = 0


def _arguments(config: BackbonesConfig) -> TrainingArguments:
    return TrainingArguments(
        output_dir=str(config.output_dir / "checkpoints"),
        max_steps=config.steps,
        per_device_train_batch_size=config.batch_size,
        learning_rate=config.learning_rate,
        weight_decay=0.02,
        warmup_steps=min(500, config.steps // 20),
        lr_scheduler_type="cosine",
        bf16=True,
        use_cpu=not torch.cuda.is_available(),
        save_steps=500,
        save_total_limit=1,
        logging_steps=max(1, min(50, config.steps // 20)),
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
    pictures = make_pictures(config.output_dir / "pictures", config.pictures, config.seed, usable_cores())
    model, processor = make_eyes(sizes, config.seed)
    losses = _train(EyesTrainer(model, _arguments(config), Collator(processor), train_dataset=pictures))
    processor.save_pretrained(config.output_dir / "model")
    return model, losses


def train_tongue(
    config: BackbonesConfig, sizes: SmallT5Config
) -> tuple[T5ForConditionalGeneration, list[float]]:
    """Train on sentences; the tongue and the course of its loss."""
    model = make_tongue(sizes)
    tokenizer = AutoTokenizer.from_pretrained(sizes.output_dir)
    losses = _train(Trainer(model, _arguments(config), Tokens(tokenizer), train_dataset=Lessons(config.seed)))
    return model, losses


@draccus.wrap()
def main(config: BackbonesConfig) -> None:
    """Make the data, train, and say where the result is."""
    if config.part not in PARTS:
        sys.exit(f"owlxt5-backbones: --part is one of {', '.join(PARTS)}, not {config.part!r}")
    began = time.perf_counter()
    folder = config.output_dir / "model"
    model: PreTrainedModel
    if config.part == "eyes":
        model, _ = train_eyes(config, EyesSizes())
    else:
        model, _ = train_tongue(config, shipped_sizes(folder, config.seed))
    model.half().save_pretrained(folder)
    facts = {key: str(value) if isinstance(value, Path) else value for key, value in asdict(config).items()}
    facts["minutes"] = round((time.perf_counter() - began) / 60, 1)
    (folder / "training.json").write_text(json.dumps(facts, indent=2), encoding="utf-8")
    print(f"The {config.part}: {folder}")


if __name__ == "__main__":
    main()
