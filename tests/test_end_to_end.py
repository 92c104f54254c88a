# SPDX-License-Identifier: Apache-2.0
"""Stock lerobot-train and lerobot-eval with the plugin, in processes of their own, on a tiny dataset."""

import json
import re
import shutil
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from commands import launch, run
from policy_helpers import without_dropout

pytestmark = pytest.mark.slow  # starts trainings

TRAIN = (
    "--config_path=configs/small.yaml",
    "--policy.type=owlxt5",
    "--policy.detector=ground_truth",
    "--policy.train_language_model=true",
    "--policy.dim_model=32",
    "--policy.dim_feedforward=32",
    "--policy.dim_lstm=16",
    "--batch_size=4",
    "--num_workers=0",
    "--log_freq=5",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of 12 episodes and a small T5."""
    folder = tmp_path_factory.mktemp("end_to_end")
    run(
        "owlxt5-dataset",
        f"--root={folder / 'data'}",
        "--arrangements=1",
        "--height=48",
        "--width=64",
        "--workers=1",
    )
    small = ("--d_model=16", "--d_kv=8", "--d_ff=16", "--num_layers=1", "--num_heads=2")
    output = run(
        "python",
        *("-m", "lerobot_owlxt5.backbones.small_t5", f"--output_dir={folder / 't5'}"),
        *(f"--dataset_root={folder / 'data'}", *small),
    )
    assert "lerobot-train" in output.splitlines()[-1]
    return folder


def train(folder: Path, name: str, *arguments: str) -> Path:
    """Train 20 steps; the folder of checkpoints."""
    output = folder / name
    places = (f"--dataset.root={folder / 'data'}", f"--policy.language_model={folder / 't5'}")
    run("lerobot-train", *TRAIN, *places, f"--output_dir={output}", "--steps=20", *arguments)
    return output / "checkpoints"


@pytest.fixture(scope="module")
def checkpoints(folder: Path) -> Path:
    return train(folder, "whole", "--save_freq=10")


def weights(checkpoint: Path) -> dict[str, torch.Tensor]:
    return load_file(checkpoint / "pretrained_model" / "model.safetensors")


@pytest.mark.parametrize(
    ("command", "names"),
    [("lerobot-train", ("owlxt5", "clant", "claeo")), ("lerobot-eval", ("owlxt5", "clant", "claeo"))],
)
def test_lerobot_finds_the_plugin(command: str, names: tuple[str, ...]):
    help_text = run(command, "--help")
    for name in names:
        assert name in help_text, name


def test_training_learns_something(folder: Path, checkpoints: Path):
    first, last = weights(checkpoints / "000010"), weights(checkpoints / "000020")
    assert any(not torch.equal(first[key], last[key]) for key in first)
    assert all(tensor.isfinite().all() for tensor in last.values())


def test_a_resumed_run_ends_with_the_same_weights(folder: Path, checkpoints: Path):
    config = checkpoints / "000010" / "pretrained_model" / "train_config.json"
    before = weights(checkpoints / "000020")
    run("lerobot-train", f"--config_path={config}", "--resume=true")
    after = weights(checkpoints / "000020")
    assert before.keys() == after.keys()
    for key, tensor in before.items():
        assert torch.equal(tensor, after[key]), key


# Dropout is also off in a trained T5, because its masks depend on the whole batch.
ALL_MODES = '--policy.mode_probabilities={"execute":0.3,"describe":0.3,"repeat_action":0.2,"translate":0.2}'


def curve(output: str) -> list[dict[str, float]]:
    """What lerobot-train logged at each step."""
    lines = re.findall(r"step:\d+ .*", output)
    return [{key: float(value) for key, value in re.findall(r"(\w+):([\d.]+)\b", line)} for line in lines]


@pytest.mark.parametrize("trained_along", ["false", "true"])
def test_two_processes_learn_what_one_learns_from_the_doubled_batch(folder: Path, trained_along: str):
    t5 = without_dropout(shutil.copytree(folder / "t5", folder / f"t5_{trained_along}"))
    options = (
        *(*TRAIN, f"--dataset.root={folder / 'data'}", f"--policy.language_model={t5}", "--steps=6"),
        # Dropout masks are drawn for a batch as a whole.
        *(f"--policy.train_language_model={trained_along}", ALL_MODES, "--policy.dropout=0", "--log_freq=1"),
    )
    one, two = folder / f"one_{trained_along}", folder / f"two_{trained_along}"
    expected = curve(run("lerobot-train", *options, "--batch_size=8", f"--output_dir={one}"))
    log = launch("lerobot-train", *options, f"--output_dir={two}", until="End of training")
    assert "Effective batch size: 4 x 2 = 8" in log
    got = curve(log)
    assert len(got) == len(expected) == 6
    for ours, theirs in zip(got, expected, strict=True):
        for key in ("loss", "grdn", "joint_loss", "language_loss", "stop_loss"):
            assert ours[key] == pytest.approx(theirs[key], abs=2e-3), key  # three decimals are logged
    first, second = (weights(output / "checkpoints" / "last") for output in (one, two))
    for key, tensor in first.items():
        ours, theirs = tensor.float(), second[key].float()
        if key.endswith("attention.in_proj_bias"):
            # Softmax ignores the keys' bias: Adam makes steps of its gradient's rounding errors.
            ours, theirs = (
                torch.cat([queries, values]) for queries, _, values in (ours.chunk(3), theirs.chunk(3))
            )
        assert torch.allclose(ours, theirs, atol=1e-4), key


def test_adapters_are_trained_and_evaluated(folder: Path, checkpoints: Path):
    output = folder / "adapted"
    checkpoint = checkpoints / "000010" / "pretrained_model"
    run(
        "lerobot-train",
        *(f"--policy.path={checkpoint}", "--policy.push_to_hub=false", "--peft.method_type=LORA"),
        *("--dataset.repo_id=local/clant", f"--dataset.root={folder / 'data'}", f"--output_dir={output}"),
        *("--batch_size=2", "--num_workers=0", "--steps=2"),
    )
    adapted = output / "checkpoints" / "last" / "pretrained_model"
    adapters = load_file(adapted / "adapter_model.safetensors")
    assert any(".decoder.joints." in key for key in adapters)
    assert any(".language_model." in key for key in adapters)
    assert any(tensor.any() for key, tensor in adapters.items() if "lora_B" in key)
    run(
        "lerobot-eval",
        *(f"--policy.path={adapted}", "--policy.device=cpu", "--env.type=clant", "--env.task=PUSH-L"),
        *("--env.observation_height=48", "--env.observation_width=64", "--eval.n_episodes=1"),
        *("--eval.batch_size=1", f"--output_dir={folder / 'eval_adapted'}"),
    )


def test_bf16_trains_and_acts_on_what_the_embedded_detector_sees(folder: Path):
    last = train(folder, "bf16", "--policy.use_amp=true", "--policy.detector=embedded") / "last"
    assert all(
        tensor.dtype != torch.bfloat16 and tensor.isfinite().all() for tensor in weights(last).values()
    )
    run(
        "lerobot-eval",
        *(f"--policy.path={last / 'pretrained_model'}", "--policy.device=cpu", "--env.type=clant"),
        *("--env.observation_height=48", "--env.observation_width=64", "--eval.n_episodes=1"),
        *("--eval.batch_size=1", "--env.task=PUSH-L", f"--output_dir={folder / 'eval_bf16'}"),
    )


def test_another_policy_trains_on_the_same_data(folder: Path):
    output = folder / "act"
    run(
        "lerobot-train",
        *("--policy.type=act", "--policy.device=cpu", "--policy.push_to_hub=false"),
        *("--policy.pretrained_backbone_weights=null", "--policy.dim_model=16", "--policy.n_heads=2"),
        *("--policy.chunk_size=8", "--policy.n_action_steps=8", "--policy.dim_feedforward=16"),
        *("--dataset.repo_id=local/clant", f"--dataset.root={folder / 'data'}", f"--output_dir={output}"),
        *("--batch_size=2", "--num_workers=0", "--steps=2"),
    )
    last = weights(output / "checkpoints" / "last")
    assert all(tensor.isfinite().all() for tensor in last.values())


# With all that the evaluation can be told.
OPTIONS = {"clant": ("--env.placement=free",), "claeo": ("--env.objects=household",)}


@pytest.mark.parametrize(("env_type", "batch"), [("clant", 1), ("claeo", 2)])
def test_a_checkpoint_is_evaluated(folder: Path, checkpoints: Path, env_type: str, batch: int):
    output = folder / f"eval_{env_type}"
    run(
        "lerobot-eval",
        f"--policy.path={checkpoints / 'last' / 'pretrained_model'}",
        *(f"--env.type={env_type}", *OPTIONS[env_type], "--env.task=PUSH-L", "--policy.device=cpu"),
        *("--env.observation_height=48", "--env.observation_width=64"),
        *(f"--eval.n_episodes={batch}", f"--eval.batch_size={batch}", f"--output_dir={output}"),
        f"--env.output_dir={output}",
    )
    info = json.loads((output / "eval_info.json").read_text())
    objects = "household" if env_type == "claeo" else env_type
    assert info["per_group"][objects]["n_episodes"] == batch
    assert all(Path(video).stat().st_size > 0 for video in info["overall"]["video_paths"])
    table = run(
        "python", "-m", "nico_tabletop.report", output / "eval_info.json", f"--image={output / 'p.png'}"
    )
    assert objects in table
    assert "PUSH-L" in table
    assert "?" not in table  # why each episode failed is recorded
    assert (output / "p.png").stat().st_size > 0
