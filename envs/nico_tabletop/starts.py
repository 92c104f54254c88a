# SPDX-License-Identifier: Apache-2.0
"""Draws conditions under which an episode can start: no hand is in an object, nor touches one."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from .clearance import Clearance
from .placement import Pose
from .variation import Conditions, Variation

_CLEAR = 0.003
"""Least distance of hands and objects, metres; on the slots the hands rest 12 mm from them."""
_TRIES = 200


class CrowdedError(ValueError):
    """Hands and objects are so close to each other that no start without contact was found."""


@cache
def _clearance() -> Clearance:
    return Clearance(_CLEAR)


def hands_are_clear(poses: Sequence[Pose], conditions: Conditions) -> bool:
    """Whether no part of the robot is closer than 3 mm to an object when an episode starts.

    Args:
        poses: Where the three objects are placed.
        conditions: Which say how far off these poses they stand, and where the arms are.
    """
    clearance = _clearance()
    model = clearance.model
    near = clearance.near(conditions.shifted(poses), conditions.start_pose_deg)
    objects = np.isin(model.geom_bodyid[near], clearance.cubes)
    table = near == model.geom("table").id
    return not (objects.any(axis=1) & ~table.any(axis=1)).any()


def draw_conditions(variation: Variation, poses: Sequence[Pose], random: np.random.Generator) -> Conditions:
    """Draw conditions; again, if a hand would touch an object at the start or in the initial pose.

    The initial pose counts too, since a resting arm goes there. Objects that touch each other are drawn again
    as well.

    Args:
        variation: How far they may differ from the paper's setting.
        poses: Where the three objects are placed.
        random: Draws them.

    Raises:
        CrowdedError: If such conditions are not found in 200 draws.
    """
    conditions = variation.draw(random)
    if not (variation.arms_deg or variation.shift_cm):
        return conditions
    # Some places at the near end of the region are within 3 mm of a resting hand, and do not touch it.
    rests_clear = hands_are_clear(poses, Conditions())
    for _ in range(_TRIES):
        resting = replace(conditions, arms_deg=Conditions().arms_deg)
        if hands_are_clear(poses, conditions) and (not rests_clear or hands_are_clear(poses, resting)):
            return conditions
        conditions = variation.draw(random)
    raise CrowdedError(
        "no start was found in which hands and objects are apart: lower variation.arms_deg or "
        "variation.shift_cm, or give the objects other poses"
    )
