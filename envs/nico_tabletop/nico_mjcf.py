# SPDX-License-Identifier: Apache-2.0
"""Makes `assets/nico.xml`, NICO's upper body, from its joint tree: `python -m nico_tabletop.nico_mjcf`.

Joint frames, axes, limits and masses are facts from the NICO project's published URDF, kept in
`nico_kinematics.json`; every shape is our own. Only CLANT's ten arm joints move: wrist tilt and head keep
the angles below, and the fingers are shapes of the palm.
"""

import json
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, cast
from xml.etree.ElementTree import Element, SubElement, fromstring, indent, tostring

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .mjcf import text
from .robot import EYES, JOINT_NAMES, NICO_XML

_GYRATION_RADIUS = 0.04  # metres; the URDF's masses with the inertia of a ball of this radius

HEAD_PITCH_DEG = 57.0
"""How far the head looks down (our decision: the whole workspace is in view)."""
WRIST_TILT_DEG = 10.19
"""Bend of the wrist joint that CLANT does not record, degrees.

This and the hand's shape below were found by search, together with the slots and the table of `scene`: with
them all twelve original trajectories are perfect; so are 118 of 120 replays with objects up to 2 mm off
and each joint off by a random 0.4 degrees (our decision).
"""
_FINGER_X = (-0.001837, -0.04819)  # index finger and ring finger, across the palm, metres
_FINGER_LENGTHS = (0.03185, 0.03579)  # of the two segments, metres
_FINGER_CURL_DEG = (10.6, 30.7)  # of each segment against the one before
_FINGER_RADIUS = 0.008649
_THUMB = ((-0.018, 0.012, -0.01), (-0.018, 0.040515, -0.025), (-0.018, 0.05402, -0.03111))


_HEADER = """<!-- SPDX-License-Identifier: Apache-2.0 -->
<!-- NICO's upper body. Made by `python -m nico_tabletop.nico_mjcf`: change that module, not this file. -->
"""

_BASE = """
<mujoco model="nico">
  <compiler angle="radian" autolimits="true" eulerseq="XYZ"/>
  <default>
    <default class="robot">
      <geom contype="0" conaffinity="0" density="0"/>
      <joint damping="2" armature="0.05"/>
      <position kp="400" kv="6"/>
    </default>
    <default class="hand">
      <geom contype="2" conaffinity="4" density="0" friction="0.7795 0.005 0.0001"/>
    </default>
  </default>
  <asset>
    <material name="shell" rgba="0.95 0.95 0.93 1" specular="0.4"/>
    <material name="grey" rgba="0.42 0.44 0.48 1" specular="0.3"/>
    <material name="mouth" rgba="0.85 0.25 0.25 1" emission="0.4"/>
    <material name="eye" rgba="1 1 1 1" specular="0.8"/>
    <material name="pupil" rgba="0.05 0.06 0.1 1" specular="0.9"/>
  </asset>
  <worldbody/>
  <actuator/>
</mujoco>
"""


def nico_mjcf() -> str:
    """NICO's upper body with its eye camera and ten position servos, as MJCF.

    The torso's frame is the world's: x forward, y to the robot's left, z up from the floor, metres. Class
    `robot` collides with nothing, class `hand` with objects. The servos are in the order of
    `robot.JOINT_NAMES` and take radians.
    """
    root = fromstring(_BASE)
    kinematics = json.loads(Path(__file__).with_name("nico_kinematics.json").read_text(encoding="utf-8"))
    worldbody, actuator = (cast(Element, root.find(tag)) for tag in ("worldbody", "actuator"))
    _add_robot(kinematics, worldbody, actuator)
    indent(root)
    return _HEADER + tostring(root, encoding="unicode") + "\n"


def _links(kinematics: dict[str, Any]) -> Iterator[tuple[dict[str, Any], float | None]]:
    """Joints above the hips without the fingers, parents first, with the angle of those that stay fixed."""
    fixed = {
        "head_z": 0.0,
        "head_y": HEAD_PITCH_DEG,
        "r_wrist_x": WRIST_TILT_DEG,
        "l_wrist_x": -WRIST_TILT_DEG,
    }
    for joint in kinematics["joints"]:
        if joint["name"] in JOINT_NAMES or joint["name"] in fixed:
            yield joint, fixed.get(joint["name"])


def _quaternion(joint: dict[str, Any], angle_deg: float) -> NDArray[np.float64]:
    """Orientation of a joint's child in its parent's frame, (w, x, y, z), the joint turned by an angle."""
    frame, turn, result = np.zeros(4), np.zeros(4), np.zeros(4)
    mujoco.mju_euler2Quat(frame, np.asarray(joint["rpy"], dtype=float), "XYZ")
    mujoco.mju_axisAngle2Quat(turn, np.asarray(joint["axis"], dtype=float), float(np.deg2rad(angle_deg)))
    mujoco.mju_mulQuat(result, frame, turn)
    return result


def _add_robot(kinematics: dict[str, Any], worldbody: Element, actuator: Element) -> None:
    """Add the tree of bodies to `worldbody` and the servos to `actuator`."""
    bodies = {"torso_11": SubElement(worldbody, "body", name="torso_11", childclass="robot")}
    links = {link["name"]: link for link in kinematics["links"]}
    for joint, fixed_angle in _links(kinematics):
        name = joint["name"]
        body = SubElement(
            bodies[joint["parent"]],
            "body",
            name=joint["child"],
            pos=text(*joint["xyz"]),
            quat=text(*_quaternion(joint, fixed_angle or 0.0)),
            gravcomp="1",
        )
        bodies[joint["child"]] = body
        link = links[joint["child"]]
        inertia = 0.4 * link["mass_kg"] * _GYRATION_RADIUS**2
        mass = {
            "pos": text(*link["com_xyz"]),
            "mass": text(link["mass_kg"]),
            "diaginertia": text(*[inertia] * 3),
        }
        SubElement(body, "inertial", mass)
        if fixed_angle is None:
            limits = text(joint["lower"], joint["upper"])
            SubElement(body, "joint", name=name, axis=text(*joint["axis"]), range=limits)
            SubElement(
                actuator, "position", {"class": "robot", "name": name, "joint": name, "ctrlrange": limits}
            )
    _dress(bodies, {joint["child"]: joint["xyz"] for joint in kinematics["joints"]})


def _dress(bodies: dict[str, Element], ends: dict[str, ArrayLike]) -> None:
    """Give the links shapes that look like NICO: white shells, grey joints, a round child's head."""
    torso, neck, head = bodies["torso_11"], bodies["neck_11"], bodies["head_21"]
    _shape(torso, "ellipsoid", (0.075, 0.1, 0.13), (0.0, 0, 0.665), material="shell")
    _shape(torso, "ellipsoid", (0.06, 0.085, 0.05), (0.0, 0, 0.53), material="grey")
    _rod(neck, (0, 0, -0.02), (0, 0, 0.06), 0.025, material="grey")
    middle = -0.023  # the head's own frame lies beside its middle
    _shape(head, "ellipsoid", (0.085, 0.082, 0.098), (0.01, middle, 0.095), material="shell")
    lips = {"material": "mouth", "euler": "0 -0.5 0"}
    _shape(head, "ellipsoid", (0.02, 0.032, 0.004), (0.078, middle, 0.045), **lips)
    for left in (1, -1):
        _shape(head, "sphere", (0.022,), (0.068, middle + left * 0.034, 0.11), material="eye")
        _shape(head, "sphere", (0.011,), (0.0815, middle + left * 0.035, 0.111), material="pupil")
        _shape(
            head,
            "cylinder",
            (0.026, 0.006),
            (0.0, middle + left * 0.082, 0.1),
            material="grey",
            euler="1.571 0 0",
        )
    SubElement(head, "camera", name=EYES, pos=text(0.1, middle, 0.11), xyaxes="0 -1 0 0 0 1", fovy="58")

    for side in ("right", "left"):
        end = {
            part: ends[f"{side}_{part}_11"]
            for part in ("collarbone", "upper_arm", "lower_arm", "wrist", "palm")
        }
        link = {part: bodies[f"{side}_{part}_11"] for part in end} | {
            "shoulder": bodies[f"{side}_shoulder_11"]
        }
        _rod(link["shoulder"], (0, 0, 0), end["collarbone"], 0.032, material="grey")
        _rod(link["collarbone"], (0, 0, 0), end["upper_arm"], 0.03, material="shell")
        _rod(link["upper_arm"], (0, 0, -0.02), end["lower_arm"], 0.03, material="shell")
        _rod(link["lower_arm"], (0, 0, 0), end["wrist"], 0.026, material="shell")
        _rod(link["wrist"], (0, 0, 0), end["palm"], 0.02, material="grey")
        _add_hand(link["palm"], side)


def _add_hand(palm: Element, side: str) -> None:
    """Palm, two fingers and an opposed thumb: the only parts of the robot that touch objects.

    Drawn in the right palm's frame (fingers along -z, palm side +y, index finger at the top, metres); the
    left one is its mirror image in z. The fingers are curled so that a lowered hand hooks behind an object.
    """
    mirror = np.array([1.0, 1.0, 1.0 if side == "right" else -1.0])

    def limb(points: Sequence[ArrayLike], radius: float, material: str) -> None:
        for start, end in pairwise(np.asarray(points) * mirror):
            _rod(palm, start, end, radius, **{"class": "hand", "material": material})

    for x in _FINGER_X:
        limb([(x, 0.0, -0.005), (x, 0.006, -0.04)], 0.016, "shell")
        points = [np.array([x, 0.006, -0.04])]
        for length, angle in zip(_FINGER_LENGTHS, np.cumsum(_FINGER_CURL_DEG), strict=True):
            a = np.deg2rad(angle)
            points.append(points[-1] + length * np.array([0.0, np.sin(a), -np.cos(a)]))
        limb(points, _FINGER_RADIUS, "grey")
    limb(_THUMB, _FINGER_RADIUS, "grey")


def _shape(body: Element, kind: str, size: tuple[float, ...], pos: tuple[float, ...], **more: str) -> None:
    """Add a primitive geom: `size` and `pos` in metres, in the body's frame."""
    SubElement(body, "geom", {"type": kind, "size": text(*size), "pos": text(*pos)} | more)


def _rod(body: Element, start: ArrayLike, end: ArrayLike, radius: float, **more: str) -> None:
    """Add a capsule from `start` to `end`, metres, in the body's frame."""
    ends = text(*np.ravel([start, end]))
    SubElement(body, "geom", {"type": "capsule", "fromto": ends, "size": text(radius)} | more)


def main() -> None:
    """Write the file."""
    NICO_XML.write_text(nico_mjcf(), encoding="utf-8")


if __name__ == "__main__":
    main()
