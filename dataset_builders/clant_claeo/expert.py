# SPDX-License-Identifier: Apache-2.0
"""Scripted demonstrations: joint trajectories that push, pull or slide one object.

All verbs are the same movement of the fingertips in different directions: rise, turn the hand and go above
the side of the object from which to move it, lower, stroke through the object's place, draw back, lift. Only
the grip and the arm depend on the verb. mink's inverse kinematics turns the movement into joint angles.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from nico_tabletop.clearance import Clearance
from nico_tabletop.objects import CUBE_HALF_WIDTH
from nico_tabletop.placement import OutOfReachError, Pose
from nico_tabletop.robot import INITIAL_POSE_DEG, JOINT_NAMES
from nico_tabletop.scene import TABLE_HEIGHT, build_model
from nico_tabletop.simulation import CONTROL_HZ
from nico_tabletop.tasks import Action, Verb

try:
    import mink
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        "scripted demonstrations need mink: pip install 'lerobot_policy_owlxt5[scripted]'"
    ) from error

Vector = NDArray[np.float64]


@dataclass(frozen=True)
class Grip:
    """How a hand is held while it moves an object: directions for the right arm; the left one mirrors y.

    An arm has only five joints: the place of the fingertips is kept, the directions as well as they can be.

    Attributes:
        fingers: Where the fingers point, world frame.
        palm: Where the palm looks, world frame; what is not square to `fingers` is ignored.
        height: Of the fingertips over the table, metres.
        shift: How far the fingertips pass in front of (+x) the object's middle, metres.
    """

    fingers: tuple[float, float, float]
    palm: tuple[float, float, float]
    height: float
    shift: float = 0.0


# A level palm holds a corner between its two fingers.
_PUSH = Grip(fingers=(1, 0.05, -0.3), palm=(0, 0.5, -1), height=0.03)
# Steep fingers and a thumb turned aside: it must not come down on the object and tip it.
_PULL = Grip(fingers=(1, 0.3, -2.5), palm=(-1, 0.7, 0), height=0.028)
# With the palm, beyond the object's middle, so that the thumb, nearer to the wrist, does not touch it.
_INWARDS = Grip(fingers=(1, 0.15, -0.2), palm=(0, 1, 0), height=0.035, shift=0.01)
# With the back of the hand: fingers that point outwards lie flat against the object.
_OUTWARDS = Grip(fingers=(1, -0.2, -0.2), palm=(0, 1, 0), height=0.035, shift=0.01)

GRIPS: dict[str, dict[str, Grip]] = {
    "push": {"left": _PUSH, "right": _PUSH},
    "pull": {"left": _PULL, "right": _PULL},
    "slide-to-left": {"left": _OUTWARDS, "right": _INWARDS},
    "slide-to-right": {"left": _INWARDS, "right": _OUTWARDS},
}
"""The grip of each verb of `nico_tabletop.tasks.VERBS` and of each arm."""

# Metres. The middle between the tips of both fingers stands for the hand.
_GAP = 0.03  # from the fingertips to the object's near side, before the stroke
_STROKE = 0.085  # the object follows over some 60 mm of it
_RETREAT = 0.02  # back along the stroke, so that lifting does not drag the object along
_LIFT = 0.07  # from the height of the stroke to clear other objects
_TOLERANCE = 0.015  # error of the fingertips at both ends of the stroke
_MARGIN = 0.006  # between a hand and the objects that are not to be moved

MIDDLE = 0.078
"""An object farther from the robot's middle than this is on its left or right side, metres.

Halfway between where slides leave the objects of the middle and of the outer slots: few stand near it.
"""

_SPEED = 0.11  # of the fingertips, mean over a leg, metres per second
_RISE_SECONDS, _TURN_SECONDS = 0.7, 1.5  # at least: wrists turn slower than fingertips travel
_HOME_LIFT = 0.5  # share of its time in which the arm that does not act lifts its hand, and lowers it
_HOME_NEAR_DEG = 3.0  # closer to its initial pose, it lifts its hand less
_JOINT_SPEED_DEG = 60.0  # a second; also the order of CLANT's own speeds

_ORIENTATION_COST = 0.02  # metres of distance that weigh as much as one radian of orientation
_DAMPING = 1e-4
_SUBSTEPS = 5  # of the inverse kinematics per row


@cache
def _robot() -> mujoco.MjModel:
    return build_model(())


@cache
def _clearance() -> Clearance:
    return Clearance(_MARGIN)


class _Arm:
    """Inverse kinematics of one arm: the pose of its fingertips in, joint angles of the whole robot out."""

    def __init__(self, side: str, start: Vector) -> None:
        model = _robot()
        self._body = f"{side}_palm_11"
        self._columns = [model.joint(name).qposadr[0] for name in JOINT_NAMES]
        self._acts = np.array([name.startswith(side[0]) for name in JOINT_NAMES])
        # CLANT's first row lies a hundredth of a degree beyond the elbows' limits.
        angles = np.empty(model.nq)
        angles[self._columns] = np.deg2rad(start)
        self._configuration = mink.Configuration(model, np.clip(angles, *model.jnt_range.T))
        self._task = mink.FrameTask(self._body, "body", 1.0, _ORIENTATION_COST)
        speeds = dict.fromkeys(JOINT_NAMES, float(np.deg2rad(_JOINT_SPEED_DEG)))
        self._limits = [mink.ConfigurationLimit(model), mink.VelocityLimit(model, speeds)]
        self._fingers = np.array([0.0, 0.0, -1.0 if side == "right" else 1.0])
        self._tip = self._fingertips(model)

    def _fingertips(self, model: mujoco.MjModel) -> Vector:
        """Middle between the tips of the two fingers, palm's frame, metres."""
        body = model.body(self._body)
        ends = []
        for geom in range(body.geomadr[0], body.geomadr[0] + body.geomnum[0]):
            half = np.zeros(3)
            mujoco.mju_rotVecQuat(half, np.array([0, 0, model.geom_size[geom, 1]]), model.geom_quat[geom])
            ends += [model.geom_pos[geom] + half, model.geom_pos[geom] - half]
        return np.mean(sorted(ends, key=lambda end: end @ self._fingers)[-2:], axis=0)

    @property
    def _palm(self) -> mink.SE3:
        return self._configuration.get_transform_frame_to_world(self._body, "body")

    @property
    def orientation(self) -> mink.SO3:
        """Orientation of the palm in the world."""
        return self._palm.rotation()

    @property
    def fingertips(self) -> Vector:
        """Place of the fingertips in the world, shape (3,), metres."""
        return self._palm.apply(self._tip)

    def hold(self, grip: Grip) -> mink.SO3:
        """Orientation of the palm that a grip wishes for."""
        mirror = np.array([1.0, -self._fingers[2], 1.0])
        back = np.array(grip.fingers) * mirror * self._fingers[2]  # the palm's z
        back /= np.linalg.norm(back)
        across = np.cross(np.array(grip.palm) * mirror, back)  # its x; its y is where the palm looks
        across /= np.linalg.norm(across)
        return mink.SO3.from_matrix(np.stack([across, np.cross(back, across), back], axis=1))

    def reach(self, fingertips: Vector, orientation: mink.SO3, seconds: float = 0.0) -> list[Vector]:
        """Go to a place in a straight line that begins and ends at rest.

        Args:
            fingertips: Where the fingertips go, shape (3,), metres, world frame.
            orientation: Of the palm in the world; the hand turns to it as fast as its joints may.
            seconds: Least duration.

        Returns:
            Joint angles, one row of shape (10,) per control period, degrees; the other arm has those of
            `robot.INITIAL_POSE_DEG`.
        """
        start = self.fingertips
        way = fingertips - start
        periods = int(np.ceil(max(seconds, float(np.linalg.norm(way)) / _SPEED) * CONTROL_HZ))
        rows = []
        for step, share in enumerate(_ease(periods * _SUBSTEPS), start=1):
            self._follow(start + share * way, orientation)
            if step % _SUBSTEPS == 0:
                angles = np.rad2deg(self._configuration.q[self._columns])
                rows.append(np.where(self._acts, angles, INITIAL_POSE_DEG))
        return rows

    def _follow(self, fingertips: Vector, orientation: mink.SO3) -> None:
        """One substep of inverse kinematics towards a pose."""
        # The palm's place follows from its present orientation, not from the desired one, which five joints
        # cannot reach: so the fingertips, not the wrist, come to where they shall be.
        palm = fingertips - self.orientation.apply(self._tip)
        self._task.set_target(mink.SE3.from_rotation_and_translation(orientation, palm))
        dt = 1 / (CONTROL_HZ * _SUBSTEPS)
        velocity = mink.solve_ik(
            self._configuration, [self._task], dt, "daqp", damping=_DAMPING, limits=self._limits
        )
        self._configuration.integrate_inplace(velocity, dt)


def _ease(steps: int) -> Vector:
    """Shares, up to 1, of a way that begins and ends at rest, after each of `steps` equal times; (steps,)."""
    return _eased(np.arange(1, steps + 1) / steps)


def _eased(time: Vector) -> Vector:
    """Shares of a way that begins at rest at time 0 and ends at rest at time 1."""
    time = np.clip(time, 0, 1)
    return time**2 * (3 - 2 * time)


def plan(
    action: Action, poses: Sequence[Pose], start: NDArray[np.float64] = INITIAL_POSE_DEG
) -> NDArray[np.float64]:
    """Joint trajectory that moves one of three objects in the direction of `action`.

    `acting_arm` says which arm acts. So a movement follows from the object's place alone, which is all that a
    policy may know. The same arguments give the same numbers.

    Args:
        action: What to do; its slot tells the left, middle or right object.
        poses: Where the left, middle and right object stand.
        start: Where the arms are, shape (10,), degrees; near the initial pose. The acting arm rises from
            there, and until it has turned its hand, the other one goes to its initial pose.

    Returns:
        Joint targets, shape (T, 10), float64, degrees, in the order of `robot.JOINT_NAMES`, `CONTROL_HZ` rows
        a second. The first row is `start`; T lies between 40 and 85, like CLANT's.

    Raises:
        OutOfReachError: If the arm does not reach the object, or its hand would touch another one.
    """
    pose = poses[action.slot]
    acting = acting_arm(action.verb, pose)
    try:
        rows = move(action.verb, pose, acting, start)
        if not _is_clear(rows, acting, action.slot, poses):
            raise OutOfReachError(f"the {acting} hand would touch another object")
    except OutOfReachError as error:
        raise OutOfReachError(f"{action.name} at x {pose.x:.3f} m, y {pose.y:.3f} m: {error}") from None
    return rows


def _is_clear(rows: NDArray[np.float64], acting: str, slot: int, poses: Sequence[Pose]) -> bool:
    """Whether the acting hand, once risen, stays `_MARGIN` away from all objects but the one to move."""
    clearance = _clearance()
    others = [cube for index, cube in enumerate(clearance.cubes) if index != slot]
    hand = clearance.model.body(f"{acting}_palm_11").id
    for row in rows[round(_RISE_SECONDS * CONTROL_HZ) :]:
        bodies = clearance.model.geom_bodyid[clearance.near(poses, row)]
        if ((bodies == hand).any(axis=1) & np.isin(bodies, others).any(axis=1)).any():
            return False
    return True


def acting_arm(verb: Verb, pose: Pose) -> str:
    """`left` or `right`: the arm on the object's side; in the middle the right one, or the one to slide to.

    To slide it with the palm would touch a neighbour more often: in 67 of 300 slides in the middle, with each
    object up to 6 cm off its slot, instead of 20; placed freely in 14 of 300, instead of none.
    """
    is_left = pose.y > 0 if abs(pose.y) > MIDDLE else verb.direction[1] > 0
    return "left" if is_left else "right"


@cache
def _lifted(side: str) -> Vector:
    """How a resting arm's angles change when it lifts its hand by `_LIFT`, shape (10,), degrees."""
    arm = _Arm(side, INITIAL_POSE_DEG)
    up = arm.fingertips + np.array([0.0, 0.0, _LIFT])
    return arm.reach(up, arm.orientation, _RISE_SECONDS)[-1] - INITIAL_POSE_DEG


def _way_home(acting: str, start: Vector, rows: int) -> Vector:
    """How far the arm that does not act is still from its initial pose, shape (rows, 10), degrees.

    It lifts its hand, lowers it at the end, and moves in between: it knows no objects, and would sweep the
    one beside it along. A policy sees the start pose and one object alone, so nothing else decides about it.
    """
    other = "right" if acting == "left" else "left"
    off = np.where([name.startswith(other[0]) for name in JOINT_NAMES], start - INITIAL_POSE_DEG, 0.0)
    time = np.arange(1, rows + 1) / rows
    moved = _eased((time - _HOME_LIFT / 2) / (1 - _HOME_LIFT))
    height = _eased(time / _HOME_LIFT) * _eased((1 - time) / _HOME_LIFT)
    height *= min(1.0, float(np.abs(off).max()) / _HOME_NEAR_DEG)
    return np.outer(1 - moved, off) + np.outer(height, _lifted(other))


def move(
    verb: Verb,
    pose: Pose,
    acting: str,
    start: NDArray[np.float64] = INITIAL_POSE_DEG,
    turn_seconds: float = _TURN_SECONDS,
) -> NDArray[np.float64]:
    """The trajectory of `plan` with a given arm, whatever else stands on the table.

    Args:
        verb: What to do.
        pose: Where the object stands.
        acting: `left` or `right`.
        start: Where the arms are, see `plan`.
        turn_seconds: Least duration of the way to above the object, the only leg whose length depends much on
            where the object stands.

    Raises:
        OutOfReachError: If the fingertips come too far off the stroke.
    """
    arm = _Arm(acting, start)
    grip = GRIPS[verb.name][acting]
    held = arm.hold(grip)

    direction = np.array([*verb.direction, 0.0])
    up = np.array([0.0, 0.0, _LIFT])
    place = np.array([pose.x + grip.shift, pose.y, TABLE_HEIGHT + grip.height])
    begin = place - direction * (CUBE_HALF_WIDTH + _GAP)
    end = begin + direction * _STROKE
    after = end - direction * _RETREAT

    # Straight up first, the hand as it is: in the initial pose the fingers are close to the objects.
    risen = np.array([*arm.fingertips[:2], (begin + up)[2]])
    rows = arm.reach(risen, arm.orientation, _RISE_SECONDS) + arm.reach(begin + up, held, turn_seconds)
    for row, away in zip(rows, _way_home(acting, start, len(rows)), strict=True):
        row += away
    for goal in (begin, end):
        rows += arm.reach(goal, held)
        if (miss := float(np.linalg.norm(arm.fingertips - goal))) > _TOLERANCE:
            raise OutOfReachError(f"the {acting} hand stays {miss * 100:.1f} cm off its way")
    rows += arm.reach(after, held) + arm.reach(after + up, held)
    return np.array([start, *rows])
