# SPDX-License-Identifier: Apache-2.0
"""The detector's training images on disk: a Parquet file for each few worlds, complete or not there."""

import io
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import datasets
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from tqdm import tqdm

from builder_tools.workers import Workers

from .scenes import IMAGES_OF_A_WORLD, RandomScenes

_WORLDS_IN_A_FILE = 10
_JPEG_QUALITY = 92
FEATURES = datasets.Features(
    {
        "image": datasets.Image(),
        "objects": [
            {
                "names": [datasets.Value("string")],
                "colours": [datasets.Value("string")],
                "box": [datasets.Value("float32")],
            }
        ],
    }
)


def make_images(folder: Path, count: int, seed: int, workers: int) -> datasets.Dataset:
    """Render at least `count` images, or those of them that are missing, and open them."""
    folder.mkdir(parents=True, exist_ok=True)
    worlds = range(-(-count // IMAGES_OF_A_WORLD))
    jobs = [
        (worlds[start : start + _WORLDS_IN_A_FILE], folder / f"{start:05d}.parquet")
        for start in worlds[::_WORLDS_IN_A_FILE]
    ]
    missing = [job for job in jobs if not job[1].exists()]
    with Workers(min(workers, max(len(missing), 1))) as crew:
        done = crew.run(partial(_make_file, seed), missing)
        for _ in tqdm(done, total=len(missing), desc="Rendering scenes", unit="file"):
            pass
    return datasets.Dataset.from_parquet(
        [str(path) for _, path in jobs], features=FEATURES, cache_dir=str(folder / "cache")
    )


def _make_file(seed: int, job: tuple[range, Path]) -> None:
    worlds, path = job
    rows = [row for world in worlds for row in _images(np.random.default_rng((seed, world)))]
    for row in rows:
        row["image"] = _compressed(row["image"])
    draft = path.with_suffix(".draft")
    datasets.Dataset.from_list(rows, features=FEATURES).to_parquet(draft)
    draft.rename(path)


def _compressed(image: NDArray[np.uint8]) -> dict[str, bytes]:
    """A JPEG: small, and a camera's images have its flaws too."""
    file = io.BytesIO()
    Image.fromarray(image).save(file, "JPEG", quality=_JPEG_QUALITY)
    return {"bytes": file.getvalue()}


def _images(rng: np.random.Generator) -> Iterator[dict[str, Any]]:
    world = RandomScenes(rng)
    try:
        yield from world.images()
    finally:
        world.close()
