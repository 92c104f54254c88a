# SPDX-License-Identifier: Apache-2.0
"""Further objects on the table, in a strip behind the three that commands are about.

All numbers are our decision, from measurements. With objects on the slots, CLANT's movements bring no hand
and no object beyond x = 0.507 m; the nearest corner of a distractor is at 0.514 m. The scripted expert's
hands pass an object's middle by up to 8 cm. No start that `variation.arms_deg` draws has a hand down there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .placement import FARTHEST, SLOT_POSES, Pose
from .tasks import SLOTS

BEHIND = 0.2
"""Least distance in x from the farthest of the three objects to a distractor, middle to middle, metres."""
FARTHEST_DISTRACTOR = 0.66
"""Here the table ends, and the eyes just see a cube as a whole (x, metres)."""
HALF_WIDTH = 0.25
"""How far the strip reaches to each side (y, metres): the eyes see it as a whole in images of 4:3."""
APART = 0.09
"""Least distance of two distractors in y, metres: a cube's corner, or a mug's handle, touches no other."""
MOST = 1 + int(2 * HALF_WIDTH / APART)
"""So many distractors find room."""
_DEPTH = 0.03  # of the strip, metres: what stands nearer is seen higher up


class DistractorError(ValueError):
    """There is no room for distractors, or there are not enough objects."""


class Distractor(NamedTuple):
    """A further object: its name, and how it stands."""

    name: str
    pose: Pose


def check_distractors(count: int, objects: int, placement: str, shift_cm: float) -> None:
    """Check that distractors find room in every episode.

    Args:
        count: How many are wanted.
        objects: How many objects the set has.
        placement: See `placement.PLACEMENTS`.
        shift_cm: How far objects may stand off their places, see `variation.Variation`.

    Raises:
        DistractorError: If they do not, or if the set has not so many objects.
    """
    if not 0 <= count <= MOST:
        raise DistractorError(f"distractors must lie between 0 and {MOST}, as many as find room; got {count}")
    if count > (left := objects - len(SLOTS)):
        raise DistractorError(
            f"distractors={count} needs {count + len(SLOTS)} objects, but the set has {objects}: choose a "
            f"larger set or distractors={left}"
        )
    farthest = max(pose.x for pose in SLOT_POSES) if placement == "slots" else FARTHEST
    room_cm = 100 * (FARTHEST_DISTRACTOR - BEHIND - farthest)
    if count and shift_cm > room_cm + 1e-6:
        raise DistractorError(
            f"distractors find no room behind objects that variation.shift_cm={shift_cm:g} moves away: "
            f"with placement={placement}, lower it to {room_cm:.1f}"
        )


def draw_distractors(
    count: int, names: Sequence[str], poses: Sequence[Pose], random: np.random.Generator
) -> tuple[Distractor, ...]:
    """Draw which further objects stand on the table, and where: uniform in the strip and in yaw.

    Args:
        count: How many, up to `MOST`.
        names: The objects of the set that are not on the table, at least as many.
        poses: Of the three objects on the table.
        random: Draws them.

    Returns:
        From the robot's left to its right.

    Raises:
        DistractorError: If the three objects stand so far away that the table ends behind them.
    """
    if not count:
        return ()
    nearest = max(pose.x for pose in poses) + BEHIND
    if nearest > FARTHEST_DISTRACTOR + 1e-6:
        raise DistractorError(
            f"distractors find no room behind an object at x = {nearest - BEHIND:.3f}: it may stand at up to "
            f"{FARTHEST_DISTRACTOR - BEHIND:.3f} metres"
        )
    chosen = [str(name) for name in random.permutation(np.array(names))[:count]]
    x = random.uniform(nearest, max(nearest, min(nearest + _DEPTH, FARTHEST_DISTRACTOR)), count)
    # Sorted places in what the gaps leave, spread by the gaps: uniform over all places that are apart.
    free = 2 * HALF_WIDTH - (count - 1) * APART
    y = HALF_WIDTH - np.sort(random.uniform(0, free, count)) - APART * np.arange(count)
    yaw = random.uniform(-180, 180, count)
    places = map(Pose, x.tolist(), y.tolist(), yaw.tolist())
    return tuple(map(Distractor, chosen, places))
