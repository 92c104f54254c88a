# SPDX-License-Identifier: Apache-2.0
"""Evaluates a detector on the suites' first frames: does it find what is there, and nothing that is not?"""

from collections import Counter
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
class DetectionMetrics:
    """How often a detector is right.

    Attributes:
        present: How many objects were asked for that are there.
        recall: Share of them that were found within `CLOSE`.
        absent: How many objects were asked for that are not there.
        true_negative_rate: Share of them that were not found.
        false_negatives: Counts of the objects that were there and not found, by name asked.
        false_positives: Counts of the objects that were found though absent, by name asked.
    """

    present: int
    recall: float
    absent: int
    true_negative_rate: float
    false_negatives: dict[str, int]
    false_positives: dict[str, int]


def evaluate_detector(
    name: str,
    suite: str,
    placement: str,
    scenes: int,
    *,
    among: Sequence[str] | None = None,
    size: tuple[int, int] = (240, 320),
    seed: int = 0,
) -> DetectionMetrics:
    """Ask for each object of a set by name and by synonym, in scenes with three of them.

    Args:
        name: Folder or Hub id of an OWLv2, or `embedded`.
        suite: Set of objects.
        placement: `slots` or `free`.
        scenes: How many.
        among: Only these objects; all of the set by default.
        size: Height and width of the images, pixels.
        seed: Of arrangements and places.
    """
    detector = ZeroShotDetector(name, None, None, CAMERA)
    objects = [item for item in read_objects(suite) if among is None or item.name in among]
    simulation = TabletopSimulation(tuple(objects))
    rng = np.random.default_rng(seed)
    asked = {name: item.name for item in objects for name in (item.name, *item.synonyms)}
    counts, false_negatives, false_positives = Counter[str](), Counter[str](), Counter[str]()
    for arrangement in _arrangements([item.name for item in objects], rng, scenes):
        simulation.reset(arrangement, find_placement(placement)(rng))
        image = torch.from_numpy(simulation.render(EYES, *size).copy()).permute(2, 0, 1)[None]
        found = detector({CAMERA: image}, [[*asked]])
        truth = dict(zip(arrangement, simulation.object_boxes(size[1] / size[0]), strict=True))
        for (query, meant), centre, score in zip(asked.items(), found.centre[0], found.score[0], strict=True):
            seen = bool(score >= detector.threshold)
            if meant in truth:
                box = truth[meant]
                middle = (box[:2] + box[2:]) / 2
                right = seen and distance_on_table(simulation, np.asarray(centre), middle, size) <= CLOSE
                counts["present"] += 1
                counts["found"] += right
                false_negatives[query] += not right
            else:
                counts["absent"] += 1
                counts["rejected"] += not seen
                false_positives[query] += seen
    simulation.close()
    return DetectionMetrics(
        counts["present"],
        counts["found"] / max(counts["present"], 1),
        counts["absent"],
        counts["rejected"] / max(counts["absent"], 1),
        dict(+false_negatives),  # without zeros
        dict(+false_positives),
    )


def _arrangements(names: Sequence[str], rng: np.random.Generator, count: int) -> Iterator[tuple[str, ...]]:
    for _ in range(count):
        yield tuple(rng.choice(np.array(names), 3, replace=False).tolist())


def distance_on_table(
    simulation: TabletopSimulation,
    one: NDArray[np.floating],
    other: NDArray[np.floating],
    size: tuple[int, int],
) -> float:
    """How far apart two points of the eyes' image lie, just above the table, metres.

    Args:
        simulation: Whose eyes see the image.
        one: (2,), shares of the image's width and height.
        other: The same.
        size: Height and width of the image, pixels.
    """
    places = [_on_table(simulation, point, size) for point in (one, other)]
    return float(np.linalg.norm(places[0] - places[1]))


def _on_table(
    simulation: TabletopSimulation, point: NDArray[np.floating], size: tuple[int, int]
) -> NDArray[np.float64]:
    """Where a point of the image, shares of its width and height, lies just above the table, metres."""
    camera = simulation.data.camera(EYES)
    half = np.tan(np.deg2rad(simulation.model.camera(EYES).fovy[0]) / 2)
    x, y = (2 * np.asarray(point, dtype=np.float64) - 1) * [half * size[1] / size[0], -half]
    ray = camera.xmat.reshape(3, 3) @ np.array([x, y, -1.0])
    distance = (TABLE_HEIGHT + _MIDDLE - camera.xpos[2]) / ray[2]
    return (camera.xpos + distance * ray)[:2]
