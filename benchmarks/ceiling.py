# SPDX-License-Identifier: Apache-2.0
"""How far exact movements get that know one point of a box: python benchmarks/ceiling.py [--scenes=720].

Learns from cubes where on the table an object stands whose box has its centre, or its foot, at a place in the
image, and lets the scripted expert act on CLAEO's objects where it takes them to be. Boxes are the
simulator's **ground truth**, places are free, nothing is rendered. What is missing to 100 % is what the point
does not tell the expert: a guide for policies on the same input, not a bound.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from torch import Tensor
from tqdm import tqdm

from clant_claeo.expert import plan
from lerobot_owlxt5.backbones.detections import Detections
from lerobot_owlxt5.command_line import command
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import OutOfReachError, Pose, draw_poses
from nico_tabletop.replay import replay
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import ACTIONS, arrangements

Array = NDArray[np.float64]
ASPECT = 4 / 3
CUBE_SCENES = 400
# NICO's camera, see `--policy.nadir`.
NADIR = 1.086
POINTS: dict[str, Callable[[Detections], Tensor]] = {
    "centre": lambda found: found.centre,
    "foot, no nadir": lambda found: found.foot(None),
    "foot": lambda found: found.foot(NADIR),
}
NEARER, AIMED, TRUE_PLACE, ALL = 0.01, "foot, aimed 1 cm nearer", "the true place", "all objects"


@dataclass
class CeilingConfig:
    """In which scenes to act.

    Args:
        scenes: How many, the twelve actions in turn.
        seed: Of the cubes' and the objects' places.
    """

    scenes: int = 720
    seed: int = 1


def _seen(boxes: Sequence[Array]) -> Detections:
    return Detections(torch.from_numpy(np.array(boxes))[None], torch.ones(1, len(boxes)))


def _terms(points: Tensor) -> Array:
    """Polynomial of the third degree in the (1, points, 2) x and y, (points, 10): smooth as a projection."""
    x, y = points[0].numpy().T
    return np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)


def _fit(simulation: TabletopSimulation, seed: int) -> dict[str, Array]:
    """Coefficients from each kind of point to (x, y) on the table."""
    random, names = np.random.default_rng((seed, 0)), tuple(simulation.objects)[:3]
    boxes, places = list[Array](), list[tuple[float, float]]()
    for _ in range(CUBE_SCENES):
        poses = draw_poses(random)
        simulation.reset(names, poses)
        boxes += [*simulation.object_boxes(ASPECT)]
        places += [(pose.x, pose.y) for pose in poses]
    return {
        kind: np.linalg.lstsq(_terms(point(_seen(boxes))), np.array(places))[0]
        for kind, point in POINTS.items()
    }


@command("ceiling")
def main(config: CeilingConfig) -> None:
    """Fit, act, count."""
    coefficients = _fit(TabletopSimulation(read_objects("clant")), config.seed)
    simulation = TabletopSimulation(read_objects("claeo"))
    choices = arrangements(tuple(simulation.objects))
    counts: dict[tuple[str, str], Counter[str]] = defaultdict(Counter)
    for number in tqdm(range(config.scenes), unit="scene"):
        random = np.random.default_rng((config.seed, 1, number))
        poses, names = draw_poses(random), choices[random.integers(len(choices))]
        action = ACTIONS[number % len(ACTIONS)]
        simulation.reset(names, poses)
        box = simulation.object_boxes(ASPECT)[action.slot]
        believed = {TRUE_PLACE: poses[action.slot]}
        for kind, point in POINTS.items():
            [(x, y)] = _terms(point(_seen([box]))) @ coefficients[kind]
            believed[kind] = Pose(x, y)
        believed[AIMED] = Pose(believed["foot"].x - NEARER, believed["foot"].y)
        for kind, pose in believed.items():
            simulation.reset(names, poses)
            try:
                movement = plan(action, [pose if k == action.slot else each for k, each in enumerate(poses)])
                outcome = str(replay(simulation, action, movement))
            except OutOfReachError:
                outcome = str(Outcome.FAILURE)
            for group in (names[action.slot], ALL):
                counts[kind, group][outcome] += 1
    table = Table(
        title=f"Perfect on freely placed CLAEO objects, exact movements, ground truth, seed {config.seed}"
    )
    groups = [*simulation.objects, ALL]
    for heading in ("what is known", *groups):
        table.add_column(heading)
    for kind in (*POINTS, AIMED, TRUE_PLACE):
        cells = (counts[kind, group] for group in groups)
        table.add_row(kind, *(f"{cell[Outcome.PERFECT]} of {cell.total()}" for cell in cells))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
