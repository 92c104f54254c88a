# SPDX-License-Identifier: Apache-2.0
import pytest
import torch
from torch import nn

from lerobot_owlxt5.model.action import ActionDecoder, hold_after_stop
from lerobot_owlxt5.model.core import CrossmodalCore
from lerobot_owlxt5.model.transformer import sinusoidal_positions


def size(module: nn.Module) -> int:
    return sum(parameter.numel() for parameter in module.parameters())


@pytest.mark.parametrize(("dim_visual", "published"), [(2, 6_352_394), (30, 6_438_410)])
def test_parameter_count(dim_visual: int, published: int) -> None:
    """With CrossT5's 30 visual features the sum is that of its authors' code."""
    core = CrossmodalCore(dim_language=512, dim_visual=dim_visual, n_joints=10)
    assert size(core) - size(core.decoder.stop) == published


def test_padding_changes_nothing() -> None:
    torch.manual_seed(0)
    core = CrossmodalCore(16, 2, 3, dim_model=8, n_heads=2, dim_feedforward=16, dim_lstm=8).eval()
    language, mask = torch.randn(2, 5, 16), torch.arange(5) < torch.tensor([[5], [3]])
    visual, joints = torch.randn(2, 1, 2), torch.randn(2, 4, 3)
    together = core(language, mask, visual, joints)
    alone = core(language[1:, :3], mask[1:, :3], visual[1:], joints[1:])
    assert torch.allclose(together.context[1], alone.context[0], atol=1e-6)
    assert torch.allclose(together.language_residual[1, :3], alone.language_residual[0], atol=1e-6)


def test_the_decoder_is_causal_and_bounded() -> None:
    torch.manual_seed(0)
    decoder = ActionDecoder(8, 2, 3, dim_lstm=8, n_layers=2)
    inputs = torch.randn(2, 8), torch.randn(2, 1, 2), torch.rand(2, 3)
    long, long_stop = decoder(*inputs, steps=6)
    short, short_stop = decoder(*inputs, steps=3)
    assert torch.allclose(long[:, :3], short)
    assert torch.allclose(long_stop[:, :3], short_stop)
    assert long.abs().max() <= 1


def test_the_pose_is_held_after_the_first_stop() -> None:
    actions = torch.arange(4.0).view(1, 4, 1).repeat(3, 1, 1)
    stop = torch.tensor([[-1.0, 1, -1, 1], [-1, -1, -1, -1], [1, -1, -1, -1]])
    assert hold_after_stop(actions, stop)[..., 0].tolist() == [[0, 1, 1, 1], [0, 1, 2, 3], [0, 0, 0, 0]]


def test_sinusoidal_positions() -> None:
    positions = sinusoidal_positions(3, 4)
    assert torch.allclose(positions[:, 0], torch.arange(3.0).sin())
    assert torch.allclose(positions[:, 3], (torch.arange(3) / 100).cos())
