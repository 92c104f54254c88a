# SPDX-License-Identifier: Apache-2.0
"""Replay every demonstration of the original release: python benchmarks/replay.py [--objects=clant].

Needs the release's folder in OWLXT5_CLANT_DIR. Prints the outcomes of all replays and, for each action, how
far the object moved, in centimetres, and how many degrees off the intended direction.
"""

import time
from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np
from release import release_folder
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from clant_claeo.demonstrations import from_release
from clant_claeo.release import read_release
from lerobot_owlxt5.command_line import command
from nico_tabletop.objects import read_objects
from nico_tabletop.replay import replay
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import TabletopSimulation


@dataclass
class ReplayConfig:
    """What to replay with.

    Args:
        objects: Set of objects.
    """

    objects: str = "clant"


@command("replay")
def main(config: ReplayConfig) -> None:
    """Replay, judge and report."""
    release = read_release(release_folder())
    simulation = TabletopSimulation(read_objects(config.objects))
    outcomes: dict[str, Counter[Outcome]] = defaultdict(Counter)
    motions: dict[str, list[tuple[float, float]]] = defaultdict(list)
    began = time.perf_counter()
    for demonstration in tqdm(list(from_release(release, config.objects)), unit="episode"):
        action = demonstration.action
        simulation.reset(demonstration.arrangement)
        start = simulation.object_positions()
        outcomes[action.name][replay(simulation, action, demonstration.joints)] += 1
        motion = (simulation.object_positions() - start)[action.slot, :2]
        distance = float(np.linalg.norm(motion))
        angle = np.rad2deg(np.arccos(np.clip(motion @ np.array(action.verb.direction) / distance, -1, 1)))
        motions[action.name].append((100 * distance, float(angle)))
    seconds = time.perf_counter() - began
    table = Table(title=f"Replays of the release on {config.objects}")
    for heading in ("action", *Outcome, "cm, least", "cm, most", "degrees, most"):
        table.add_column(str(heading), justify="left" if heading == "action" else "right")
    for name, count in outcomes.items():
        distances, angles = zip(*motions[name], strict=True)
        numbers = f"{min(distances):.1f}", f"{max(distances):.1f}", f"{max(angles):.0f}"
        table.add_row(name, *(str(count[outcome]) for outcome in Outcome), *numbers)
    console = Console()
    console.print(table)
    total: Counter[Outcome] = sum(outcomes.values(), Counter())
    console.print(f"{total[Outcome.PERFECT]} of {total.total()} perfect; {seconds:.0f} s, no rendering")


if __name__ == "__main__":
    main()
