# SPDX-License-Identifier: Apache-2.0
"""A dataset's episodes as a policy trains on them: trajectories, texts, first poses and frames.

LeRobot's loader draws frames. It would gather a window of 2L - 1 rows for each of them, three quarters of its
time, to deliver the same few trajectories again and again, and it leaves language columns out of batches. So
the episodes are read once, from the dataset's files on this machine.
"""

import logging
from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import torch
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor

from ..commands.prompts import check_texts
from .episode_frames import EpisodeFrames
from .normalization import share_joint_range
from .start_pose import start_tolerance
from .windows import at_step

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

LANGUAGE_COLUMN = "language_persistent"
SCALED_ALIKE = 1e-3
"""Largest difference between a pose that a preprocessor has scaled and the same in `EpisodeStore`."""
_NEEDS_FILES = "The policy reads whole episodes from them: train without --dataset.streaming."


@dataclass(frozen=True)
class EpisodeTexts:
    """Texts of one episode beside its task.

    Attributes:
        wordings: Accepted wordings of the task (LeRobot's style `task_aug`), itself among them; or none.
        sentence: English sentence to translate (style `translation`, role `user`), or None.
        translation: The same sentence in German (style `translation`, role `assistant`), or None.
    """

    wordings: tuple[str, ...] = ()
    sentence: str | None = None
    translation: str | None = None


@dataclass(frozen=True)
class _Trajectories:
    """All actions and states one after the other, scaled; the rest by position of the episode.

    But the mean pose and its tolerance are of all episodes.
    """

    actions: Tensor
    states: Tensor
    row: dict[int, int]
    first: Tensor
    length: Tensor
    first_pose: Tensor
    initial_pose: Tensor
    initial_tolerance: Tensor


class EpisodeStore:
    """The episodes of a dataset whose files are on this machine; each part is read when it is asked for.

    Args:
        meta: The dataset.
    """

    def __init__(self, meta: "LeRobotDatasetMetadata") -> None:
        self._meta = meta
        self.frames = EpisodeFrames(meta)
        self._mean_lengths: dict[int, float] = {}
        self._largest_displacements: dict[int, Tensor] = {}

    def __len__(self) -> int:
        """Episodes of the dataset, those whose files are not on this machine too."""
        return self._meta.total_episodes

    def warn_of_long(self, steps: int) -> None:
        """Warn of an episode with more steps, which stops the training if it is not left out."""
        if sentence := find_long_episode(self._meta, steps):
            logging.warning(sentence)

    def actions(self, batch: dict[str, Any], steps: int) -> tuple[Tensor, Tensor]:
        """The whole episodes that the samples of a training batch come from.

        Args:
            batch: `episode_index` and `index`. The frame's `action` (batch, joints), which tells the device,
                and the episode's first `observation.state` tell whether the preprocessor scales as is done
                here.
            steps: L.

        Returns:
            Actions (batch, L, joints) in [-1, 1], the last one held after the end, and true steps (batch,),
            int64.

        Raises:
            KeyError: For an episode that is not on this machine.
            ValueError: If an episode is longer than L, or the preprocessor does something else to state or
                action.
        """
        stored, device = self._trajectories, batch[ACTION].device
        episodes = batch["episode_index"].flatten().tolist()
        if missing := sorted({episode for episode in episodes if episode not in stored.row}):
            raise KeyError(
                f"Episodes {missing} are in a batch, but their data files are not on this machine. "
                f"{_NEEDS_FILES}"
            )
        rows = torch.tensor([stored.row[episode] for episode in episodes])
        length = stored.length[rows]
        if (length > steps).any():
            raise ValueError(find_long_episode(self._meta, steps, episodes))
        step = torch.minimum(torch.arange(steps), length[:, None] - 1)
        actions, length = stored.actions[stored.first[rows, None] + step].to(device), length.to(device)
        start = torch.tensor([self._dataset_from_index[episode] for episode in episodes], device=device)
        frame = batch["index"].flatten() - start
        here = torch.stack(
            [actions[torch.arange(len(rows), device=device), frame], stored.first_pose[rows].to(device)]
        )
        delivered = torch.stack([batch[ACTION], at_step(batch[OBS_STATE], 0)]).to(here)
        if not torch.allclose(here, delivered, atol=SCALED_ALIKE, equal_nan=True):
            raise ValueError(
                "The preprocessor scales state or action otherwise than the policy, which gives both one "
                "range, that of this dataset. Train on with --policy.path=<checkpoint> in place of --resume, "
                "and leave --policy.normalization_mapping as it is."
            )
        return actions, length

    def mean_length(self, steps: int) -> float:
        """True steps of an episode, on average over those of the dataset that have at most `steps`.

        It scales all losses alike. LeRobot does not tell a policy which episodes are left out.
        """
        if steps not in self._mean_lengths:
            length = self._trajectories.length
            self._mean_lengths[steps] = length[length <= steps].double().mean().item()
        return self._mean_lengths[steps]

    @property
    def initial_pose(self) -> Tensor:
        """Mean of the episodes' first poses, (joints,), scaled to [-1, 1]."""
        return self._trajectories.initial_pose

    @property
    def initial_tolerance(self) -> Tensor:
        """How far from their mean a plan may begin, (joints,), scaled: their largest distance, and `NEAR`."""
        return self._trajectories.initial_tolerance

    def largest_displacement(self, steps: int) -> Tensor:
        """How far the next actions are from a step's pose, at most, (joints,), scaled.

        Args:
            steps: Length of the chunks of actions; after an episode's end the last one is held.
        """
        if steps not in self._largest_displacements:
            stored = self._trajectories
            frame = torch.arange(len(stored.actions))
            last = (stored.first + stored.length - 1).repeat_interleave(stored.length)
            distances = [
                (stored.actions[torch.minimum(frame + step, last)] - stored.states).abs().amax(dim=0)
                for step in range(steps)
            ]
            self._largest_displacements[steps] = torch.stack(distances).amax(dim=0)
        return self._largest_displacements[steps]

    @cached_property
    def texts(self) -> dict[int, EpisodeTexts]:
        """Texts by episode index; empty for a dataset without language columns.

        Wordings of another task are left out: `lerobot-edit-dataset` changes a task and leaves its wordings.
        Those that belong to it have it among them; so LeRobot and `owlxt5-dataset` write them.
        """
        if LANGUAGE_COLUMN not in self._meta.features:
            return {}
        texts, strangers = dict[int, EpisodeTexts](), []
        tasks = {index: task for task, index in self._meta.tasks["task_index"].items()}
        keys = "episode_index", "task_index", LANGUAGE_COLUMN
        for table in self._tables("frame_index", *keys):
            first_frames = table.filter(pc.equal(table["frame_index"], 0))
            for episode, task, rows in zip(*(first_frames[key].to_pylist() for key in keys), strict=True):
                texts[episode] = found = _sort_rows(rows or [])
                if found.wordings and tasks[task].strip() not in found.wordings:
                    texts[episode] = replace(found, wordings=())
                    strangers.append(episode)
        if strangers:
            logging.warning(
                f"The wordings of {len(strangers)} episodes of {self._meta.repo_id}, such as {strangers[0]}, "
                "are of another task than theirs, which was edited perhaps: they are left out."
            )
        return texts

    @cached_property
    def _trajectories(self) -> _Trajectories:
        stats = share_joint_range(self._meta.stats)[ACTION]
        low, high = (np.asarray(stats[end], dtype=np.float32) for end in ("min", "max"))
        row: dict[int, int] = {}
        actions: list[np.ndarray] = []
        states: list[np.ndarray] = []
        lengths: list[int] = []
        for table in self._tables("episode_index", ACTION, OBS_STATE):
            episode = table["episode_index"].to_numpy()
            scaled, scaled_states = (
                2 * (np.stack(table[key].to_numpy()) - low) / (high - low) - 1 for key in (ACTION, OBS_STATE)
            )
            first = np.flatnonzero(np.diff(episode, prepend=-1))
            for start, end in zip(first, [*first[1:], len(episode)], strict=True):
                row[int(episode[start])] = len(lengths)
                lengths.append(int(end - start))
            actions.append(scaled)
            states.append(scaled_states)
        if not lengths:
            raise KeyError(f"No data file of the dataset is on this machine. {_NEEDS_FILES}")
        length = torch.tensor(lengths)
        firsts, all_states = length.cumsum(dim=0) - length, np.concatenate(states)
        first_poses = all_states[firsts.numpy()]
        mean_pose = first_poses.mean(axis=0, dtype=np.float64)
        tolerance = start_tolerance(first_poses, high - low)
        return _Trajectories(
            torch.from_numpy(np.concatenate(actions).astype(np.float32)),
            torch.from_numpy(all_states.astype(np.float32)),
            row,
            firsts,
            length,
            *(torch.from_numpy(each.astype(np.float32)) for each in (first_poses, mean_pose, tolerance)),
        )

    @cached_property
    def _dataset_from_index(self) -> dict[int, int]:
        return dict(enumerate(self._meta.episodes["dataset_from_index"]))

    def _tables(self, *columns: str) -> Iterator[pa.Table]:
        for path in sorted((self._meta.root / "data").glob("*/*.parquet")):
            yield pq.read_table(path, columns=[*columns])


def _sort_rows(rows: list[dict[str, Any]]) -> EpisodeTexts:
    """Sort an episode's language rows by LeRobot's style and role."""
    said: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row["content"]:
            said.setdefault((row["style"], row["role"]), []).append(row["content"])
    wordings, sentences = (said.get((style, "user"), []) for style in ("task_aug", "translation"))
    check_texts(wordings + sentences, "A text of the dataset")
    return EpisodeTexts(
        wordings=tuple(wordings),
        sentence=next(iter(sentences), None),
        translation=next(iter(said.get(("translation", "assistant"), ())), None),
    )


def find_long_episode(
    meta: "LeRobotDatasetMetadata", max_episode_steps: int, episodes: Collection[int] | None = None
) -> str:
    """Say which episode is the longest, and what to do, if it is longer than a plan; else say nothing.

    Args:
        meta: The dataset.
        max_episode_steps: L.
        episodes: Only these count, if given.
    """
    lengths: list[int] = meta.episodes["length"][:]
    longest = max(range(len(lengths)) if episodes is None else episodes, key=lengths.__getitem__)
    if lengths[longest] <= max_episode_steps:
        return ""
    return (
        f"Episode {longest} of {meta.repo_id} has {lengths[longest]} steps, but the policy plans whole "
        f"episodes of at most {max_episode_steps}. Set --policy.max_episode_steps={lengths[longest]}, or "
        "leave the episode out with --dataset.episodes."
    )
