# SPDX-License-Identifier: Apache-2.0
"""The first and the last frame of episodes, which show what was done."""

from collections.abc import Sequence

import torch
from torch import Tensor
from torch.nn.functional import interpolate

from .episode_frames import EpisodeFrames


class EpisodeEnds:
    """Reads the two frames of an episode when they are first asked for, and keeps them at a small size.

    LeRobot's loader would decode all frames between the two, for each sample of a batch.

    Args:
        frames: The dataset's.
        camera: Key of an image feature.
        size: Height and width that the frames are kept at, pixels.
    """

    def __init__(self, frames: EpisodeFrames, camera: str, size: tuple[int, int]) -> None:
        self._frames, self._camera, self._size = frames, camera, size
        self._kept: dict[int, Tensor] = {}

    def read(self, episodes: Sequence[int]) -> Tensor:
        """The first and the last frame of each episode.

        Returns:
            (batch, 2, 3, height, width), uint8.

        Raises:
            KeyError: For an episode that is not on this machine.
        """
        missing = {*episodes} - self._kept.keys()
        if missing:
            for episode, frames in self._frames.read(self._camera, missing):
                ends = interpolate(frames[[0, -1]].float(), self._size, mode="area")
                self._kept[episode] = ends.round().to(torch.uint8)
        return torch.stack([self._kept[episode] for episode in episodes])
