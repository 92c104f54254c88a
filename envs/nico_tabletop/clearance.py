# SPDX-License-Identifier: Apache-2.0
"""What is close to what: the robot and three objects, as geometry alone."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from .objects import read_objects
from .placement import Pose
from .robot import JOINT_NAMES
from .scene import build_model, resting_place
from .tasks import SLOTS


class Clearance:
    """The robot and three cubes that feel what is closer than a margin; all objects are such cubes.

    Attributes:
        model: With the cubes.
        cubes: Ids of their bodies: on the left, in the middle, on the right.
    """

    def __init__(self, margin: float) -> None:
        """Build the scene; `margin` is in metres."""
        items = read_objects("clant")[: len(SLOTS)]
        names = [item.name for item in items]
        self.model = build_model(items)
        self.model.geom_margin[:] = margin
        self.cubes = [self.model.body(name).id for name in names]
        self._margin = margin
        self._data = mujoco.MjData(self.model)
        self._places = [self._data.joint(name).qpos for name in names]
        self._joints = [self.model.joint(name).qposadr[0] for name in JOINT_NAMES]

    def near(self, poses: Sequence[Pose], angles: NDArray[np.float64]) -> NDArray[np.int32]:
        """What is closer to each other than the margin.

        Args:
            poses: Where the three objects stand.
            angles: Of `robot.JOINT_NAMES`, shape (10,), degrees.

        Returns:
            Pairs of geoms, their ids, shape (pairs, 2).
        """
        for place, pose in zip(self._places, poses, strict=True):
            place[:] = resting_place(pose)
        self._data.qpos[self._joints] = np.deg2rad(angles)
        mujoco.mj_kinematics(self.model, self._data)
        mujoco.mj_collision(self.model, self._data)
        # Whether the margins of two geoms add up depends on MuJoCo's version.
        pairs: NDArray[np.int32] = self._data.contact.geom[self._data.contact.dist < self._margin]
        return pairs
