# SPDX-License-Identifier: Apache-2.0
"""The MuJoCo model of the world: NICO, the table, the light, and all objects of a set."""

from pathlib import Path
from typing import cast
from xml.etree.ElementTree import Element, parse, tostring

import mujoco
import numpy as np

from .objects import CUBE_HALF_WIDTH, TabletopObject, add_object
from .placement import Pose
from .robot import NICO_XML

SCENE_XML = Path(__file__).with_name("assets") / "scene.xml"
"""NICO, the table, lights and cameras as MJCF, without objects."""
TABLE_HEIGHT = 0.4891
"""Height of the table's surface in that file, metres."""
SPECTATOR = "spectator"
"""Camera that looks at robot and table from outside, for videos."""

_PARKING = (-4.0, -1.0)  # x and z where objects wait that are not part of the scene: under the floor


def build_model(objects: tuple[TabletopObject, ...]) -> mujoco.MjModel:
    """Compile the world with all of `objects` parked out of sight.

    Frame: x forward from the robot, y to its left, z up from the floor, metres. Each object is a free body
    of its own name; the servos are in the order of `robot.JOINT_NAMES` and take radians.
    """
    root = parse(SCENE_XML).getroot()
    asset, worldbody = (cast(Element, root.find(tag)) for tag in ("asset", "worldbody"))
    for item in objects:
        add_object(item, asset, worldbody)
    # Text has no folder that `<include file="nico.xml"/>` could be relative to.
    return mujoco.MjModel.from_xml_string(
        tostring(root, encoding="unicode"), {NICO_XML.name: NICO_XML.read_bytes()}
    )


def resting_place(pose: Pose) -> tuple[float, ...]:
    """Position (x, y, z), metres, and quaternion (w, x, y, z) of the body of an object at `pose`."""
    half = np.deg2rad(pose.yaw) / 2
    return pose.x, pose.y, TABLE_HEIGHT + CUBE_HALF_WIDTH, float(np.cos(half)), 0.0, 0.0, float(np.sin(half))


def parking_place(index: int) -> tuple[float, ...]:
    """Position and quaternion, as above, of the `index`-th object while it is not part of the scene."""
    row, place = divmod(index, 20)
    return _PARKING[0] - 0.3 * row, 0.3 * place, _PARKING[1], 1.0, 0.0, 0.0, 0.0
