# SPDX-License-Identifier: Apache-2.0
"""Compare every value of a dataset with the original release.

    python benchmarks/exactness.py --dataset_root=data/clant [--objects=clant]

Needs the release's folder in OWLXT5_CLANT_DIR. Exit status 1 if any episode differs; the first ten are named.
"""

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
from release import release_folder

from clant_claeo.demonstrations import Demonstration, from_release
from clant_claeo.release import read_release
from lerobot_owlxt5.command_line import command
from nico_tabletop.env import NAME_BYTES
from nico_tabletop.tasks import SLOTS


@dataclass
class ExactnessConfig:
    """What to compare.

    Args:
        dataset_root: Folder of a LeRobotDataset made from the release.
        objects: Set of objects that it was made with.
    """

    dataset_root: Path
    objects: str = "clant"


def _differences(
    frames: dict[str, list[Any]], task: str, split: str, demonstration: Demonstration
) -> list[str]:
    """What an episode has otherwise than its demonstration."""
    joints = demonstration.joints.astype(np.float32)
    language = frames["language_persistent"][0]
    said: dict[str, list[str]] = {"task_aug": [], "translation": [], "scene": []}
    for row in sorted(language, key=lambda row: row["role"] == "assistant"):  # the English sentence first
        said[row["style"]].append(row["content"])
    words = (
        np.array(frames["observation.objects"][0]).reshape(len(SLOTS), -1)[:, -NAME_BYTES:].astype(np.uint8)
    )
    names = tuple(bytes(word).rstrip(b"\0").decode() for word in words)
    count = len(joints)
    checks = {
        "state": np.array_equal(np.array(frames["observation.state"], np.float32), joints),
        "action": np.array_equal(
            np.array(frames["action"], np.float32), np.concatenate([joints[1:], joints[-1:]])
        ),
        "time": np.array_equal(frames["timestamp"], (np.arange(count) / 10).astype(np.float32)),
        "frame_index": frames["frame_index"] == list(range(count)),
        "task": task == demonstration.task,
        "wordings": said["task_aug"] == list(demonstration.wordings),
        "translation": said["translation"] == list(demonstration.translation),
        "objects": names == demonstration.arrangement,
        "split": split == demonstration.split,
        "language on each frame": all(every == language for every in frames["language_persistent"]),
    }
    return [name for name, equal in checks.items() if not equal]


@command("exactness")
def main(config: ExactnessConfig) -> None:
    """Compare and report."""
    root = config.dataset_root
    due = {
        (demonstration.task, demonstration.arrangement): demonstration
        for demonstration in from_release(read_release(release_folder()), config.objects)
    }
    info = json.loads((root / "meta/info.json").read_text(encoding="utf-8"))
    splits = {name: range(*map(int, span.split(":"))) for name, span in info["splits"].items()}
    tasks = pd.read_parquet(root / "meta/tasks.parquet").reset_index().set_index("task_index")["task"]
    compared, wrong = 0, []
    for path in sorted((root / "data").glob("*/*.parquet")):
        file = pq.ParquetFile(path)
        for group in range(file.num_row_groups):  # one per episode
            frames = file.read_row_group(group).to_pydict()
            [episode], [task_index] = set(frames["episode_index"]), set(frames["task_index"])
            scene = next(row for row in frames["language_persistent"][0] if row["style"] == "scene")
            arrangement = tuple(json.loads(scene["content"])["objects"].values())
            split = next(name for name, episodes in splits.items() if episode in episodes)
            demonstration = due.pop((tasks[task_index], arrangement), None)
            compared += 1
            if demonstration is None:
                wrong.append(f"episode {episode}: no such sample in the release, or a second time")
            elif differing := _differences(frames, tasks[task_index], split, demonstration):
                wrong.append(f"episode {episode}: {', '.join(differing)}")
    print(*wrong[:10], sep="\n", end="\n" if wrong else "")
    print(
        f"{compared - len(wrong)} of {compared} episodes equal the release; {len(due)} samples are not here"
    )
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
