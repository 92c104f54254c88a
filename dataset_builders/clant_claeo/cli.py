# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-dataset`: make CLANT or CLAEO as a LeRobotDataset."""

import os
import sys
from dataclasses import dataclass
from pathlib import Path

import av
import datasets
import draccus
from lerobot.utils.constants import HF_LEROBOT_HOME
from rich.console import Console

from nico_tabletop.objects import SUITES
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import TabletopSimulation

from .builder import build_dataset
from .demonstrations import Demonstration, from_release, scripted
from .release import ReleaseError, read_release


@dataclass
class DatasetConfig:
    """Make CLANT (coloured cubes) or CLAEO (everyday objects) as a LeRobotDataset with camera frames."""

    # `clant` or `claeo`.
    suite: str = "clant"
    # The folder CLANT of the original release, or `scripted` for the built-in expert (needs no download).
    source: str = "scripted"
    # Where the scripted expert's objects stand: `slots`, or `free`: anywhere in reach, at any yaw.
    placement: str = "slots"
    # Seed of the free placement.
    seed: int = 0
    # Name on the Hub; `local/<suite>` when unset.
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


def _demonstrations(config: DatasetConfig) -> list[Demonstration]:
    if config.source == "scripted":
        found = list(scripted(config.suite, config.placement, config.seed))
    elif config.placement != "slots":
        raise ValueError("the release's trajectories fit its slots: --placement=free needs --source=scripted")
    else:
        found = list(from_release(read_release(config.source), config.suite))
    if config.arrangements is None:
        return found
    known = list(dict.fromkeys(demonstration.arrangement for demonstration in found))
    if not 1 <= config.arrangements <= len(known):
        raise ValueError(f"--arrangements must lie between 1 and {len(known)}; got {config.arrangements}")
    # The release's split repeats every four arrangements, so an even step could leave an action without any
    # training episode. Steps of 31 spread over all colours and over both splits.
    chosen = {known[31 * k % len(known)] for k in range(config.arrangements)}
    return [demonstration for demonstration in found if demonstration.arrangement in chosen]


@draccus.wrap()
def _make(config: DatasetConfig) -> None:
    console = Console()
    if config.suite not in SUITES:
        raise ValueError(f"--suite must be one of {', '.join(SUITES)}; got {config.suite!r}")
    repo_id = config.repo_id or f"local/{config.suite}"
    root = config.root or HF_LEROBOT_HOME / repo_id
    demonstrations = _demonstrations(config)
    kind = "the scripted expert" if config.source == "scripted" else "the original release"
    console.print(f"{len(demonstrations)} demonstrations of {kind} on {config.suite}")
    outcomes = build_dataset(
        demonstrations,
        TabletopSimulation(SUITES[config.suite]),
        repo_id,
        root,
        height=config.height,
        width=config.width,
        video=config.video,
        # The release is kept whole; a script that failed demonstrates nothing.
        keep_failures=config.source != "scripted",
    )
    console.print("Replays: " + ", ".join(f"{count} {outcome}" for outcome, count in outcomes.items()))
    if config.source == "scripted":
        rejected = outcomes[Outcome.FAILURE]
        console.print(f"Rejected and not written: {rejected} of {len(demonstrations)} demonstrations")
    console.print(f"Data set: {root}", soft_wrap=True)
    command = f"lerobot-train --policy.type=owlxt5 --policy.push_to_hub=false --dataset.repo_id={repo_id}"
    console.print(f"Next: {command} --dataset.root={root}", soft_wrap=True)


def main() -> None:
    """Entry point; an error that the user can mend ends in one message and exit status 1."""
    # One progress bar is enough: the encoder, the muxer and the data set library each report every episode.
    os.environ.setdefault("SVT_LOG", "1")
    av.logging.set_level(av.logging.ERROR)
    datasets.disable_progress_bars()
    try:
        _make()
    except (ReleaseError, FileExistsError, ModuleNotFoundError, ValueError) as error:
        sys.exit(f"owlxt5-dataset: {error}")


if __name__ == "__main__":
    main()
