# SPDX-License-Identifier: Apache-2.0
"""Whole episodes: from the data set's files in training, or from windows that LeRobot cuts around a frame."""

from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow.parquet as pq
import torch
from lerobot.utils.constants import ACTION
from torch import Tensor

from .joint_range import share_joint_range

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

SCALED_ALIKE = 1e-3
"""Largest difference between an action that a preprocessor has scaled and the same in `RememberedActions`."""


class RememberedActions:
    """All actions of a data set, scaled to [-1, 1] by the range that the preprocessor uses.

    LeRobot's loader would gather a window of 2L - 1 rows for each sample, three quarters of its time, to
    deliver the same few trajectories again and again.

    Attributes:
        mean_length: True steps of an episode, on average.

    Args:
        meta: The data set; the episodes whose data files are on this machine are read.
        max_episode_steps: L; no episode may be longer (`check_episode_lengths`).
    """

    def __init__(self, meta: "LeRobotDatasetMetadata", max_episode_steps: int) -> None:
        stats = share_joint_range(meta.stats)[ACTION]
        low, high = (np.asarray(stats[end], dtype=np.float32) for end in ("min", "max"))
        self._row: dict[int, int] = {}
        actions: list[np.ndarray] = []
        lengths: list[int] = []
        for path in sorted((meta.root / "data").glob("*/*.parquet")):
            table = pq.read_table(path, columns=["episode_index", ACTION])
            episode = table["episode_index"].to_numpy()
            scaled = 2 * (np.stack(table[ACTION].to_numpy()) - low) / (high - low) - 1
            first = np.flatnonzero(np.diff(episode, prepend=-1))
            for start, end in zip(first, [*first[1:], len(episode)], strict=True):
                self._row[int(episode[start])] = len(actions)
                steps = np.minimum(np.arange(max_episode_steps), end - start - 1)
                actions.append(scaled[start + steps])
                lengths.append(int(end - start))
        self._actions = torch.from_numpy(np.stack(actions).astype(np.float32))
        self._length = torch.tensor(lengths)
        self.mean_length = sum(lengths) / len(lengths)
        self._start = dict(enumerate(meta.episodes["dataset_from_index"]))

    def __call__(self, batch: dict[str, Any]) -> tuple[Tensor, Tensor]:
        """The whole episodes that the samples of a training batch come from.

        Args:
            batch: `episode_index` and `index`, and the frame's `action` (batch, joints), which tells the
                device, and whether the preprocessor scales as is done here.

        Returns:
            Actions (batch, L, joints), the last one held after the end, and true steps (batch,), int64.

        Raises:
            KeyError: For an episode that is not on this machine.
            ValueError: If the preprocessor does something else to actions.
        """
        device = batch[ACTION].device
        episodes = batch["episode_index"].flatten().tolist()
        if missing := sorted({episode for episode in episodes if episode not in self._row}):
            raise KeyError(
                f"Episodes {missing} are in a batch, but their data files are not on this machine. The "
                "policy reads whole episodes from them: train without --dataset.streaming."
            )
        rows = torch.tensor([self._row[episode] for episode in episodes])
        actions, length = self._actions[rows].to(device), self._length[rows].to(device)
        start = torch.tensor([self._start[episode] for episode in episodes], device=device)
        frame = batch["index"].flatten() - start
        delivered = actions[torch.arange(len(rows), device=device), frame]
        if not torch.allclose(delivered, batch[ACTION].to(delivered), atol=SCALED_ALIKE, equal_nan=True):
            raise ValueError(
                "The preprocessor scales actions otherwise than the policy: state and action must have one "
                "range, that of this data set. Use the preprocessor that the policy makes for it."
            )
        return actions, length


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
