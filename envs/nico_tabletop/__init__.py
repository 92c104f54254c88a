# SPDX-License-Identifier: Apache-2.0
"""NICO at a table with three objects: MuJoCo world, scoring, Gymnasium and LeRobot environments.

Importing it registers the Gymnasium environments `nico_tabletop/Clant-v0` and `nico_tabletop/Claeo-v0`.

Example:
    env = gymnasium.make("nico_tabletop/Clant-v0", action="PUSH-L")
    observation, info = env.reset(seed=0)
"""

import os
import sys

# Without a screen MuJoCo draws nothing unless told how, and it looks only once, when it is imported.
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "egl")

import gymnasium

from .env import TabletopEnv

__all__ = ["TabletopEnv"]

for _objects in ("clant", "claeo"):
    gymnasium.register(
        f"nico_tabletop/{_objects.capitalize()}-v0",
        "nico_tabletop.env:TabletopEnv",  # by name, so that the specification can be saved as JSON
        kwargs={"objects": _objects},
    )
