# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-dataset`: make CLANT or CLAEO as a LeRobotDataset."""

import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import draccus
from lerobot.utils.constants import HF_LEROBOT_HOME
from rich.console import Console

from nico_tabletop.objects import SUITES, read_objects

from .builder import BuildError, build_dataset
from .demonstrations import Demonstration, from_release, scripted
from .release import ReleaseError, read_release
from .workers import quiet, usable_cores

_FREE_TO_CHANGE = ("root", "repo_id", "workers")  # without any effect on the episodes


@dataclass
class DatasetConfig:
    """Make CLANT (coloured cubes) or CLAEO (everyday objects) as a LeRobotDataset with camera frames."""

    # `clant` or `claeo`.
    suite: str = "clant"
    # The folder CLANT of the original release, or `scripted` for the built-in expert (needs no download).
    source: str = "scripted"
    # Set of objects: a shipped one (`clant`, `claeo`, `household`) or a YAML file; unset: the suite's own.
    objects: str | None = None
    # Name on the Hub; `local/<suite>` when unset, or `local/<set of objects>`.
    repo_id: str | None = None
    # Folder to make; LeRobot's own place for `repo_id` when unset.
    root: Path | None = None
    # Take only so many of the 120 arrangements, spread over all objects, with all twelve actions each.
    arrangements: int | None = None
    # Rows and columns of the pictures.
    height: int = 480
    width: int = 640
    # Store frames as video (small); false: as single images (faster to read at random).
    video: bool = True
    # `i/n`: build only the i-th of n parts of the episodes, a data set of its own.
    shard: str | None = None
    # Parallel processes; as many as there are usable cores when unset.
    workers: int | None = None


def _demonstrations(config: DatasetConfig) -> list[Demonstration]:
    if config.source == "scripted":
        found = list(scripted(config.objects or config.suite))
    else:
        objects = read_objects(config.objects) if config.objects else None
        found = list(from_release(read_release(config.source), config.suite, objects))
    if config.arrangements is None:
        return found
    known = list(dict.fromkeys(demonstration.arrangement for demonstration in found))
    if not 1 <= config.arrangements <= len(known):
        raise ValueError(f"--arrangements must lie between 1 and {len(known)}; got {config.arrangements}")
    # The release's split repeats every four arrangements, so an even step could leave an action without any
    # training episode. Steps of 31 spread over all colours and over both splits.
    chosen = {known[31 * k % len(known)] for k in range(config.arrangements)}
    return [demonstration for demonstration in found if demonstration.arrangement in chosen]


def _shard(text: str | None) -> tuple[int, int]:
    if text is None:
        return 1, 1
    part, slash, parts = text.partition("/")
    if not (slash and part.isdecimal() and parts.isdecimal() and 1 <= int(part) <= int(parts)):
        raise ValueError(f"--shard must be i/n with i from 1 to n, such as 2/4; got {text!r}")
    return int(part), int(parts)


@draccus.wrap()
def _make(config: DatasetConfig) -> None:
    console = Console()
    if config.suite not in SUITES:
        raise ValueError(f"--suite must be one of {', '.join(SUITES)}; got {config.suite!r}")
    workers = usable_cores() if config.workers is None else config.workers
    if workers < 1:
        raise ValueError(f"--workers must be at least 1; got {workers}")
    shard = _shard(config.shard)
    objects = config.objects or config.suite
    name = Path(objects).stem
    repo_id = config.repo_id or f"local/{name}"
    root = config.root or HF_LEROBOT_HOME / repo_id
    demonstrations = _demonstrations(config)
    kind = "the scripted expert" if config.source == "scripted" else "the original release"
    console.print(f"{len(demonstrations)} demonstrations of {kind} on {name}")
    outcomes = build_dataset(
        demonstrations,
        read_objects(objects),
        repo_id,
        root,
        height=config.height,
        width=config.width,
        video=config.video,
        # The release is kept whole; a script that failed demonstrates nothing.
        keep_failures=config.source != "scripted",
        options={key: value for key, value in draccus.encode(config).items() if key not in _FREE_TO_CHANGE}
        | {"version": version("lerobot_policy_owlxt5")},
        shard=shard,
        workers=workers,
    )
    console.print("Replays: " + ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items()))
    console.print(f"Data set: {root}", soft_wrap=True)
    command = f"lerobot-train --policy.type=owlxt5 --policy.push_to_hub=false --dataset.repo_id={repo_id}"
    console.print(f"Next: {command} --dataset.root={root}", soft_wrap=True)


def main() -> None:
    """Entry point; an error that the user can mend ends in one message and exit status 1."""
    quiet()
    try:
        _make()
    except KeyboardInterrupt:
        print("\nowlxt5-dataset: interrupted; the same command goes on after the last complete episode")
        sys.exit(130)
    except (BuildError, ReleaseError, FileExistsError, ModuleNotFoundError, ValueError) as error:
        sys.exit(f"owlxt5-dataset: {error}")


if __name__ == "__main__":
    main()
