# SPDX-License-Identifier: Apache-2.0
"""NICO at a table with three objects: MuJoCo world, scoring, Gymnasium and LeRobot environments."""

import os
import sys

# Without a screen MuJoCo draws nothing unless told how, and it looks only once, when it is imported.
if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
    os.environ.setdefault("MUJOCO_GL", "egl")
