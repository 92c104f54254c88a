# SPDX-License-Identifier: Apache-2.0
"""All frames of a data set's camera, one episode after the other."""

from collections.abc import Iterator
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

# LeRobot's own default tolerance for the time of a frame, in seconds.
TOLERANCE = 1e-4


def read_episodes(meta: "LeRobotDatasetMetadata", camera: str) -> Iterator[tuple[int, Tensor]]:
    """Read the episodes whose files are on this machine.

    A video is decoded from an episode's first frame to its last, with PyAV, which every LeRobot has; the data
    loader, which draws frames at random, opens and searches it for each of them.

    Args:
        meta: The data set.
        camera: Key of an image feature, stored as video or as images.

    Yields:
        Index of an episode, and its frames (length, 3, height, width), uint8.
    """
    return _read_videos(meta, camera) if camera in meta.video_keys else _read_images(meta, camera)


def _read_videos(meta: "LeRobotDatasetMetadata", camera: str) -> Iterator[tuple[int, Tensor]]:
    for episode in range(meta.total_episodes):
        path = meta.root / meta.get_video_file_path(episode, camera)
        if path.is_file():
            row = meta.episodes[episode]
            start = row[f"videos/{camera}/from_timestamp"]
            times = [start + step / meta.fps for step in range(row["length"])]
            yield episode, decode_video_frames(path, times, TOLERANCE, "pyav", return_uint8=True)


def _read_images(meta: "LeRobotDatasetMetadata", camera: str) -> Iterator[tuple[int, Tensor]]:
    for path in sorted((meta.root / "data").glob("*/*.parquet")):
        table = pq.read_table(path, columns=["episode_index", camera])
        for episode in table["episode_index"].unique().to_pylist():
            images = table.filter(pc.equal(table["episode_index"], episode))[camera].to_pylist()
            frames = [np.asarray(Image.open(BytesIO(image["bytes"])).convert("RGB")) for image in images]
            yield episode, torch.from_numpy(np.stack(frames)).permute(0, 3, 1, 2)
