# SPDX-License-Identifier: Apache-2.0
"""The policy in the package: it loads, acts without a network, and names nobody's machine."""

import json
import re
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from safetensors.torch import load_file, save_file

from commands import run
from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy
from lerobot_owlxt5.trained import FOLDER, find_policy
from owlxt5_policy.card import write_card
from owlxt5_policy.ship import ship

ROOT = Path(__file__).parents[1]
WEIGHTS = "model.safetensors"
FILES = {
    "README.md",
    "config.json",
    WEIGHTS,
    "policy_postprocessor.json",
    "policy_postprocessor_step_0_unnormalizer_processor.safetensors",
    "policy_preprocessor.json",
    "policy_preprocessor_step_3_normalizer_processor.safetensors",
}
needs_weights = pytest.mark.skipif(
    not (FOLDER / WEIGHTS).exists(),
    reason="the package has no trained policy yet: python -m owlxt5_policy.ship",
)


def check_files(folder: Path) -> None:
    """All files are there, and no text has an absolute path."""
    assert {path.name for path in folder.iterdir()} == FILES
    for path in folder.iterdir():
        if path.suffix in (".json", ".md"):
            found = re.findall(r"(?m)(?:^|[\s\"'=(])(?:/[\w.-]+|~/|[A-Za-z]:\\)\S*", path.read_text("utf-8"))
            assert found == [], path.name


def evaluate(policy: Path, output: Path, *options: str) -> list[float]:
    """The rewards of two episodes of claeo."""
    run(
        "lerobot-eval",
        *(f"--policy.path={policy}", "--env.type=claeo", "--env.task=PUSH-L", "--eval.n_episodes=2"),
        *("--eval.batch_size=1", f"--output_dir={output}", *options),
    )
    [task] = json.loads((output / "eval_info.json").read_text())["per_task"]
    rewards: list[float] = task["metrics"]["sum_rewards"]
    return rewards


def test_a_package_without_weights_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="has no trained policy"):
        find_policy(tmp_path)
    (tmp_path / WEIGHTS).touch()
    assert find_policy(tmp_path) == tmp_path


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    """As much of one as is read before it is refused."""
    backbones = {part: "embedded" for part in ("detector", "language_model", "understanding")}
    revisions = {f"{part}_revision": None for part in backbones}
    config = {"type": "owlxt5", "train_language_model": False, **backbones, **revisions}
    (tmp_path / "config.json").write_text(json.dumps(config))
    (tmp_path / "train_config.json").write_text(json.dumps({"dataset": {"root": str(tmp_path / "data")}}))
    return tmp_path


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"type": "crosst5"}, "is of crosst5"),
        ({"train_language_model": True}, "was trained along"),
        ({"detector": "google/owlv2-base-patch16"}, "--policy.detector=embedded"),
        ({"language_model_revision": "0123456789ab"}, "another embedded language model"),
        ({}, "says how a dataset of owlxt5-dataset was made"),
    ],
)
def test_what_cannot_ship_is_refused(checkpoint: Path, change: dict[str, Any], reason: str) -> None:
    config = checkpoint / "config.json"
    config.write_text(json.dumps(json.loads(config.read_text()) | change))
    with pytest.raises(ValueError, match=reason):
        ship(checkpoint, [], checkpoint / "shipped")
    assert not (checkpoint / "shipped").exists()


def test_the_releases_movements_do_not_ship(checkpoint: Path) -> None:
    build = checkpoint / "data" / "meta" / "build.json"
    build.parent.mkdir(parents=True)
    build.write_text(json.dumps({"release": True, "command": "owlxt5-dataset"}))
    with pytest.raises(ValueError, match="state no licence"):
        ship(checkpoint, [], checkpoint / "shipped")


def test_what_ships_stays_until_all_is_written(checkpoint: Path) -> None:
    build = checkpoint / "data" / "meta" / "build.json"
    build.parent.mkdir(parents=True)
    build.write_text(json.dumps({"release": False, "command": "owlxt5-dataset"}))
    save_file({"model.weight": torch.ones(2)}, checkpoint / WEIGHTS)
    for name in ("policy_preprocessor.json", "policy_postprocessor.json"):
        (checkpoint / name).write_text(json.dumps({"steps": []}))
    before = {path.name for path in checkpoint.iterdir()}
    old = checkpoint / "shipped" / "old.json"
    old.parent.mkdir()
    old.touch()
    with pytest.raises(FileNotFoundError):
        ship(checkpoint, [checkpoint / "nowhere.json"], old.parent)
    assert [*old.parent.iterdir()] == [old]
    assert {path.name for path in checkpoint.iterdir()} == before | {"shipped"}


def test_a_training_without_a_scheduler_gets_a_card(tmp_path: Path) -> None:
    recipe = yaml.safe_load((ROOT / "configs" / "small.yaml").read_text("utf-8"))
    training = recipe | {
        "dataset": recipe["dataset"] | {"episodes": None},
        "policy": vars(OWLxT5Config(device="cpu")) | recipe["policy"],
        "use_policy_training_preset": True,
        "scheduler": None,
        "steps": 4,
    }
    (tmp_path / WEIGHTS).touch()
    write_card(tmp_path, training, "owlxt5-dataset", [])
    card = (tmp_path / "README.md").read_text("utf-8")
    assert "--use_policy_training_preset=true" in card
    assert "--scheduler" not in card


@pytest.mark.slow
def test_a_miniature_is_trained_by_the_recipe_and_shipped(tmp_path: Path) -> None:
    data, output = tmp_path / "data", tmp_path / "train"
    run("owlxt5-dataset", f"--root={data}", "--arrangements=1", "--height=48", "--width=64", "--workers=1")
    run(
        "lerobot-train",
        *("--config_path=configs/small.yaml", "--policy.type=owlxt5", "--policy.detector=embedded"),
        *(f"--dataset.root={data}", "--dataset.episodes=[0,1,2,3,4,5,6,7,8,9,10,11]", "--steps=4"),
        *(
            "--policy.dim_model=32",
            "--policy.dim_lstm=16",
            "--policy.object_point=foot",
            "--policy.nadir=1.1",
        ),
        *("--batch_size=4", "--num_workers=0", f"--output_dir={output}"),
    )
    trained, shipped = output / "checkpoints" / "last" / "pretrained_model", tmp_path / "shipped"
    # A file of an older policy does not stay.
    shipped.mkdir()
    (shipped / "old.json").touch()
    ship(trained, [], shipped)
    check_files(shipped)
    card = (shipped / "README.md").read_text("utf-8")
    for line in (
        "owlxt5-dataset --objects=clant --arrangements=1 --height=48 --width=64 --root=outputs/clant",
        '--dataset.episodes="[$(seq -s, 0 11)]"',
        "--steps=4",
        "--batch_size=4",
        "--policy.dim_lstm=16",
        "--policy.object_point=foot",
        "--policy.nadir=1.1",
        "It was not evaluated yet",
    ):
        assert line in card
    assert "dim_feedforward" not in card  # as in the recipe
    assert str(tmp_path).encode() not in b"".join(path.read_bytes() for path in shipped.iterdir())
    before, after = load_file(trained / WEIGHTS), load_file(shipped / WEIGHTS)
    assert (shipped / WEIGHTS).stat().st_size < 0.7 * (trained / WEIGHTS).stat().st_size
    policy = OWLxT5Policy.from_pretrained(shipped)
    for name, tensor in policy.state_dict().items():
        if name in before:
            assert tensor.dtype == before[name].dtype
            torch.testing.assert_close(tensor, before[name], rtol=1e-3, atol=1e-4)
    assert after.keys() == before.keys()
    small = ("--env.observation_height=48", "--env.observation_width=64")
    assert len(evaluate(shipped, tmp_path / "eval", *small)) == 2


@needs_weights
def test_the_policy_of_the_package_names_no_machine() -> None:
    check_files(find_policy())
    assert (find_policy() / WEIGHTS).stat().st_size < 10e6


@pytest.mark.slow
@needs_weights
def test_the_policy_of_the_package_acts_on_what_it_never_saw(tmp_path: Path) -> None:
    assert max(evaluate(find_policy(), tmp_path / "eval")) > 0
