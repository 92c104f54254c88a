# SPDX-License-Identifier: Apache-2.0
"""Where the three objects stand: on CLANT's slots, or anywhere in a region in front of the robot.

The region is a trapezoid, `NEAREST` <= x <= `FARTHEST` and |y| <= `half_width(x)`. It is our decision, from
measurements: nearer, hands in their initial pose would touch an object; farther, pulls begin to tip objects
over, and then hands no longer get behind them; wider, the image's edge would cut the tallest one.
"""

from collections.abc import Callable
from itertools import combinations
from typing import NamedTuple

import numpy as np


class Pose(NamedTuple):
    """How an object stands on the table: x forward and y to the robot's left, metres; yaw in degrees."""

    x: float
    y: float
    yaw: float = 0.0


Poses = tuple[Pose, Pose, Pose]
"""Of the left, the middle and the right object."""

SLOT_POSES: Poses = (Pose(0.317, 0.1539), Pose(0.3468, 0.0024), Pose(0.3232, -0.1549))
"""CLANT's left, middle and right slot."""
NEAREST, FARTHEST = 0.317, 0.42
"""Ends of the region, metres; the nearest slot stands at its near end."""
CLEARANCE = 0.15
"""Least distance between the middles of two objects, metres: room for stroke and hand, as on the slots."""


class OutOfReachError(ValueError):
    """An object stands where NICO's arms cannot do what is asked."""


def half_width(x: float) -> float:
    """How far the region reaches to each side at `x`, metres."""
    return 0.04 + 0.4 * x


def draw_poses(random: np.random.Generator) -> Poses:
    """Draw three poses: uniform in the region and in yaw, all of them `CLEARANCE` apart.

    Returns:
        The poses from the robot's left to its right (falling y). Clearance and the region's depth keep
        neighbours 10.9 cm apart in y: it is plain which object is the left one.
    """
    while True:
        x = random.uniform(NEAREST, FARTHEST, 3)
        y = random.uniform(-1, 1, 3) * half_width(FARTHEST)
        yaw = random.uniform(-180, 180, 3)
        drawn = sorted(map(Pose, x.tolist(), y.tolist(), yaw.tolist()), key=lambda pose: pose.y)
        inside = all(abs(pose.y) <= half_width(pose.x) for pose in drawn)
        apart = all(np.hypot(a.x - b.x, a.y - b.y) >= CLEARANCE for a, b in combinations(drawn, 2))
        if inside and apart:
            right, middle, left = drawn
            return left, middle, right


def draw_mixed(random: np.random.Generator) -> Poses:
    """The slots in half of the draws, `draw_poses` in the others: to learn both."""
    return SLOT_POSES if random.random() < 0.5 else draw_poses(random)


PLACEMENTS: dict[str, Callable[[np.random.Generator], Poses]] = {
    "slots": lambda _: SLOT_POSES,
    "free": draw_poses,
    "mixed": draw_mixed,
}
"""Ways to place the objects of an episode."""


def find_placement(name: str) -> Callable[[np.random.Generator], Poses]:
    """The function that draws the poses of a placement.

    Raises:
        ValueError: If there is none of this name.
    """
    if name not in PLACEMENTS:
        raise ValueError(f"placement must be one of {', '.join(PLACEMENTS)}; got {name!r}")
    return PLACEMENTS[name]
