# SPDX-License-Identifier: Apache-2.0
"""The texts that a dataset gives to an episode beside its task: wordings and a sentence to translate.

They stand in LeRobot's column `language_persistent`, the same on each frame of an episode, and the stock data
loader leaves that column out of its batches: so they are read once, from the dataset's files.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pyarrow.compute as pc
import pyarrow.parquet as pq

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

COLUMN = "language_persistent"


@dataclass(frozen=True)
class EpisodeTexts:
    """Texts of one episode.

    Attributes:
        wordings: Accepted wordings of the task (LeRobot's style `task_aug`).
        sentence: English sentence to translate (style `translation`, role `user`), or None.
        translation: The same sentence in German (style `translation`, role `assistant`), or None.
    """

    wordings: tuple[str, ...] = ()
    sentence: str | None = None
    translation: str | None = None


def read_texts(meta: "LeRobotDatasetMetadata") -> dict[int, EpisodeTexts]:
    """Read the texts of all episodes whose data files are on this machine, by episode index."""
    if COLUMN not in meta.features:
        return {}
    texts = {}
    for path in sorted((meta.root / "data").glob("*/*.parquet")):
        table = pq.read_table(path, columns=["episode_index", "frame_index", COLUMN])
        first_frames = table.filter(pc.equal(table["frame_index"], 0))
        for episode, rows in zip(
            first_frames["episode_index"].to_pylist(), first_frames[COLUMN].to_pylist(), strict=True
        ):
            texts[episode] = _sort_rows(rows or [])
    return texts


def _sort_rows(rows: list[dict[str, Any]]) -> EpisodeTexts:
    said: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row["content"]:
            said.setdefault((row["style"], row["role"]), []).append(row["content"])
    return EpisodeTexts(
        wordings=tuple(said.get(("task_aug", "user"), ())),
        sentence=next(iter(said.get(("translation", "user"), ())), None),
        translation=next(iter(said.get(("translation", "assistant"), ())), None),
    )
