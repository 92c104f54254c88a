# SPDX-License-Identifier: Apache-2.0
"""A dataset's episodes as a policy trains on them: trajectories, texts, first poses and frames.

LeRobot's loader draws frames. It would gather a window of 2L - 1 rows for each of them, three quarters of its
time, to deliver the same few trajectories again and again, and it leaves language columns out of batches. So
the episodes are read once, from the dataset's files on this machine.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import torch
from lerobot.datasets.video_utils import decode_video_frames
from lerobot.utils.constants import ACTION, OBS_STATE
from PIL import Image
from torch import Tensor

from ..commands.prompts import check_texts
from .normalization import share_joint_range

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

LANGUAGE_COLUMN = "language_persistent"
SCALED_ALIKE = 1e-3
"""Largest difference between an action that a preprocessor has scaled and the same in `EpisodeStore`."""
NEAR = 0.1
"""How far from the trained first poses a plan may begin, as a share of half a joint's range (measured)."""
# The same for a joint that hardly moves, as a share of the range of the joint that moves most.
LEAST_NEAR = 0.2
# LeRobot's own default tolerance for the time of a frame, in seconds.
TOLERANCE = 1e-4


@dataclass(frozen=True)
class EpisodeTexts:
    """Texts of one episode beside its task.

    Attributes:
        wordings: Accepted wordings of the task (LeRobot's style `task_aug`).
        sentence: English sentence to translate (style `translation`, role `user`), or None.
        translation: The same sentence in German (style `translation`, role `assistant`), or None.
    """

    wordings: tuple[str, ...] = ()
    sentence: str | None = None
    translation: str | None = None


@dataclass(frozen=True)
class _Trajectories:
    """All actions one after the other, scaled; row, first and length by position of the episode."""

    actions: Tensor
    row: dict[int, int]
    first: Tensor
    length: Tensor
    initial_pose: Tensor
    initial_tolerance: Tensor


class EpisodeStore:
    """The episodes of a dataset whose files are on this machine; each part is read when it is asked for.

    Args:
        meta: The dataset.
    """

    def __init__(self, meta: "LeRobotDatasetMetadata") -> None:
        self._meta = meta

    def __len__(self) -> int:
        """Episodes of the dataset, those whose files are not on this machine too."""
        return self._meta.total_episodes

    def actions(self, batch: dict[str, Any], steps: int) -> tuple[Tensor, Tensor]:
        """The whole episodes that the samples of a training batch come from.

        Args:
            batch: `episode_index` and `index`, and the frame's `action` (batch, joints), which tells the
                device, and whether the preprocessor scales as is done here.
            steps: L, at least the length of the longest episode.

        Returns:
            Actions (batch, L, joints) in [-1, 1], the last one held after the end, and true steps (batch,),
            int64.

        Raises:
            KeyError: For an episode that is not on this machine.
            ValueError: If the preprocessor does something else to actions.
        """
        stored, device = self._trajectories, batch[ACTION].device
        episodes = batch["episode_index"].flatten().tolist()
        if missing := sorted({episode for episode in episodes if episode not in stored.row}):
            raise KeyError(
                f"Episodes {missing} are in a batch, but their data files are not on this machine. The "
                "policy reads whole episodes from them: train without --dataset.streaming."
            )
        rows = torch.tensor([stored.row[episode] for episode in episodes])
        length = stored.length[rows]
        step = torch.minimum(torch.arange(steps), length[:, None] - 1)
        actions, length = stored.actions[stored.first[rows, None] + step].to(device), length.to(device)
        start = torch.tensor([self._dataset_from_index[episode] for episode in episodes], device=device)
        frame = batch["index"].flatten() - start
        delivered = actions[torch.arange(len(rows), device=device), frame]
        if not torch.allclose(delivered, batch[ACTION].to(delivered), atol=SCALED_ALIKE, equal_nan=True):
            raise ValueError(
                "The preprocessor scales actions otherwise than the policy: state and action must have one "
                "range, that of this dataset. Use the preprocessor that the policy makes for it."
            )
        return actions, length

    @cached_property
    def mean_length(self) -> float:
        """True steps of an episode, on average."""
        lengths: list[int] = self._trajectories.length.tolist()
        return sum(lengths) / len(lengths)

    @property
    def initial_pose(self) -> Tensor:
        """Mean of the episodes' first poses, (joints,), scaled to [-1, 1]."""
        return self._trajectories.initial_pose

    @property
    def initial_tolerance(self) -> Tensor:
        """How far from their mean a plan may begin, (joints,), scaled: their largest distance, and `NEAR`."""
        return self._trajectories.initial_tolerance

    @cached_property
    def texts(self) -> dict[int, EpisodeTexts]:
        """Texts by episode index; empty for a dataset without language columns."""
        if LANGUAGE_COLUMN not in self._meta.features:
            return {}
        texts = {}
        for table in self._tables("episode_index", "frame_index", LANGUAGE_COLUMN):
            first_frames = table.filter(pc.equal(table["frame_index"], 0))
            for episode, rows in zip(
                first_frames["episode_index"].to_pylist(),
                first_frames[LANGUAGE_COLUMN].to_pylist(),
                strict=True,
            ):
                texts[episode] = _sort_rows(rows or [])
        return texts

    def frames(self, camera: str) -> Iterator[tuple[int, Tensor]]:
        """Read all frames of a camera, one episode after the other.

        A video is decoded from an episode's first frame to its last, with PyAV, which every LeRobot has; the
        data loader, which draws frames at random, opens and searches it for each of them.

        Args:
            camera: Key of an image feature, stored as video or as images.

        Yields:
            Index of an episode, and its frames (length, 3, height, width), uint8.
        """
        return self._videos(camera) if camera in self._meta.video_keys else self._images(camera)

    @cached_property
    def _trajectories(self) -> _Trajectories:
        stats = share_joint_range(self._meta.stats)[ACTION]
        low, high = (np.asarray(stats[end], dtype=np.float32) for end in ("min", "max"))
        row: dict[int, int] = {}
        actions: list[np.ndarray] = []
        poses: list[np.ndarray] = []
        lengths: list[int] = []
        for table in self._tables("episode_index", ACTION, OBS_STATE):
            episode = table["episode_index"].to_numpy()
            scaled, states = (
                2 * (np.stack(table[key].to_numpy()) - low) / (high - low) - 1 for key in (ACTION, OBS_STATE)
            )
            first = np.flatnonzero(np.diff(episode, prepend=-1))
            for start, end in zip(first, [*first[1:], len(episode)], strict=True):
                row[int(episode[start])] = len(lengths)
                lengths.append(int(end - start))
            actions.append(scaled)
            poses.append(states[first])
        length = torch.tensor(lengths)
        first_poses = np.concatenate(poses)
        mean_pose = first_poses.mean(axis=0, dtype=np.float64)
        tolerance = start_tolerance(first_poses, high - low)
        return _Trajectories(
            torch.from_numpy(np.concatenate(actions).astype(np.float32)),
            row,
            length.cumsum(dim=0) - length,
            length,
            *(torch.from_numpy(each.astype(np.float32)) for each in (mean_pose, tolerance)),
        )

    @cached_property
    def _dataset_from_index(self) -> dict[int, int]:
        return dict(enumerate(self._meta.episodes["dataset_from_index"]))

    def _tables(self, *columns: str) -> Iterator[pa.Table]:
        for path in sorted((self._meta.root / "data").glob("*/*.parquet")):
            yield pq.read_table(path, columns=[*columns])

    def _videos(self, camera: str) -> Iterator[tuple[int, Tensor]]:
        meta = self._meta
        for episode in range(meta.total_episodes):
            path = meta.root / meta.get_video_file_path(episode, camera)
            if path.is_file():
                row = meta.episodes[episode]
                start = row[f"videos/{camera}/from_timestamp"]
                times = [start + step / meta.fps for step in range(row["length"])]
                yield episode, decode_video_frames(path, times, TOLERANCE, "pyav", return_uint8=True)

    def _images(self, camera: str) -> Iterator[tuple[int, Tensor]]:
        for table in self._tables("episode_index", camera):
            for episode in table["episode_index"].unique().to_pylist():
                images = table.filter(pc.equal(table["episode_index"], episode))[camera].to_pylist()
                frames = [np.asarray(Image.open(BytesIO(image["bytes"])).convert("RGB")) for image in images]
                yield episode, torch.from_numpy(np.stack(frames)).permute(0, 3, 1, 2)


def start_tolerance(poses: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """How far from the mean of the first poses a plan may begin: as far as they do, and `NEAR`.

    A joint that hardly moves is scaled up. It may be off by what others may, not by a share of its own range.

    Args:
        poses: The episodes' first poses, (episodes, joints), scaled.
        ranges: Of the joints, before they were scaled, (joints,).

    Returns:
        (joints,), scaled.
    """
    spread = np.abs(poses - poses.mean(axis=0)).max(axis=0)
    tolerance: np.ndarray = spread + NEAR * np.maximum(1.0, LEAST_NEAR * ranges.max() / ranges)
    return tolerance


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


def check_episode_lengths(meta: "LeRobotDatasetMetadata", max_episode_steps: int) -> None:
    """Check that no episode is longer than a plan.

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
