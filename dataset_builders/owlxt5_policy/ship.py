# SPDX-License-Identifier: Apache-2.0
"""Puts a trained policy into the package: `python -m owlxt5_policy.ship CHECKPOINT [eval_info.json …]`.

The copy is small, its weights in half precision, and names nobody's machine. It is refused where it would
need the network, or where its movements come from the original release, which states no licence.
"""

import argparse
import json
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor

from lerobot_owlxt5.backbones.pretrained import EMBEDDED, find_backbone
from lerobot_owlxt5.trained import FOLDER

from .card import write_card

_WEIGHTS, _CONFIG, _TRAINING = "model.safetensors", "config.json", "train_config.json"
_PROCESSORS = ("policy_preprocessor.json", "policy_postprocessor.json")
_BUILD = Path("meta/build.json")  # `owlxt5-dataset` records there how a dataset was made
_DEVICE = "cpu"
# What a config.json has of the machine and the account that trained it, and what stands there instead.
_NOBODYS = {
    "device": _DEVICE,
    "push_to_hub": False,
    "repo_id": None,
    "private": None,
    "tags": None,
    "license": "apache-2.0",
    "pretrained_path": None,
    "pretrained_revision": None,
}


def ship(checkpoint: Path, eval_infos: Sequence[Path], folder: Path = FOLDER) -> None:
    """Copy a checkpoint, and write its card. What lay there before is replaced once all is written.

    Args:
        checkpoint: Folder `pretrained_model` of lerobot-train; the folder of its dataset must be there, too.
        eval_infos: Files eval_info.json of lerobot-eval, for the card.
        folder: Where to.

    Raises:
        OSError: If something cannot be read or written.
        ValueError: If it cannot be part of the package; one sentence says why.
    """
    config, training = _read(checkpoint / _CONFIG), _read(checkpoint / _TRAINING)
    _check_backbones(config)
    build = _read_build(Path(training["dataset"]["root"] or ""))
    weights = _half(load_file(checkpoint / _WEIGHTS))
    processors = {name: _read(checkpoint / name) for name in _PROCESSORS}
    folder.parent.mkdir(parents=True, exist_ok=True)
    with TemporaryDirectory(dir=folder.parent) as beside:
        draft = Path(beside) / folder.name
        draft.mkdir()
        save_file(weights, draft / _WEIGHTS, metadata={"format": "pt"})
        (draft / _WEIGHTS).chmod(0o644)  # safetensors leaves it to its owner alone
        _write(draft / _CONFIG, config | _NOBODYS)
        for name, processor in processors.items():
            for step in processor["steps"]:
                if step["registry_name"] == "device_processor":
                    step["config"]["device"] = _DEVICE
                if state := step.get("state_file"):
                    shutil.copyfile(checkpoint / state, draft / state)
            _write(draft / name, processor)
        write_card(draft, training, build["command"], eval_infos)
        shutil.rmtree(folder, ignore_errors=True)
        draft.rename(folder)


def _check_backbones(config: dict[str, Any]) -> None:
    """Whether the package has all that the policy needs, in the very version that it was trained with."""
    if config["type"] != "owlxt5":
        raise ValueError(f"The policy that ships is an owlxt5, and this checkpoint is of {config['type']}.")
    if config["train_language_model"]:
        raise ValueError("Its T5 was trained along: train with --policy.train_language_model=false.")
    for part in ("detector", "language_model", "understanding"):
        if config[part] != EMBEDDED:
            raise ValueError(f"It needs a {part} from elsewhere: train with --policy.{part}=embedded.")
        find_backbone(EMBEDDED, part, config[f"{part}_revision"])  # type: ignore[arg-type]


def _read_build(dataset: Path) -> dict[str, Any]:
    """How the dataset was made; refused if its movements are the original release's."""
    if not (dataset / _BUILD).is_file():
        raise ValueError(
            f"{dataset} has no {_BUILD}, which says how a dataset of owlxt5-dataset was made: ship from "
            "where the policy was trained."
        )
    build = _read(dataset / _BUILD)
    if build["release"]:
        raise ValueError(
            "The policy has learnt the original release's movements, which state no licence: train it on a "
            "dataset of owlxt5-dataset --source=scripted."
        )
    return build


def _half(weights: dict[str, Tensor]) -> dict[str, Tensor]:
    """The model's weights in half precision; LeRobot copies them into float32. What is no weight stays."""
    halved = {
        name: tensor.half() if name.startswith("model.") and tensor.is_floating_point() else tensor
        for name, tensor in weights.items()
    }
    for name, tensor in halved.items():
        if name.startswith("model.") and not torch.isfinite(tensor).all():
            raise ValueError(f"The weight {name} is not finite in half precision: the training has diverged.")
    return halved


def _read(path: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def _write(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=4, ensure_ascii=False) + "\n", encoding="utf-8")


def main() -> None:
    """Put a checkpoint into the package, with its card."""
    parser = argparse.ArgumentParser(prog="python -m owlxt5_policy.ship", description=main.__doc__)
    parser.add_argument("checkpoint", type=Path, help="folder pretrained_model of lerobot-train")
    parser.add_argument("eval_info", nargs="*", type=Path, help="eval_info.json of lerobot-eval")
    arguments = parser.parse_args()
    try:
        ship(arguments.checkpoint, arguments.eval_info)
    except (OSError, ValueError) as error:
        sys.exit(f"owlxt5_policy.ship: {error}")
    print(f"The policy: {FOLDER}")


if __name__ == "__main__":
    main()
