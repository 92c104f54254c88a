# SPDX-License-Identifier: Apache-2.0
"""Examines eyes on the suites' first frames: do they find what is there, and nothing that is not?"""

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from lerobot.utils.constants import OBS_IMAGES
from numpy.typing import NDArray

from lerobot_owlxt5.backbones.zero_shot import ZeroShotDetector
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import find_placement
from nico_tabletop.robot import EYES
from nico_tabletop.scene import TABLE_HEIGHT
from nico_tabletop.simulation import TabletopSimulation

CAMERA = f"{OBS_IMAGES}.{EYES}"
CLOSE = 0.02
"""A centre counts as right within this distance on the table, metres."""
_MIDDLE = 0.03  # height above the table at which pixels are taken to the table, metres


@dataclass(frozen=True)
class Grade:
    """What came out.

    Attributes:
        named: How many objects were asked for that are there.
        found: Share of them that were found within `CLOSE`.
        absent: How many objects were asked for that are not there.
        rejected: Share of them of which the eyes said so.
        missed: Counts of the objects that were not found, by name asked.
        dreamt: Counts of the objects that were found though absent, by name asked.
    """

    named: int
    found: float
    absent: int
    rejected: float
    missed: dict[str, int]
    dreamt: dict[str, int]


def examine(
    eyes: str,
    suite: str,
    placement: str,
    scenes: int,
    *,
    among: Sequence[str] | None = None,
    size: tuple[int, int] = (240, 320),
    seed: int = 0,
) -> Grade:
    """Ask for each object of a set by name and by synonym, in scenes with three of them.

    Args:
        eyes: Folder or Hub id of an OWLv2.
        suite: Set of objects.
        placement: `slots` or `free`.
        scenes: How many.
        among: Only these objects; all of the set by default.
        size: Height and width of the pictures.
        seed: Of arrangements and places.
    """
    detector = ZeroShotDetector(eyes, None, None, CAMERA)
    objects = [item for item in read_objects(suite) if among is None or item.name in among]
    simulation = TabletopSimulation(tuple(objects))
    random = np.random.default_rng(seed)
    asked = {name: item.name for item in objects for name in (item.name, *item.synonyms)}
    counts, missed, dreamt = (
        defaultdict[str, int](int),
        defaultdict[str, int](int),
        defaultdict[str, int](int),
    )
    for arrangement in _arrangements([item.name for item in objects], random, scenes):
        simulation.reset(arrangement, find_placement(placement)(random))
        picture = torch.from_numpy(simulation.render(EYES, *size).copy()).permute(2, 0, 1)[None]
        found = detector({CAMERA: picture}, [[*asked]])
        truth = dict(zip(arrangement, simulation.object_boxes(size[1] / size[0]), strict=True))
        for (name, meant), centre, score in zip(asked.items(), found.centre[0], found.score[0], strict=True):
            seen = bool(score >= detector.threshold)
            if meant in truth:
                box = truth[meant]
                middle = (box[:2] + box[2:]) / 2
                places = [_on_table(simulation, point, size) for point in (np.asarray(centre), middle)]
                right = seen and float(np.linalg.norm(places[0] - places[1])) <= CLOSE
                counts["named"] += 1
                counts["found"] += right
                missed[name] += not right
            else:
                counts["absent"] += 1
                counts["rejected"] += not seen
                dreamt[name] += seen
    simulation.close()
    return Grade(
        counts["named"],
        counts["found"] / max(counts["named"], 1),
        counts["absent"],
        counts["rejected"] / max(counts["absent"], 1),
        {name: count for name, count in missed.items() if count},
        {name: count for name, count in dreamt.items() if count},
    )


def _arrangements(names: Sequence[str], random: np.random.Generator, count: int) -> Iterator[tuple[str, ...]]:
    for _ in range(count):
        yield tuple(random.choice(np.array(names), 3, replace=False).tolist())


def _on_table(
    simulation: TabletopSimulation, point: NDArray[np.floating], size: tuple[int, int]
) -> NDArray[np.float64]:
    """Where a point of the picture, shares of its width and height, lies just above the table, metres."""
    camera = simulation.data.camera(EYES)
    half = np.tan(np.deg2rad(simulation.model.camera(EYES).fovy[0]) / 2)
    x, y = (2 * np.asarray(point, dtype=np.float64) - 1) * [half * size[1] / size[0], -half]
    ray = camera.xmat.reshape(3, 3) @ np.array([x, y, -1.0])
    distance = (TABLE_HEIGHT + _MIDDLE - camera.xpos[2]) / ray[2]
    return (camera.xpos + distance * ray)[:2]
