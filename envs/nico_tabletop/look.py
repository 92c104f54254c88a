# SPDX-License-Identifier: Apache-2.0
"""How the world looks under given conditions: the eyes' camera, the lights and the table top."""

import mujoco
import numpy as np

from .robot import EYES
from .variation import Conditions

_TABLE, _PLAIN = "table", "plain"


class Look:
    """Changes what a model looks like; each change begins from how the model was at first."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._camera, self._table = model.camera(EYES).id, model.geom(_TABLE).id
        self._place = model.cam_pos[self._camera].copy()
        self._turn = model.cam_quat[self._camera].copy()
        headlight = model.vis.headlight
        lights = (
            model.light_ambient,
            model.light_diffuse,
            model.light_specular,
            headlight.ambient,
            headlight.diffuse,
            headlight.specular,
        )
        self._lights = [(light, light.copy()) for light in lights]
        self._top = model.geom_matid[self._table], model.geom_rgba[self._table].copy()

    def change(self, conditions: Conditions) -> None:
        """Make the model look as `conditions` say; what they leave alone looks as at first."""
        model = self._model
        offset, turn = np.empty(3), np.empty(4)
        mujoco.mju_rotVecQuat(offset, np.array(conditions.camera_cm) / 100, self._turn)
        model.cam_pos[self._camera] = self._place + offset
        mujoco.mju_euler2Quat(turn, np.deg2rad(conditions.camera_deg), "xyz")
        mujoco.mju_mulQuat(turn, self._turn, turn.copy())
        model.cam_quat[self._camera] = turn
        for light, at_first in self._lights:
            light[:] = at_first * conditions.light
        material, colour = self._top
        if conditions.table is not None:
            material, colour = model.material(_PLAIN).id, np.array([*conditions.table, 1.0])
        model.geom_matid[self._table], model.geom_rgba[self._table] = material, colour
