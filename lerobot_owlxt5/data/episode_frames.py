# SPDX-License-Identifier: Apache-2.0
"""The frames of whole episodes, read from the dataset's files in their order."""

from collections.abc import Collection, Iterator, Sequence
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import torch
from lerobot.datasets.video_utils import decode_video_frames
from PIL import Image
from torch import Tensor

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

SAME_IMAGE = 0.01
"""Largest mean difference between a frame that the loader delivers and the same in the files, of white.

Decoders differ by less, transformed images by more.
"""


class EpisodeFrames:
    """Reads episodes whose files are on this machine, and keeps nothing of them."""

    def __init__(self, meta: "LeRobotDatasetMetadata") -> None:
        self._meta = meta

    def read(self, camera: str, episodes: Collection[int] | None = None) -> Iterator[tuple[int, Tensor]]:
        """Read all frames of a camera, one episode after the other.

        A video is decoded from an episode's first frame to its last, with PyAV, which every LeRobot has; the
        data loader, which draws frames at random, opens and searches it for each of them. A frame may be off
        its time by half a frame, whatever --tolerance_s says.

        Args:
            camera: Key of an image feature, stored as video or as images.
            episodes: Only these, if given.

        Yields:
            Index of an episode, and its frames (length, 3, height, width), uint8.
        """
        chosen = range(self._meta.total_episodes) if episodes is None else sorted({*episodes})
        videos = camera in self._meta.video_keys
        return self._videos(camera, chosen) if videos else self._images(camera, chosen)

    def find_camera(self, episodes: Sequence[int], images: Tensor) -> str:
        """Find out which camera of the dataset a batch's images come from: --rename_map may have renamed it.

        Args:
            episodes: Index of each image's episode.
            images: The episodes' first frames from the loader, (batch, 3, height, width) in [0, 1].

        Returns:
            Key of an image feature of the dataset.

        Raises:
            ValueError: If they come from none, as where --dataset.image_transforms change them.
        """
        cameras = [key for key in self._meta.camera_keys if key not in self._meta.depth_keys]
        for camera in cameras:
            first = {episode: frames[0] for episode, frames in self.read(camera, episodes)}
            stored = torch.stack([first[episode] for episode in episodes]).to(images) / 255
            if (
                stored.shape == images.shape
                and (stored - images).abs().flatten(1).mean(dim=1).max() < SAME_IMAGE
            ):
                return camera
        raise ValueError(
            f"The loader's images are not those in the files of the dataset's cameras {cameras}, from which "
            "crosst5 reads whole episodes: set --dataset.image_transforms.enable=false."
        )

    def _videos(self, camera: str, episodes: Collection[int]) -> Iterator[tuple[int, Tensor]]:
        meta = self._meta
        for episode in episodes:
            path = meta.root / meta.get_video_file_path(episode, camera)
            if path.is_file():
                row = meta.episodes[episode]
                start = row[f"videos/{camera}/from_timestamp"]
                times = [start + step / meta.fps for step in range(row["length"])]
                yield episode, decode_video_frames(path, times, 0.5 / meta.fps, "pyav", return_uint8=True)

    def _images(self, camera: str, episodes: Collection[int]) -> Iterator[tuple[int, Tensor]]:
        for path in sorted((self._meta.root / "data").glob("*/*.parquet")):
            table = pq.read_table(path, columns=["episode_index", camera])
            for episode in (each for each in table["episode_index"].unique().to_pylist() if each in episodes):
                images = table.filter(pc.equal(table["episode_index"], episode))[camera].to_pylist()
                frames = [np.asarray(Image.open(BytesIO(image["bytes"])).convert("RGB")) for image in images]
                yield episode, torch.from_numpy(np.stack(frames)).permute(0, 3, 1, 2)
