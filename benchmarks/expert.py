# SPDX-License-Identifier: Apache-2.0
"""How often the scripted expert's plan is perfect: python benchmarks/expert.py [--objects=clant].

Acts in random free scenes, the twelve actions in turn, and once on the slots with each
action. A plan is made from the objects' poses alone and never tried out before it counts. No rendering.
"""

import time
from collections import Counter, defaultdict
from dataclasses import dataclass

import numpy as np
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from clant_claeo.expert import plan
from lerobot_owlxt5.command_line import command
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import SLOT_POSES, OutOfReachError, Poses, draw_poses
from nico_tabletop.replay import replay
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import ACTIONS, Action, arrangements

OUT_OF_REACH = "out of reach"


@dataclass
class ExpertConfig:
    """In which scenes to act.

    Args:
        objects: Set of objects.
        scenes: How many free scenes.
        seed: Of these scenes.
    """

    objects: str = "clant"
    scenes: int = 1000
    seed: int = 0


def attempt(simulation: TabletopSimulation, action: Action, names: tuple[str, ...], poses: Poses) -> str:
    """Outcome of the expert's plan, or that it found none."""
    try:
        joints = plan(action, poses)
    except OutOfReachError:
        return OUT_OF_REACH
    simulation.reset(names, poses)
    return replay(simulation, action, joints)


@command("expert")
def main(config: ExpertConfig) -> None:
    """Draw, plan, act, judge and report."""
    simulation = TabletopSimulation(read_objects(config.objects))
    choices = arrangements(tuple(simulation.objects))
    slots = Counter(attempt(simulation, action, choices[0], SLOT_POSES) for action in ACTIONS)
    free: dict[str, Counter[str]] = defaultdict(Counter)
    began = time.perf_counter()
    for number in tqdm(range(config.scenes), unit="scene"):
        random = np.random.default_rng((config.seed, number))
        poses, names = draw_poses(random), choices[random.integers(len(choices))]
        action = ACTIONS[number % len(ACTIONS)]
        free[action.name][attempt(simulation, action, names, poses)] += 1
    seconds = time.perf_counter() - began

    table = Table(title=f"The scripted expert on {config.objects}, seed {config.seed}")
    for heading in ("placement", "action", "scenes", *Outcome, OUT_OF_REACH):
        table.add_column(str(heading), justify="left" if heading in ("placement", "action") else "right")
    total = sum(free.values(), Counter())
    rows = [("free", *item) for item in free.items()] + [("free", "all", total), ("slots", "all", slots)]
    for placement, name, count in rows:
        cells = (str(count[outcome]) for outcome in (*Outcome, OUT_OF_REACH))
        table.add_row(placement, name, str(count.total()), *cells)
    console = Console()
    console.print(table)
    share = total[Outcome.PERFECT] / total.total()
    console.print(f"{share:.1%} of the free scenes perfect; {seconds / config.scenes:.2f} s a scene")


if __name__ == "__main__":
    main()
