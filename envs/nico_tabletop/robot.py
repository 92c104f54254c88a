# SPDX-License-Identifier: Apache-2.0
"""NICO's upper body: its MJCF file, the ten joints that move, and the camera between its eyes."""

from functools import cache
from pathlib import Path
from xml.etree.ElementTree import parse

import numpy as np
from numpy.typing import NDArray

NICO_XML = Path(__file__).with_name("assets") / "nico.xml"
"""NICO's upper body as MJCF, made by `nico_mjcf`."""

_ARM = ("shoulder_z", "shoulder_y", "arm_x", "elbow_y", "wrist_z")
JOINT_NAMES: tuple[str, ...] = tuple(f"{side}_{joint}" for side in "rl" for joint in _ARM)
"""The ten controlled joints in CLANT's column order: the right arm, then the left."""

INITIAL_POSE_DEG: NDArray[np.float64] = np.array([0.0, -20, 0, -100, 0, 0, 20, 0, 100, 0])
"""First row of every CLANT sample, degrees: elbows back, forearms level over the table."""

EYES = "eyes"
"""Camera between NICO's eyes."""


@cache
def joint_limits_deg() -> NDArray[np.float64]:
    """Lower and upper limits of the ten joints, float64, shape (10, 2), degrees."""
    ranges = {joint.get("name"): joint.get("range", "") for joint in parse(NICO_XML).iter("joint")}
    return np.rad2deg([[float(limit) for limit in ranges[name].split()] for name in JOINT_NAMES])
