# SPDX-License-Identifier: Apache-2.0
"""Draws conditions under which an episode can start: no hand is in an object, nor touches one."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np

from .objects import read_objects
from .placement import Pose
from .robot import JOINT_NAMES
from .scene import build_model, resting_place
from .tasks import SLOTS
from .variation import Conditions, Variation

_CLEAR = 0.003
"""Least distance of hands and objects, metres; on the slots the hands rest 12 mm from them."""
_TRIES = 200


class CrowdedError(ValueError):
    """Hands and objects are so close to each other that no start without contact was found."""


@cache
def _cubes() -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The robot and three cubes, which feel what is closer than `_CLEAR`; all objects are such cubes."""
    model = build_model(read_objects("clant")[: len(SLOTS)])
    model.geom_margin[:] = _CLEAR
    return model, mujoco.MjData(model)


def hands_are_clear(poses: Sequence[Pose], conditions: Conditions) -> bool:
    """Whether no part of the robot is closer than 3 mm to an object when an episode starts.

    Args:
        poses: Where the three objects are placed.
        conditions: Which say how far off these poses they stand, and where the arms are.
    """
    model, data = _cubes()
    names = [item.name for item in read_objects("clant")[: len(SLOTS)]]
    for name, pose in zip(names, conditions.shifted(poses), strict=True):
        data.joint(name).qpos[:] = resting_place(pose)
    joints = [model.joint(name).qposadr[0] for name in JOINT_NAMES]
    data.qpos[joints] = np.deg2rad(conditions.start_pose_deg)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_collision(model, data)
    near = data.contact.geom[data.contact.dist < _CLEAR]
    objects = np.isin(model.geom_bodyid[near], [model.body(name).id for name in names])
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
