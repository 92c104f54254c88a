# SPDX-License-Identifier: Apache-2.0
"""A checkpoint's size, and what else may happen to a policy: bf16, torch.compile, EMA, PEFT."""

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from lerobot.datasets import LeRobotDataset
from lerobot.policies.factory import make_policy as lerobot_make_policy
from lerobot.policies.factory import make_pre_post_processors
from safetensors.torch import load_file, save_file
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from lerobot_owlxt5.backbones.small_t5 import SmallT5Config, collect_texts, make_small_t5
from lerobot_owlxt5.configuration_crossmodal import CORE_VERSION
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy
from policy_helpers import load_batch, make_config, make_owlv2, make_policy, observe

pytestmark = pytest.mark.slow  # compiles and trains

FRAMES = [0, 7, 20, 26]
TASKS = ["push red", "pull the ball"]


def make(dataset: LeRobotDataset, t5: Path, **options: Any) -> tuple[OWLxT5Policy, dict[str, Any]]:
    """A policy that is being trained, and a batch for it."""
    config = make_config(t5, dropout=0.0, **options)
    config.input_features = {}
    torch.manual_seed(0)
    policy = lerobot_make_policy(config, ds_meta=dataset.meta)
    preprocessor, _ = make_pre_post_processors(config, dataset_stats=dataset.meta.stats)
    return policy.train(), load_batch(dataset.root, FRAMES, preprocessor)


def learn(policy: torch.nn.Module, batch: dict[str, Any]) -> list[torch.Tensor]:
    """Loss and gradients of a step."""
    policy.zero_grad()
    loss, _ = policy(batch)
    loss.backward()
    return [loss.detach(), *(p.grad.clone() for p in policy.parameters() if p.grad is not None)]


def test_a_checkpoint_of_the_papers_size_is_small(t5: Path, tmp_path: Path) -> None:
    """The frozen T5 has T5-small's width, where it meets the core, and is small otherwise."""
    narrow = SmallT5Config(tmp_path / "t5", d_model=512, d_kv=8, d_ff=16, num_layers=1, num_heads=2)
    make_small_t5(narrow, collect_texts(None))
    paper = {
        "dim_model": 512,
        "n_heads": 4,
        "dim_feedforward": 1024,
        "dim_lstm": 256,
        "max_episode_steps": 85,
    }
    policy = make_policy(tmp_path / "t5", detector=str(make_owlv2(tmp_path / "owlv2")), **paper)
    policy.save_pretrained(tmp_path / "checkpoint")
    size = sum(path.stat().st_size for path in (tmp_path / "checkpoint").iterdir())
    assert 25e6 < size < 30e6


def test_a_checkpoint_with_other_parameters_is_refused(t5: Path, tmp_path: Path) -> None:
    policy = make_policy(t5)
    policy.save_pretrained(tmp_path)
    weights = load_file(tmp_path / "model.safetensors")
    weights["model.core.fc.old_name"] = weights.pop("model.core.fc.weight")
    save_file(weights, tmp_path / "model.safetensors")
    with pytest.raises(RuntimeError, match=r"(?s)core\.fc\.weight.*core\.fc\.old_name"):
        OWLxT5Policy.from_pretrained(tmp_path, config=policy.config)


@pytest.mark.parametrize(("version", "shown"), [(None, 1), (3, 3)])
def test_a_checkpoint_whose_parameters_mean_something_else_is_refused(
    t5: Path, tmp_path: Path, version: int | None, shown: int
) -> None:
    """Version 1 wrote none: same sizes, but keys and values without ReLU and norm."""
    make_policy(t5).save_pretrained(tmp_path)
    assert OWLxT5Policy.from_pretrained(tmp_path).config.core_version == CORE_VERSION
    config = json.loads((tmp_path / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps(config | {"core_version": version}))
    with pytest.raises(
        ValueError, match=rf"{tmp_path} was made by .*\(core_version {shown}, .*: train it again\.$"
    ):
        OWLxT5Policy.from_pretrained(tmp_path)


def test_bf16_moves_like_float32(dataset: LeRobotDataset, t5: Path) -> None:
    policy = make_policy(t5)
    batch = observe(TASKS)
    expected = policy.predict_action_chunk(batch)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        plan = policy.predict_action_chunk(batch)
        repeated = policy.repeat_action(
            load_batch(dataset.root, FRAMES, lambda batch: batch, finished=[-11, 11])
        )
    assert plan.dtype == repeated.dtype == torch.float32
    assert torch.allclose(plan, expected, atol=0.02)
    assert torch.equal(policy.predict_action_chunk(batch), expected), "bf16 must leave nothing behind"


@pytest.mark.parametrize("trained_along", [False, True])
def test_bf16_learns_like_float32(dataset: LeRobotDataset, t5: Path, trained_along: bool) -> None:
    policy, batch = make(dataset, t5, train_language_model=trained_along)
    policy.model.language.model.eval()  # without T5's dropout
    seed = policy.training_seed.clone()
    expected, *_ = learn(policy, batch)
    policy.training_seed.copy_(seed)
    with torch.autocast("cpu", dtype=torch.bfloat16):
        loss, *gradients = learn(policy, batch)
    assert loss == pytest.approx(expected.item(), rel=0.02)
    assert all(gradient.dtype == torch.float32 and gradient.isfinite().all() for gradient in gradients)


def test_a_compiled_policy_computes_the_same(dataset: LeRobotDataset, t5: Path) -> None:
    policy, batch = make(dataset, t5)
    seed = policy.training_seed.clone()
    expected = learn(policy, batch)
    policy.training_seed.copy_(seed)
    # Traced, but run by PyTorch's own kernels: no C++ compiler, no minutes.
    for one, other in zip(learn(torch.compile(policy, backend="aot_eager"), batch), expected, strict=True):
        assert torch.allclose(one, other, atol=1e-5)
    observation = observe(TASKS)
    plan = policy.predict_action_chunk(observation)
    # As lerobot-rollout does it.
    compiled = torch.compile(policy.predict_action_chunk, backend="aot_eager")
    assert torch.allclose(compiled(observation), plan, atol=1e-5)


def test_averaged_weights_work(dataset: LeRobotDataset, t5: Path, tmp_path: Path) -> None:
    """LeRobot has no EMA of its own: PyTorch's."""
    policy, batch = make(dataset, t5)
    average = AveragedModel(policy, multi_avg_fn=get_ema_multi_avg_fn(0.5), use_buffers=True)
    optimizer = torch.optim.Adam(policy.get_optim_params(), 1e-2)
    average.update_parameters(policy)
    before = policy.model.core.fc.weight.detach().clone()
    learn(policy, batch)
    optimizer.step()
    average.update_parameters(policy)
    assert torch.allclose(average.module.model.core.fc.weight, (before + policy.model.core.fc.weight) / 2)
    assert average.module.training_seed.dtype == torch.int64
    average.module.save_pretrained(tmp_path)
    plan = OWLxT5Policy.from_pretrained(tmp_path).predict_action_chunk(observe(TASKS))
    assert torch.equal(plan, average.module.predict_action_chunk(observe(TASKS)))
