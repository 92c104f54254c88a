# SPDX-License-Identifier: Apache-2.0
"""The head as it is drawn.

It is turned in the drawing alone: the model, its joints, its cameras and the physics stay as they are.
"""

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

_NECK, _HEAD = "neck_11", "head_21"  # `nico_kinematics.json`: joint head_z moves the one, head_y the other
_UP, _LEFT = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])  # these joints' axes in the world


class DrawnHead:
    """Turns the head's shapes in a scene that is about to be drawn.

    Args:
        model: With NICO in it.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        self._geoms = {*np.flatnonzero(model.geom_bodyid == model.body(_HEAD).id).tolist()}

    def turn(self, scene: mujoco.MjvScene, data: mujoco.MjData, pose_deg: ArrayLike) -> None:
        """Turn the head out of its middle.

        Args:
            scene: As MuJoCo has just filled it.
            data: What it was filled from.
            pose_deg: Shape (2,), degrees, see `head.Head`.
        """
        yaw, pitch = np.asarray(pose_deg)
        turned, lowered = _rotation(_UP, yaw), _rotation(_LEFT, pitch)
        neck, head = data.body(_NECK).xpos, data.body(_HEAD).xpos
        for geom in scene.geoms[: scene.ngeom]:
            if geom.objtype == mujoco.mjtObj.mjOBJ_GEOM and geom.objid in self._geoms:
                geom.pos[:] = neck + turned @ (head + lowered @ (geom.pos - head) - neck)
                geom.mat[:] = turned @ lowered @ geom.mat


def _rotation(axis: NDArray[np.float64], angle_deg: float) -> NDArray[np.float64]:
    quaternion, matrix = np.empty(4), np.empty(9)
    mujoco.mju_axisAngle2Quat(quaternion, axis, np.deg2rad(angle_deg))
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)
