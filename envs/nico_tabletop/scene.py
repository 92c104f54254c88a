# SPDX-License-Identifier: Apache-2.0
"""The MuJoCo model of the world: NICO, the table, the light, and all objects of a set."""

from xml.etree.ElementTree import SubElement, fromstring, tostring

import mujoco
import numpy as np

from .mjcf import text
from .objects import CUBE_HALF_WIDTH, TabletopObject, add_object
from .placement import Pose
from .robot import add_robot

TABLE_HEIGHT = 0.4891
"""Height of the table's surface, metres."""
SPECTATOR = "spectator"
"""Camera that looks at robot and table from outside, for videos."""

_TABLE = (0.28, 0.42, 0.02)  # half widths
_PARKING = (-4.0, -1.0)  # x and z where objects wait that are not part of the scene: under the floor

_BASE = """
<mujoco model="nico_tabletop">
  <compiler angle="radian" autolimits="true" eulerseq="XYZ"/>
  <option timestep="0.002" integrator="implicitfast" cone="elliptic" impratio="5"/>
  <visual>
    <global offwidth="1920" offheight="1920"/>
    <headlight ambient="0.4 0.4 0.4" diffuse="0.35 0.35 0.35" specular="0.1 0.1 0.1"/>
    <quality shadowsize="512" offsamples="0" numslices="16" numstacks="8"/>
  </visual>
  <default>
    <default class="robot">
      <geom contype="0" conaffinity="0" density="0"/>
      <joint damping="2" armature="0.05"/>
      <position kp="400" kv="6"/>
    </default>
    <default class="hand">
      <geom contype="2" conaffinity="4" density="0" friction="0.7795 0.005 0.0001"/>
    </default>
    <default class="solid">
      <geom contype="4" conaffinity="15" friction="0.9854 0.005 0.0001" group="3"/>
    </default>
    <default class="seen">
      <geom contype="0" conaffinity="0" density="0"/>
    </default>
  </default>
  <asset>
    <texture name="sky" type="skybox" builtin="gradient" rgb1="0.86 0.88 0.9" rgb2="0.6 0.65 0.7"
             width="64" height="384"/>
    <texture name="wood" type="2d" builtin="flat" rgb1="0.72 0.6 0.46" mark="random" markrgb="0.66 0.54 0.4"
             random="0.35" width="256" height="256"/>
    <material name="wood" texture="wood" texrepeat="3 3" specular="0.1"/>
    <material name="shell" rgba="0.95 0.95 0.93 1" specular="0.4"/>
    <material name="grey" rgba="0.42 0.44 0.48 1" specular="0.3"/>
    <material name="mouth" rgba="0.85 0.25 0.25 1" emission="0.4"/>
    <material name="eye" rgba="1 1 1 1" specular="0.8"/>
    <material name="pupil" rgba="0.05 0.06 0.1 1" specular="0.9"/>
  </asset>
  <worldbody>
    <light pos="0.5 0.5 2.2" dir="-0.1 -0.25 -1" diffuse="0.45 0.45 0.45" castshadow="true"/>
    <light pos="0.2 -0.8 2" dir="0.05 0.4 -1" diffuse="0.25 0.25 0.25" castshadow="false"/>
    <geom name="floor" type="plane" size="6 6 0.1" rgba="0.62 0.64 0.66 1" contype="0" conaffinity="0"/>
  </worldbody>
  <actuator/>
</mujoco>
"""


def build_model(objects: tuple[TabletopObject, ...]) -> mujoco.MjModel:
    """Compile the world with all of `objects` parked out of sight.

    Frame: x forward from the robot, y to its left, z up from the floor, metres. Each object is a free body
    of its own name; the servos are in the order of `robot.JOINT_NAMES` and take radians.
    """
    root = fromstring(_BASE)
    asset, worldbody, actuator = (next(root.iter(tag)) for tag in ("asset", "worldbody", "actuator"))
    table = {"name": "table", "class": "solid", "type": "box", "material": "wood"}
    place = {"size": text(*_TABLE), "pos": text(0.42, 0, TABLE_HEIGHT - _TABLE[2])}
    SubElement(worldbody, "geom", table | place | {"contype": "8", "conaffinity": "4", "group": "0"})
    SubElement(
        worldbody,
        "camera",
        name=SPECTATOR,
        pos="1.2 -0.78 1.16",
        xyaxes="0.605 0.796 -0.000 -0.294 0.224 0.929",
        fovy="40",
    )
    add_robot(worldbody, actuator)
    for item in objects:
        add_object(item, asset, worldbody)
    return mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))


def resting_place(pose: Pose) -> tuple[float, ...]:
    """Position (x, y, z), metres, and quaternion (w, x, y, z) of the body of an object at `pose`."""
    half = np.deg2rad(pose.yaw) / 2
    return pose.x, pose.y, TABLE_HEIGHT + CUBE_HALF_WIDTH, float(np.cos(half)), 0.0, 0.0, float(np.sin(half))


def parking_place(index: int) -> tuple[float, ...]:
    """Position and quaternion, as above, of the `index`-th object while it is not part of the scene."""
    row, place = divmod(index, 20)
    return _PARKING[0] - 0.3 * row, 0.3 * place, _PARKING[1], 1.0, 0.0, 0.0, 0.0
