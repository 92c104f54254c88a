# SPDX-License-Identifier: Apache-2.0
"""Speed of the dataset builder with the scripted expert: python benchmarks/build.py [--arrangements=4].

Builds 12 episodes for each arrangement at 240 x 320, with one worker and with two. Then replays twelve
episodes in this process to say what the time of one core goes into. On a machine that does other work
too, trust the processor time (user and system, of all processes), not the wall time.
"""

import resource
import shutil
import subprocess
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow.parquet as pq
from lerobot.datasets.compute_stats import RunningQuantileStats
from rich.console import Console
from rich.table import Table

from builder_tools.workers import quiet
from clant_claeo import builder, takes
from clant_claeo.demonstrations import scripted
from lerobot_owlxt5.command_line import command
from nico_tabletop.objects import read_objects
from nico_tabletop.simulation import TabletopSimulation

HEIGHT, WIDTH = 240, 320


@dataclass
class BuildSpeedConfig:
    """What to build.

    Args:
        arrangements: How many arrangements; each makes twelve episodes.
    """

    arrangements: int = 4


def _timed(spent: dict[str, float], owner: Any, method: str, part: str) -> None:
    """Count the processor time that the calling thread spends in a method."""
    original: Callable[..., Any] = getattr(owner, method)

    def measured(*args: Any, **kwargs: Any) -> Any:
        began = time.thread_time()
        try:
            return original(*args, **kwargs)
        finally:
            spent[part] += time.thread_time() - began

    setattr(owner, method, measured)


def _split(folder: Path) -> tuple[dict[str, float], int]:
    """Seconds of one core for each part of the work, and the frames made."""
    spent: dict[str, float] = defaultdict(float)
    demonstrations = list(scripted("clant"))[:12]
    options = {"keep_failures": True, "height": HEIGHT, "width": WIDTH, "video": True}
    studio = takes.Studio(folder / "warm", read_objects("clant"), **options)  # type: ignore[arg-type]
    takes.make_take(studio, (0, demonstrations[0]))
    _timed(spent, TabletopSimulation, "step", "physics")
    _timed(spent, TabletopSimulation, "object_boxes", "boxes")
    _timed(spent, TabletopSimulation, "segmented_boxes", "boxes")
    _timed(spent, TabletopSimulation, "render", "rendering")
    _timed(spent, RunningQuantileStats, "update", "statistics of the images")
    _timed(spent, builder, "_join_takes", "joining")
    main, all_threads = time.thread_time(), time.process_time()
    builder.build_dataset(
        demonstrations, read_objects("clant"), "local/split", folder / "split", recipe={}, **options
    )
    main, all_threads = time.thread_time() - main, time.process_time() - all_threads
    # All threads but this one encode, and compute the statistics of the images.
    spent["encoding"] = all_threads - main - spent["statistics of the images"]
    spent["the rest of LeRobot"] = all_threads - sum(spent.values())
    return spent, sum(len(demonstration.joints) for demonstration in demonstrations)


def _build(root: Path, arrangements: int, workers: int) -> tuple[float, float, int]:
    """Wall seconds, processor seconds and frames of the command in processes of its own."""
    size = (f"--height={HEIGHT}", f"--width={WIDTH}")
    command = ["owlxt5-dataset", f"--root={root}", f"--arrangements={arrangements}", *size]
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([*command, f"--workers={workers}"], check=True, stdout=subprocess.DEVNULL)
    wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    frames = sum(pq.read_metadata(path).num_rows for path in (root / "data").glob("*/*.parquet"))
    return wall, cpu, frames


@command("build")
def main(config: BuildSpeedConfig) -> None:
    """Measure and print."""
    console = Console()
    quiet()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        speeds = Table(
            title=f"{12 * config.arrangements} episodes at {HEIGHT} x {WIDTH}, with start-up and joining"
        )
        for heading in ("workers", "wall s", "processor s", "frames/s (wall)", "frames/s of a core"):
            speeds.add_column(heading, justify="right")
        walls = {}
        for workers in (1, 2):
            wall, cpu, frames = _build(folder / str(workers), config.arrangements, workers)
            walls[workers] = wall
            numbers = wall, cpu, frames / wall, frames / cpu
            speeds.add_row(str(workers), *(f"{number:.1f}" for number in numbers))
            shutil.rmtree(folder / str(workers))
        console.print(speeds)
        console.print(f"Two workers are {walls[1] / walls[2]:.2f} times as fast as one.")
        spent, frames = _split(folder)
        table = Table(title="What the time of one core goes into, without start-up")
        for heading in ("part", "ms a frame", "%"):
            table.add_column(heading, justify="left" if heading == "part" else "right")
        total = sum(spent.values())
        for part, seconds in sorted(spent.items(), key=lambda item: -item[1]):
            table.add_row(part, f"{1000 * seconds / frames:.2f}", f"{100 * seconds / total:.0f}")
        console.print(table)
        console.print(f"{frames / total:.1f} frames/s of a core")


if __name__ == "__main__":
    main()
