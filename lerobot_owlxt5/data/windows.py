# SPDX-License-Identifier: Apache-2.0
"""Finished episodes as LeRobot's loader gives them: windows of steps around one of their frames."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from lerobot.utils.constants import ACTION, OBS_PREFIX, OBS_STATE
from torch import Tensor

STILL_STEPS = 10
"""In execute and translate the action encoder reads the first pose for a second (repeated: paper, section 3).

More steps of the same say nothing new and cost as much as a movement (our decision).
"""


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


def first_pose(batch: Mapping[str, Any]) -> Tensor:
    """Scaled joints at the first step, (batch, joints), clamped to the trained range."""
    return at_step(batch[OBS_STATE], 0).clamp(-1.0, 1.0)


def recorded_joints(batch: Mapping[str, Any]) -> Tensor:
    """Joints at each step of finished episodes, (batch, L, joints)."""
    actions, _ = recover_actions(batch[ACTION], batch["action_is_pad"])
    return positions_before(first_pose(batch), actions)


def still(pose: Tensor) -> Tensor:
    """What the action encoder reads when nothing has moved yet.

    Args:
        pose: (batch, joints).

    Returns:
        (batch, STILL_STEPS, joints).
    """
    return pose[:, None].expand(-1, STILL_STEPS, -1)


def at_step(value: Tensor, step: int) -> Tensor:
    """Take one step of a feature that comes with a time axis from some datasets and without from others.

    LeRobot drops the axis of a single requested step for videos, but not for images and vectors.

    Args:
        value: Vectors (batch, numbers) or images (batch, channels, height, width), or both with a time axis
            behind the batch.
        step: Index into the time axis, if there is one.
    """
    return value[:, step] if value.ndim in (3, 5) else value


def observation_at(batch: Mapping[str, Any], step: int) -> dict[str, Tensor]:
    """Take one step of all features `observation.*` of a batch, see `at_step`."""
    return {
        key: at_step(value, step)
        for key, value in batch.items()
        if key.startswith(OBS_PREFIX) and isinstance(value, Tensor) and not key.endswith("_is_pad")
    }


def samples_at(batch: Mapping[str, Any], chosen: Sequence[int]) -> dict[str, Any]:
    """Some samples of a batch: of its tensors and of its tasks."""
    return {
        key: value[[*chosen]] if isinstance(value, Tensor) else [value[index] for index in chosen]
        for key, value in batch.items()
        if isinstance(value, Tensor | list | tuple)
    }


def finished_episode(
    observations: Sequence[Mapping[str, Any]], actions: Sequence[Tensor], max_episode_steps: int
) -> dict[str, Any]:
    """Put a rollout into the layout in which `describe` and `repeat_action` expect a finished episode.

    Args:
        observations: Before the preprocessor, each (batch, ...) and with a `task`. Two are enough for
            `owlxt5`, the first and the last; `crosst5` needs the one before each action.
        actions: After the postprocessor, each (batch, joints); steps at the end in which nothing changes are
            left out.
        max_episode_steps: L of the policy's configuration.

    Returns:
        The observations stacked along a time axis, `action` (batch, 2L - 1, joints) and `action_is_pad`; it
        goes through the preprocessor next.

    Raises:
        ValueError: If there are no actions, or more than L.
    """
    length = len(actions)
    while length > 1 and torch.equal(actions[length - 1], actions[length - 2]):
        length -= 1
    if not 0 < length <= max_episode_steps:
        raise ValueError(
            f"A finished episode has 1 to {max_episode_steps} actions (--policy.max_episode_steps), "
            f"not {length}."
        )
    # The window of the episode's first frame: L - 1 steps before it, and L from it on.
    step = torch.arange(1 - max_episode_steps, max_episode_steps)
    inside = step.clamp(0, length - 1)
    is_pad = ((step < 0) | (step >= length)).expand(len(actions[0]), -1)
    batch: dict[str, Any] = {
        ACTION: torch.stack([*actions], dim=1)[:, inside],
        "action_is_pad": is_pad,
        "task": observations[0]["task"],
    }
    for key in (key for key in observations[0] if key.startswith(OBS_PREFIX)):
        batch[key] = torch.stack([observation[key] for observation in observations], dim=1)
        if len(observations) >= len(actions):
            batch[key] = batch[key][:, inside]
            batch[f"{key}_is_pad"] = is_pad
    return batch
