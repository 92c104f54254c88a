# SPDX-License-Identifier: Apache-2.0
"""Whole episodes out of the windows that LeRobot's stock data loader cuts around a frame."""

from typing import TYPE_CHECKING

import torch
from torch import Tensor

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata


def recover_actions(window: Tensor, is_pad: Tensor) -> tuple[Tensor, Tensor]:
    """Recover an episode's actions from a window of 2L - 1 steps around any of its frames.

    LeRobot repeats the first and the last action where the window leaves the episode and marks these steps
    as padding, so the episode is the run of steps that are not marked. After its end the last pose is held:
    every sequence in this policy has L steps and needs no mask.

    Args:
        window: (batch, 2L - 1, joints) actions.
        is_pad: (batch, 2L - 1) bool, True outside the episode.

    Returns:
        The actions (batch, L, joints), held after the end, and the number of true steps (batch,), int64.
    """
    horizon = (window.shape[1] + 1) // 2
    length = (~is_pad).sum(dim=1)
    start = (~is_pad).int().argmax(dim=1)
    step = torch.arange(horizon, device=window.device)
    index = start[:, None] + torch.minimum(step, length[:, None] - 1)
    return window.gather(1, index[..., None].expand(-1, -1, window.shape[2])), length


def positions_before(first_pose: Tensor, actions: Tensor) -> Tensor:
    """Joint positions at each step: the first pose, then each action's target, one step later.

    Args:
        first_pose: (batch, joints).
        actions: (batch, L, joints).

    Returns:
        (batch, L, joints).
    """
    return torch.cat([first_pose[:, None], actions[:, :-1]], dim=1)


def at_step(value: Tensor, step: int, ndim: int) -> Tensor:
    """Take one step of a feature that comes with a time axis from some datasets and without from others.

    LeRobot drops the axis of a single requested step for videos, but not for images and vectors.

    Args:
        value: (batch, ...) or (batch, time, ...).
        step: Index into the time axis, if there is one.
        ndim: Number of dimensions without a time axis.
    """
    return value[:, step] if value.ndim > ndim else value


def check_episode_lengths(meta: "LeRobotDatasetMetadata", max_episode_steps: int) -> None:
    """Check that each episode fits the window.

    Raises:
        ValueError: Naming the longest episode and the flag to change.
    """
    lengths = torch.as_tensor(meta.episodes["length"][:])
    longest = int(lengths.argmax())
    if lengths[longest] > max_episode_steps:
        raise ValueError(
            f"Episode {longest} of {meta.repo_id} has {lengths[longest]} steps, but the policy plans whole "
            f"episodes of at most {max_episode_steps}. Set --policy.max_episode_steps={lengths[longest]}."
        )
