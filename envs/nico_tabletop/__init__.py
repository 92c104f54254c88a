# SPDX-License-Identifier: Apache-2.0
"""NICO at a table with three objects: MuJoCo world, scoring, Gymnasium and LeRobot environments.

Importing it registers the Gymnasium environments `nico_tabletop/Clant-v0` and `nico_tabletop/Claeo-v0`.

Example:
    env = gymnasium.make("nico_tabletop/Clant-v0", action="PUSH-L")
    observation, info = env.reset(seed=0)
"""

import gymnasium

from . import drawing  # noqa: F401  before MuJoCo is imported, which looks only once how to draw
from .env import TabletopEnv

__all__ = ["TabletopEnv"]

for _objects in ("clant", "claeo"):
    gymnasium.register(
        f"nico_tabletop/{_objects.capitalize()}-v0",
        "nico_tabletop.env:TabletopEnv",  # by name, so that the specification can be saved as JSON
        kwargs={"objects": _objects},
    )
