# SPDX-License-Identifier: Apache-2.0
"""The dataset card: what lies in the folder, told to a person, with an image made from its frames."""

import json
import shlex
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from huggingface_hub import DatasetCard, DatasetCardData
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.language import LANGUAGE_EVENTS, LANGUAGE_PERSISTENT
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE
from PIL import Image

from nico_tabletop.robot import EYES, JOINT_NAMES

from .takes import OBJECTS

_PACKAGES = ("lerobot_policy_owlxt5", "lerobot", "mujoco")
_TEMPLATE = Path(__file__).with_name("card_template.md")
_RELEASE_PAGE = "https://github.com/samsoneko/CrossT5"
_RECORD = Path("meta/build.json")
_PREVIEW = "preview.jpg"
_PREVIEW_WIDTH = 240  # pixels, of one frame in the image
_PREVIEW_FRAMES = 4  # of an episode
_PREVIEW_GAP = 4  # pixels

_TEXTS = {
    f"{OBS_IMAGES}.{EYES}": "image between the eyes",
    OBS_STATE: "joint angles in degrees, row t of the trajectory",
    ACTION: "joint targets in degrees, row t + 1; the last row is held once",
    OBJECTS: "**ground truth**: for the objects on the left, middle and right slot the box x0, y0, x1, y1 as "
    "fractions of width and height (-1: out of view), and the name, 24 bytes UTF-8",
    "timestamp": "seconds since the episode's start",
    "frame_index": "number of the frame in its episode",
    "episode_index": "number of the episode",
    "index": "number of the frame in the dataset",
    "task_index": "number of the task; LeRobot returns its text as `task`, such as `slide-to-left red`",
    LANGUAGE_PERSISTENT: "LeRobot's language column, see below",
    LANGUAGE_EVENTS: "LeRobot's other language column; empty",
}


@dataclass(frozen=True)
class Build:
    """How a dataset was made; stored with it, so that its card can be written again under another name.

    Attributes:
        objects: What its episodes show: name of a shipped set, or a YAML file with `path/to` for its folders.
        placement: Where its objects stand: `slots`, `free` or `mixed`.
        release: Made from the original release, which states no licence; from a script of our own otherwise.
        command: The command that makes it, without any path of the machine that it ran on.
        versions: The packages that made it, such as `mujoco 4.0.0`.
        variation: How much its scenes may differ from the paper's setting: `Variation.options`.
        follow_ups: Share of the demonstrations that follow another movement.
    """

    objects: str
    placement: str
    release: bool
    command: str
    versions: str = ", ".join(f"{name} {version(name)}" for name in _PACKAGES)
    variation: dict[str, Any] = field(default_factory=dict)
    follow_ups: float = 0.0

    @property
    def name(self) -> str:
        """What the dataset is called: by its objects."""
        return Path(self.objects).stem

    @property
    def environment(self) -> str:
        """Options of `lerobot-eval` for an environment with the same objects, places and variation."""
        own_type = self.objects in ("clant", "claeo")
        options = {"env.type": self.objects if own_type else "clant"}
        if not own_type:
            options["env.objects"] = self.objects
        if self.placement != "slots":
            options["env.placement"] = self.placement
        options |= {f"env.variation.{name}": value for name, value in self.variation.items()}
        return shlex.join(as_words(options))


def as_words(options: Mapping[str, Any]) -> list[str]:
    """Options of a command, as they are typed: `--name=value`, with `true` and `false`."""
    return [
        f"--{name}={str(value).lower() if isinstance(value, bool) else value}"
        for name, value in options.items()
    ]


def read_build(root: Path) -> Build | None:
    """How the dataset in `root` was made; None if nothing there tells.

    Raises:
        ValueError: If what tells is of another version.
    """
    record = root / _RECORD
    if not record.exists():
        return None
    try:
        return Build(**json.loads(record.read_text(encoding="utf-8")))
    except (TypeError, ValueError):
        raise ValueError(
            f"{record} is of another version of owlxt5-dataset: build the dataset again, in another --root"
        ) from None


def write_card(root: Path, repo_id: str, build: Build) -> None:
    """Write `README.md`, its image and the record of the build into a complete dataset.

    Args:
        root: The dataset's folder.
        repo_id: Its name on the Hub, which the card's examples load.
        build: How it was made.
    """
    (root / _RECORD).write_text(json.dumps(asdict(build), indent=4) + "\n", encoding="utf-8")
    meta = LeRobotDatasetMetadata(repo_id, root=root)
    # One episode of each verb; an episode is named by the first word of its task.
    tasks = [episode["tasks"][0] for episode in meta.episodes]
    shown = {task.split()[0]: index for index, task in reversed(list(enumerate(tasks)))}
    episodes = sorted(shown.values())
    dataset = LeRobotDataset(repo_id, root=root, episodes=episodes, video_backend="pyav")
    _preview(dataset, episodes).save(root / _PREVIEW, quality=85)
    height, width, _ = meta.features[f"{OBS_IMAGES}.{EYES}"]["shape"]
    card = DatasetCard.from_template(
        DatasetCardData(
            license="other" if build.release else "apache-2.0",
            license_name="not-stated-by-its-authors" if build.release else None,
            license_link=_RELEASE_PAGE if build.release else None,
            pretty_name=build.name.upper(),
            language=["en", "de"],
            task_categories=["robotics"],
            tags=["LeRobot", "NICO", "humanoid", "simulation", "vision-language-action"],
            configs=[{"config_name": "default", "data_files": "data/*/*.parquet"}],
        ),
        template_str=_TEMPLATE.read_text(encoding="utf-8"),  # by its path, it is read as the locale says
        title=build.name.upper(),
        repo_id=repo_id,
        shell_repo_id=shlex.quote(repo_id),
        training=train_command(meta),
        stand_ins=build.objects != "clant",
        environment=build.environment,
        release=build.release,
        variation=build.variation,
        follow_ups=build.follow_ups,
        command=build.command,
        versions=build.versions,
        episodes=meta.total_episodes,
        frames=meta.total_frames,
        fps=meta.fps,
        width=width,
        height=height,
        objects=", ".join(sorted({task.split(maxsplit=1)[1] for task in tasks})),
        shown=[tasks[index] for index in episodes],
        columns=[(name, _type(feature), _TEXTS[name]) for name, feature in meta.features.items()],
        joints=JOINT_NAMES,
        rows=sorted(dataset.hf_dataset[0][LANGUAGE_PERSISTENT], key=_reading_order),
        splits=_splits(meta),
        train_episodes=_train_episodes(meta),
    )
    card.save(root / "README.md")


def train_command(meta: LeRobotDatasetMetadata, root: Path | None = None) -> str | None:
    """The command that trains on the training split alone; None for a part that has nothing of it.

    Args:
        meta: The dataset.
        root: Its folder, unless it is found by its name.
    """
    episodes = _train_episodes(meta)
    if episodes is None:
        return None
    words = ["lerobot-train", "--policy.type=owlxt5", "--policy.push_to_hub=false"]
    words.append(f"--dataset.repo_id={meta.repo_id}")
    if root is not None:
        words.append(f"--dataset.root={root}")
    return f"{shlex.join(words)} {episodes}"


def _train_episodes(meta: LeRobotDatasetMetadata) -> str | None:
    """The option of `lerobot-train` that chooses the training split."""
    bounds = [(first, last) for name, first, last in _splits(meta) if name == "train"]
    return f'--dataset.episodes="[$(seq -s, {bounds[0][0]} {bounds[0][1]})]"' if bounds else None


def _reading_order(row: dict[str, Any]) -> tuple[int, bool]:
    """What is commanded first, what comes of it last; a sentence before its translation."""
    return ("task_aug", "translation", "scene").index(row["style"]), row["role"] == "assistant"


def _type(feature: dict[str, Any]) -> str:
    shape = "" if feature["shape"] in ((1,), [1]) else f" ({', '.join(map(str, feature['shape']))})"
    return f"{feature['dtype']}{shape}"


def _splits(meta: LeRobotDatasetMetadata) -> list[tuple[str, int, int]]:
    """Name, first and last episode of each split."""
    bounds = [(name, *map(int, part.split(":"))) for name, part in (meta.info.splits or {}).items()]
    return [(name, start, end - 1) for name, start, end in bounds]


def _preview(dataset: LeRobotDataset, episodes: list[int]) -> Image.Image:
    """A row of frames for each of the episodes, which are all that `dataset` holds."""
    height, width, _ = dataset.features[f"{OBS_IMAGES}.{EYES}"]["shape"]
    size = (_PREVIEW_WIDTH, round(_PREVIEW_WIDTH * height / width))
    step_x, step_y = (side + _PREVIEW_GAP for side in size)
    canvas = (step_x * _PREVIEW_FRAMES - _PREVIEW_GAP, step_y * len(episodes) - _PREVIEW_GAP)
    strip = Image.new("RGB", canvas, "white")
    start = 0
    for row, index in enumerate(episodes):
        length = dataset.meta.episodes[index]["length"]
        for column, step in enumerate(np.linspace(0, length - 1, _PREVIEW_FRAMES).round().astype(int)):
            frame = dataset[int(start + step)][f"{OBS_IMAGES}.{EYES}"]
            image = Image.fromarray((frame.permute(1, 2, 0).numpy() * 255).round().astype(np.uint8))
            strip.paste(image.resize(size, Image.Resampling.LANCZOS), (column * step_x, row * step_y))
        start += length
    return strip
