# SPDX-License-Identifier: Apache-2.0
"""What stops a policy: numbers that no robot may act on, and no training may learn from."""

from collections.abc import Mapping
from reprlib import repr as shortened
from typing import Any

from lerobot.utils.constants import OBS_STATE
from torch import Tensor


def check_state(state: Tensor, joints: int) -> None:
    """Stop a robot that has other joints, or does not know where they are.

    Args:
        state: (batch, ..., joints).
        joints: How many the policy was trained on.

    Raises:
        ValueError: Naming the environment and the joint.
    """
    if state.shape[-1] != joints:
        raise ValueError(
            f"'{OBS_STATE}' has {state.shape[-1]} numbers, and the policy was trained on {joints} joints: "
            "this environment or robot is another one than that of the training data."
        )
    bad = (~state.isfinite()).nonzero()
    if len(bad):
        raise ValueError(
            f"'{OBS_STATE}' of environment {int(bad[0, 0])} is not finite at joint {int(bad[0, -1])} (both "
            "counted from 0), so there is no safe action. Check the robot's sensors."
        )


def read_tasks(batch: Mapping[str, Any]) -> list[str]:
    """The task of each sample of a batch.

    Raises:
        ValueError: If there is not one text for each sample.
    """
    if OBS_STATE not in batch:
        raise ValueError(f"The batch lacks '{OBS_STATE}', the positions of the robot's joints.")
    tasks, samples = batch.get("task"), len(batch[OBS_STATE])
    if not isinstance(tasks, list | tuple) or [type(task) for task in tasks] != [str] * samples:
        raise ValueError(
            f"'task' must be a list with one command for each of the {samples} samples of the batch, such as "
            f"'push the red cube', and is {shortened(tasks)}."
        )
    return [*tasks]


def check_finite_loss(loss: Tensor, batch: Mapping[str, Any]) -> None:
    """Stop before a loss (batch,) that is no number ruins the weights, and say where it comes from.

    Raises:
        FloatingPointError: Naming the episodes.
    """
    bad = ~loss.isfinite()
    if bad.any():
        episodes = sorted(set(batch["episode_index"].flatten().cpu()[bad.cpu()].tolist()))
        raise FloatingPointError(
            f"The loss of episodes {episodes} is not finite. If they hold no value that is not finite, the "
            "training diverged: resume from the last checkpoint with a smaller --policy.optimizer_lr."
        )
