# SPDX-License-Identifier: Apache-2.0
"""Replays demonstrations before NICO's eyes and writes what it sees and does as a LeRobotDataset."""

import shutil
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from lerobot.annotations.steerable_pipeline.reader import iter_episodes
from lerobot.annotations.steerable_pipeline.staging import EpisodeStaging
from lerobot.annotations.steerable_pipeline.writer import LanguageColumnsWriter
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.io_utils import write_info
from lerobot.datasets.language import EXTENDED_STYLES, PERSISTENT_STYLES, language_feature_info
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE
from tqdm import tqdm

from nico_tabletop.env import EPISODE_STEPS, describe_objects
from nico_tabletop.placement import OutOfReachError
from nico_tabletop.robot import EYES, JOINT_NAMES
from nico_tabletop.scoring import Outcome, judge
from nico_tabletop.simulation import CONTROL_HZ, TabletopSimulation
from nico_tabletop.tasks import SLOTS

from .demonstrations import Demonstration

OBJECTS = "observation.objects"
"""Ground truth about the objects, see `nico_tabletop.env.describe_objects`."""

_OWN_STYLES = {"translation", "scene", "outcome"}
EXTENDED_STYLES.update(_OWN_STYLES)
PERSISTENT_STYLES.update(_OWN_STYLES)


def _features(height: int, width: int, video: bool, objects: int) -> dict[str, dict[str, Any]]:
    joints = {
        "dtype": "float32",
        "shape": (len(JOINT_NAMES),),
        "names": [f"{name}.pos" for name in JOINT_NAMES],
    }
    return {
        f"{OBS_IMAGES}.{EYES}": {
            "dtype": "video" if video else "image",
            "shape": (height, width, 3),
            "names": ["height", "width", "channels"],
        },
        OBS_STATE: joints,
        ACTION: joints,
        OBJECTS: {"dtype": "float32", "shape": (objects,), "names": None},
    }


def _replay(simulation: TabletopSimulation, demonstration: Demonstration, dataset: LeRobotDataset) -> Outcome:
    """Act one demonstration; each frame goes into the data set's episode buffer."""
    height, width, _ = dataset.features[f"{OBS_IMAGES}.{EYES}"]["shape"]
    joints = demonstration.joints
    simulation.reset(demonstration.arrangement, demonstration.poses)
    start = simulation.object_positions()
    targets = np.concatenate([joints[1:], joints[-1:]])
    for position, target in zip(joints, targets, strict=True):
        boxes = simulation.object_boxes(width / height)
        dataset.add_frame(
            {
                f"{OBS_IMAGES}.{EYES}": simulation.render(EYES, height, width),
                OBS_STATE: position.astype(np.float32),
                ACTION: target.astype(np.float32),
                OBJECTS: describe_objects(boxes, simulation.arrangement),
                "task": demonstration.task,
            }
        )
        simulation.step(target)
    for _ in range(EPISODE_STEPS - len(joints)):
        simulation.step(joints[-1])
    return judge(demonstration.action, start, simulation.object_positions())


def _language_rows(demonstration: Demonstration, outcome: Outcome) -> list[dict[str, Any]]:
    """The episode's rows for LeRobot's column `language_persistent`."""
    scene = ", ".join(f"{slot}: {name}" for slot, name in zip(SLOTS, demonstration.arrangement, strict=True))
    rows = [("user", "task_aug", wording) for wording in demonstration.wordings]
    if demonstration.translation:
        english, german = demonstration.translation
        rows += [("user", "translation", english), ("assistant", "translation", german)]
    rows += [("user", "scene", scene), ("user", "outcome", str(outcome))]
    return [{"role": role, "style": style, "content": text, "timestamp": 0.0} for role, style, text in rows]


def build_dataset(
    demonstrations: Sequence[Demonstration],
    simulation: TabletopSimulation,
    repo_id: str,
    root: Path,
    *,
    height: int,
    width: int,
    video: bool,
    keep_failures: bool,
) -> Counter[Outcome]:
    """Replay `demonstrations` and write them to `root`, train episodes first and test episodes last.

    The data set is made in a folder beside `root` and moved there when it is complete, so that `root` never
    holds half of one.

    Args:
        demonstrations: What to replay; at least one.
        simulation: The world with the objects that the demonstrations name.
        repo_id: The data set's name on the Hub, such as `me/clant`.
        root: Folder to make.
        height: Rows of the pictures.
        width: Columns of the pictures.
        video: Store frames as video; as single images (larger, faster to read at random) otherwise.
        keep_failures: Also write episodes whose replay fails.

    Returns:
        How many replays had which outcome.

    Raises:
        FileExistsError: If `root` exists.
    """
    if root.exists():
        raise FileExistsError(f"{root} exists already; remove it or choose another folder with --root")
    unfinished = root.with_name(f"{root.name}.unfinished")
    shutil.rmtree(unfinished, ignore_errors=True)
    objects = describe_objects(np.zeros((len(SLOTS), 4)), ("",) * len(SLOTS)).size
    dataset = LeRobotDataset.create(
        repo_id,
        fps=CONTROL_HZ,
        features=_features(height, width, video, objects),
        root=unfinished,
        robot_type="nico",
        use_videos=video,
        streaming_encoding=video,
        image_writer_threads=0 if video else 2,
    )
    outcomes: Counter[Outcome] = Counter()
    rows: list[list[dict[str, Any]]] = []
    splits: Counter[str] = Counter()
    in_order = sorted(demonstrations, key=lambda demonstration: demonstration.split == "test")
    for demonstration in tqdm(in_order, desc="Replaying", unit="episode"):
        try:
            outcome = _replay(simulation, demonstration, dataset)
        except OutOfReachError:  # raised before the first frame
            outcomes[Outcome.FAILURE] += 1
            continue
        outcomes[outcome] += 1
        if outcome is Outcome.FAILURE and not keep_failures:
            dataset.clear_episode_buffer()
            continue
        dataset.save_episode()
        rows.append(_language_rows(demonstration, outcome))
        splits[demonstration.split] += 1
    dataset.finalize()
    _write_language(unfinished, rows)
    meta = LeRobotDatasetMetadata(repo_id, root=unfinished)
    meta.info.features.update(language_feature_info())
    meta.info.splits = {"train": f"0:{splits['train']}", "test": f"{splits['train']}:{splits.total()}"}
    write_info(meta.info, unfinished)
    unfinished.rename(root)
    return outcomes


def _write_language(root: Path, rows: Sequence[list[dict[str, Any]]]) -> None:
    """Fill the language columns with LeRobot's own writer, which reads one staged file per episode."""
    with tempfile.TemporaryDirectory() as staging:
        for index, episode_rows in enumerate(rows):
            EpisodeStaging(Path(staging), index).write("plan", episode_rows)
        LanguageColumnsWriter().write_all(list(iter_episodes(root)), Path(staging), root)
