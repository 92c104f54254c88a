# SPDX-License-Identifier: Apache-2.0
"""One demonstration, replayed before NICO's eyes: a take is a LeRobotDataset of one episode and its facts.

A take appears under its name only when it is complete, so a build that was killed goes on after the last one.
"""

import json
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import av
import numpy as np
from lerobot.configs.video import RGBEncoderConfig
from lerobot.datasets import LeRobotDataset
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE
from numpy.typing import NDArray

from builder_tools.workers import draw_in_one_thread
from nico_tabletop.env import DESCRIPTION_SIZE, describe_objects
from nico_tabletop.objects import TabletopObject
from nico_tabletop.placement import OutOfReachError
from nico_tabletop.replay import replay
from nico_tabletop.robot import EYES, JOINT_NAMES
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import CONTROL_HZ, TabletopSimulation
from nico_tabletop.tasks import SLOTS

from .demonstrations import Demonstration
from .follow_up import begin
from .release import Split

OBJECTS = "observation.objects"
"""Ground truth about the objects, see `nico_tabletop.env.describe_objects`."""

_ENCODER = RGBEncoderConfig(vcodec="h264", preset="ultrafast", crf=25, g=2, extra_options={"bf": 0})
"""Nearly as good as LeRobot's own choice, AV1, and as small, in a fifteenth of the time, and decoded in half;
every browser shows it. Without B-frames, since LeRobot joins videos without encoding them anew
(docs/datasets.md has the figures)."""

_FACTS = "take.json"
_PARTIAL = ".partial"
_DIGITS = 5  # of a take's number


@dataclass(frozen=True)
class Studio:
    """How takes are made, the same for all of a dataset.

    Attributes:
        folder: Where takes are put.
        objects: What the world has; the demonstrations name some of them.
        height: Rows of the images.
        width: Columns of the images.
        video: Store frames as video; as single images otherwise.
        keep_failures: Also record replays that fail.
    """

    folder: Path
    objects: tuple[TabletopObject, ...]
    height: int
    width: int
    video: bool
    keep_failures: bool

    def take(self, index: int) -> Path:
        """Folder of a complete take."""
        return self.folder / f"{index:0{_DIGITS}d}"


@dataclass(frozen=True)
class Take:
    """The facts of a complete take.

    Attributes:
        dataset: A LeRobotDataset of one episode; None if the replay failed and was not kept.
        frames: How many frames were recorded.
        split: `train` or `test`.
        outcome: What the replay did.
        language: Rows for LeRobot's column `language_persistent`.
    """

    dataset: Path | None
    frames: int
    split: Split
    outcome: Outcome
    language: list[dict[str, Any]]


def read_take(folder: Path) -> Take:
    """Read the facts of a complete take."""
    facts = json.loads((folder / _FACTS).read_text(encoding="utf-8"))
    dataset = folder / "dataset"
    return Take(dataset if dataset.exists() else None, **facts | {"outcome": Outcome(facts["outcome"])})


def complete_takes(folder: Path) -> Iterator[Path]:
    """Folders of the takes that are complete."""
    return folder.glob("[0-9]" * _DIGITS)


def unfinished_takes(folder: Path) -> Iterator[int]:
    """Indices of the takes that a process has begun and not completed."""
    return (int(path.stem) for path in sorted(folder.glob(f"*{_PARTIAL}")))


def remove_unfinished(folder: Path) -> None:
    """Clear away what a killed process left."""
    for path in folder.glob(f"*{_PARTIAL}"):
        shutil.rmtree(path)


def _features(height: int, width: int, video: bool) -> dict[str, dict[str, Any]]:
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
        OBJECTS: {"dtype": "float32", "shape": (DESCRIPTION_SIZE,), "names": None},
    }


@lru_cache(maxsize=1)
def _simulation(objects: tuple[TabletopObject, ...]) -> TabletopSimulation:
    """One world, and one GL context, per process."""
    draw_in_one_thread()
    return TabletopSimulation(objects)


def make_take(studio: Studio, numbered: tuple[int, Demonstration]) -> int:
    """Replay one demonstration and record it under its number; the count of recorded frames."""
    index, demonstration = numbered
    partial = studio.take(index).with_suffix(_PARTIAL)
    partial.mkdir(parents=True)
    take = _record(studio, demonstration, partial / "dataset")
    facts = {key: value for key, value in asdict(take).items() if key != "dataset"}
    (partial / _FACTS).write_text(json.dumps(facts, ensure_ascii=False), encoding="utf-8")
    partial.rename(studio.take(index))
    return take.frames


def _record(studio: Studio, demonstration: Demonstration, folder: Path) -> Take:
    simulation = _simulation(studio.objects)
    height, width = studio.height, studio.width
    try:
        demonstration = begin(simulation, demonstration)
        joints = demonstration.joints
    except OutOfReachError:
        return Take(None, 0, demonstration.split, Outcome.FAILURE, [])
    dataset = LeRobotDataset.create(
        "local/take",
        fps=CONTROL_HZ,
        features=_features(height, width, studio.video),
        root=folder,
        robot_type="nico",
        use_videos=studio.video,
        # Only for reading; asked for its own choice, LeRobot would look for FFmpeg's libraries at each take.
        video_backend="pyav",
        rgb_encoder=_ENCODER,
        streaming_encoding=studio.video,
        encoder_threads=1,  # other takes use the other cores
        encoder_queue_maxsize=len(joints),  # LeRobot drops frames that do not fit
        image_writer_threads=0 if studio.video else 2,
    )
    targets = np.concatenate([joints[1:], joints[-1:]])
    boxes: dict[str, dict[str, list[float]]] = {}

    def record_frame(step: int) -> None:
        projected = simulation.object_boxes(width / height)
        dataset.add_frame(
            {
                f"{OBS_IMAGES}.{EYES}": simulation.render(EYES, height, width),
                OBS_STATE: joints[step].astype(np.float32),
                ACTION: targets[step].astype(np.float32),
                OBJECTS: describe_objects(projected, simulation.arrangement),
                "task": demonstration.task,
            }
        )
        if when := {0: "first", len(joints) - 1: "last"}.get(step):
            boxes[when] = _named(simulation, simulation.segmented_boxes(EYES, height, width))

    simulation.reset(demonstration.arrangement, demonstration.poses, demonstration.conditions)
    outcome = replay(simulation, demonstration.action, joints, record_frame)
    if outcome is Outcome.FAILURE and not studio.keep_failures:
        dataset.clear_episode_buffer()
        dataset.finalize()
        shutil.rmtree(folder)
        return Take(None, 0, demonstration.split, outcome, [])
    dataset.save_episode()
    dataset.finalize()
    check_videos(folder, len(joints))
    return Take(
        folder, len(joints), demonstration.split, outcome, _language_rows(demonstration, outcome, boxes)
    )


def check_videos(folder: Path, frames: int) -> None:
    """Check that a take's videos are whole: LeRobot only logs it if its encoder loses frames.

    Args:
        folder: Of the take.
        frames: How many each video should have.

    Raises:
        OSError: Naming the video that has fewer or more.
    """
    for path in folder.glob("videos/**/*.mp4"):
        with av.open(str(path)) as video:
            if (written := video.streams.video[0].frames) != frames:
                raise OSError(f"{path} has {written} frames instead of {frames}")


def _rounded(values: Iterable[float]) -> list[float]:
    return [round(value, 4) for value in values]


def _named(simulation: TabletopSimulation, boxes: NDArray[np.float64]) -> dict[str, list[float]]:
    return {name: _rounded(box.tolist()) for name, box in zip(simulation.arrangement, boxes, strict=True)}


def _language_rows(
    demonstration: Demonstration, outcome: Outcome, boxes: dict[str, dict[str, list[float]]]
) -> list[dict[str, Any]]:
    """The episode's rows for LeRobot's column `language_persistent`.

    LeRobot decodes all rows with every frame of an action window, so the facts share one row.
    """
    scene = {
        "objects": dict(zip(SLOTS, demonstration.arrangement, strict=True)),
        "poses": dict(zip(SLOTS, (_rounded(pose) for pose in demonstration.poses), strict=True)),
        "boxes": boxes,
        "outcome": str(outcome),
        "split": demonstration.split,
    }
    if conditions := demonstration.conditions.facts():
        scene["conditions"] = conditions
    if demonstration.before:
        scene["before"] = demonstration.before.name
    rows = [("user", "task_aug", wording) for wording in demonstration.wordings]
    english, german = demonstration.translation
    rows += [("user", "translation", english), ("assistant", "translation", german)]
    rows.append(("user", "scene", json.dumps(scene, ensure_ascii=False)))
    return [{"role": role, "style": style, "content": text, "timestamp": 0.0} for role, style, text in rows]
