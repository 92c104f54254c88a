# SPDX-License-Identifier: Apache-2.0
"""The running world: NICO's servos, three objects on the table, and what the cameras see."""

from collections.abc import Sequence
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from .camera_effects import add_camera_effects
from .distractors import Distractor
from .drawing import Renderer
from .drawn_head import DrawnHead
from .look import Look
from .objects import TabletopObject, visible_surface
from .placement import SLOT_POSES, Pose, Poses
from .robot import EYES, INITIAL_POSE_DEG, JOINT_NAMES, joint_limits_deg
from .scene import build_model, parking_place, resting_place
from .segmentation import segmented_boxes
from .tasks import SLOTS
from .variation import Conditions

CONTROL_HZ = 10
"""Joint targets per second: one per CLANT frame."""


class JointTargetError(ValueError):
    """A joint target is not a finite number."""


def _within_limits(target_deg: NDArray[np.float64]) -> NDArray[np.float64]:
    """Joint targets in radians, clipped: CLANT's first row lies 0.02 degrees beyond the elbows' limits."""
    limits = joint_limits_deg()
    return np.deg2rad(np.clip(target_deg, limits[:, 0], limits[:, 1]))


class TabletopSimulation:
    """NICO at the table with three of the given objects, and distractors out of its way.

    Angles are degrees in the order of `robot.JOINT_NAMES`; positions are metres in the robot's frame (x
    forward, y to the robot's left, z up). The same calls give the same numbers, bit for bit.

    Attributes:
        head_deg: How the head is turned where a camera other than the eyes' sees it, shape (2,), degrees
            from the middle, see `head.Head`. It moves nothing; a reset puts it back.
    """

    def __init__(self, objects: tuple[TabletopObject, ...]) -> None:
        self.objects = {item.name: item for item in objects}
        self.model = build_model(objects)
        self.data = mujoco.MjData(self.model)
        self.arrangement: tuple[str, ...] = ()
        self.distractors: tuple[Distractor, ...] = ()
        self.conditions = Conditions()
        self.head_deg: NDArray[np.float64] = np.zeros(2)
        self._look = Look(self.model)
        self._drawn_head = DrawnHead(self.model)
        self._surfaces = {name: visible_surface(self.model, name) for name in self.objects}
        self._joints = np.array([self.model.joint(name).qposadr[0] for name in JOINT_NAMES])
        self._substeps = round(1 / (CONTROL_HZ * self.model.opt.timestep))
        self._target = _within_limits(INITIAL_POSE_DEG)

    def reset(
        self,
        arrangement: Sequence[str],
        poses: Sequence[Pose] = SLOT_POSES,
        conditions: Conditions | None = None,
        distractors: Sequence[Distractor] = (),
    ) -> None:
        """Put the named objects into their poses and the arms into the initial pose.

        Args:
            arrangement: Names of the left, middle and right object.
            poses: Where they stand.
            conditions: In which way poses, arms, camera, light and table differ from the paper's setting,
                until the next reset; None: in none.
            distractors: Further objects, which conditions do not shift.

        Raises:
            ValueError: If there are not three distinct known names and three poses, or a distractor is
                unknown or already there.
        """
        if len(set(arrangement)) != len(SLOTS) or not set(arrangement) <= set(self.objects):
            known = ", ".join(self.objects)
            raise ValueError(
                f"an arrangement is three different objects out of {known}; got {list(arrangement)}"
            )
        conditions = conditions or Conditions()
        shifted = conditions.shifted(poses)
        further = [name for name, _ in distractors]
        is_distinct = len({*arrangement, *further}) == len(SLOTS) + len(further)
        if not (is_distinct and set(further) <= set(self.objects)):
            raise ValueError(f"distractors are further objects of the set, each once; got {further}")
        self.arrangement, self.distractors = tuple(arrangement), tuple(distractors)
        self.conditions = conditions
        self._look.change(conditions)
        self.head_deg = np.zeros(2)
        places = dict(zip(arrangement, shifted, strict=True)) | dict(self.distractors)
        mujoco.mj_resetData(self.model, self.data)
        for index, name in enumerate(self.objects):
            place = resting_place(places[name]) if name in places else parking_place(index)
            self.data.joint(name).qpos[:] = place
            self.model.body_gravcomp[self.model.body(name).id] = 0.0 if name in places else 1.0
        self._target = _within_limits(self.conditions.start_pose_deg)
        self.data.qpos[self._joints] = self._target
        self.data.ctrl[:] = self._target
        mujoco.mj_forward(self.model, self.data)

    def step(self, target_deg: ArrayLike) -> None:
        """Move for one control period (0.1 s) towards joint targets, shape (10,), degrees.

        Targets beyond a joint's limits are clipped to them; the servos follow a straight line in joint space.

        Raises:
            JointTargetError: If a target is NaN or infinite.
        """
        target = np.asarray(target_deg, dtype=np.float64)
        if target.shape != (len(JOINT_NAMES),):
            raise JointTargetError(
                f"a joint target has {len(JOINT_NAMES)} angles in degrees; got {target.shape}"
            )
        if not np.isfinite(target).all():
            bad = ", ".join(f"{JOINT_NAMES[k]} = {target[k]}" for k in np.flatnonzero(~np.isfinite(target)))
            raise JointTargetError(f"joint targets must be finite degrees; got {bad}")
        goal = _within_limits(target)
        for substep in range(1, self._substeps + 1):
            self.data.ctrl[:] = self._target + (goal - self._target) * (substep / self._substeps)
            mujoco.mj_step(self.model, self.data)
        self._target = goal

    @property
    def joint_positions_deg(self) -> NDArray[np.float64]:
        """Measured joint angles, shape (10,), degrees."""
        return np.rad2deg(self.data.qpos[self._joints])

    def object_positions(self) -> NDArray[np.float64]:
        """Middles of the left, middle and right object, shape (3, 3), metres."""
        return np.array([self.data.body(name).xpos for name in self.arrangement])

    def distractor_positions(self) -> NDArray[np.float64]:
        """Middles of the distractors, shape (N, 3), metres."""
        return np.array([self.data.body(name).xpos for name, _ in self.distractors]).reshape(-1, 3)

    def object_poses(self) -> Poses:
        """How the left, middle and right object stand now; of one that lies, where its x axis points."""
        left, middle, right = map(self._pose, self.arrangement)
        return left, middle, right

    def present_distractors(self) -> tuple[Distractor, ...]:
        """The distractors as they stand now."""
        return tuple(Distractor(name, self._pose(name)) for name, _ in self.distractors)

    def _pose(self, name: str) -> Pose:
        body = self.data.body(name)
        (x, y, _), turned = body.xpos, body.xmat
        return Pose(float(x), float(y), float(np.rad2deg(np.arctan2(turned[3], turned[0]))))

    @cached_property
    def _renderer(self) -> Renderer:
        """Made by the process that draws, as a GL context does not survive a fork."""
        return Renderer(self.model)

    def render(self, camera: str, height: int, width: int) -> NDArray[np.uint8]:
        """Image of a camera, shape (height, width, 3), RGB; the eyes' with blur, noise and compression.

        Raises:
            DrawingError: If MuJoCo cannot draw on this machine.
        """
        renderer = self._renderer
        renderer.update(self.data, camera)
        # The eyes' image shows no turned head and none of its shadow: it stays as the policies know it.
        if camera != EYES and self.head_deg.any():
            self._drawn_head.turn(renderer.scene, self.data, self.head_deg)
        image = renderer.draw(height, width)
        if camera != EYES:
            return image
        return add_camera_effects(image, self.conditions, round(self.data.time * CONTROL_HZ))

    def segmented_boxes(self, camera: str, height: int, width: int) -> NDArray[np.float64]:
        """Ground truth: the boxes of what a camera's image shows of the three objects, pixel by pixel.

        Unlike `object_boxes`, a hand in front of an object makes its box smaller.

        Returns:
            Shape (3, 4): x0, y0, x1, y1 as in `object_boxes`; all -1 for an object of which nothing is seen.
        """
        bodies = [self.model.body(name).id for name in self.arrangement]
        return segmented_boxes(self._renderer, self.data, camera, (height, width), bodies)

    def object_boxes(self, aspect: float) -> NDArray[np.float64]:
        """Ground truth: the boxes of the three objects in the eye camera's image.

        A box encloses the projection of the object's whole visible surface, also where a hand hides it.

        Args:
            aspect: Width over height of the image.

        Returns:
            Shape (3, 4): x0, y0, x1, y1 from the image's upper left corner, as fractions of its width and
            height, cut at its edges; all -1 for an object out of view.
        """
        camera = self.data.camera(EYES)
        half_height = np.tan(np.deg2rad(self.model.camera(EYES).fovy[0]) / 2)
        boxes = np.full((len(self.arrangement), 4), -1.0)
        for index, name in enumerate(self.arrangement):
            body = self.data.body(name)
            surface = self._surfaces[name] @ body.xmat.reshape(3, 3).T + body.xpos
            seen = (surface - camera.xpos) @ camera.xmat.reshape(3, 3)
            if (seen[:, 2] >= 0).any():  # the camera looks along its own -z
                continue
            projected = seen[:, :2] / -seen[:, 2:] / (half_height * np.array([aspect, -1.0]))
            projected = (projected + 1) / 2
            low, high = projected.min(axis=0), projected.max(axis=0)
            if (high > 0).all() and (low < 1).all():
                boxes[index] = np.clip([*low, *high], 0, 1)
        return boxes

    def close(self) -> None:
        """Free what draws it; another image makes it anew."""
        if "_renderer" in self.__dict__:
            self._renderer.close()
            del self._renderer
