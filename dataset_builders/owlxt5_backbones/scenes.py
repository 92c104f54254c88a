# SPDX-License-Identifier: Apache-2.0
"""What NICO's camera may see: random objects on a random table in random light, and where each of them is."""

from collections.abc import Iterator, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from builder_tools.workers import draw_in_one_thread
from nico_tabletop.drawing import Renderer
from nico_tabletop.objects import visible_surface
from nico_tabletop.placement import SLOT_POSES, Pose
from nico_tabletop.robot import EYES, INITIAL_POSE_DEG, JOINT_NAMES, joint_limits_deg
from nico_tabletop.scene import TABLE_HEIGHT, build_model, parking_place, resting_place
from nico_tabletop.segmentation import segmented_boxes

from .catalogue import CATEGORIES, Instance, draw_instance

HEIGHT, WIDTH = 240, 320
"""Size of the images."""

IMAGES_OF_A_WORLD = 48
_OBJECTS_IN_A_WORLD = 30
_FEWEST_ON_THE_TABLE, _MOST_ON_THE_TABLE = 2, 12
# Where objects may stand, metres: a little more than where movements begin and leave them.
_NEAREST, _FARTHEST, _ASIDE = 0.22, 0.54, 0.28
_APART = 0.075
_TRIES = 200
# Of an object of which less is seen nobody can say what it is.
_FEWEST_PIXELS = 40
_TWINS = 0.4
# So often does something stand beside a resting hand, where a box ends too early: metres, standard deviation.
_AT_A_HAND, _AROUND = 0.4, 0.02
# What is taller than broad, so many times, may have fallen over; a share of it has.
_TALL, _FALLEN = 1.3, 0.15
_FALLS = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])  # the quaternion of a quarter turn forward
_ROBOT_HIDDEN, _ARMS_ELSEWHERE = 0.15, 0.4
_PLAIN_TABLE = 0.15
_CAMERA_SHIFT, _CAMERA_TURN, _ZOOM = 0.012, 2.0, 2.5  # metres and degrees, standard deviations


class RandomScenes:
    """A compiled world with instances of random categories, of which each image shows some.

    The robot, its camera and the table are those of `nico_tabletop`; colours, lights, the camera's place and
    the arms' pose differ from image to image.

    Args:
        rng: Where everything comes from.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        drawn = rng.choice(np.array([*CATEGORIES]), _OBJECTS_IN_A_WORLD)
        self.instances = [draw_instance(rng, str(name), f"{k}") for k, name in enumerate(drawn)]
        self._model = build_model(tuple(instance.item for instance in self.instances))
        self._data = mujoco.MjData(self._model)
        self._bodies = [self._model.body(instance.item.name).id for instance in self.instances]
        self._surfaces = [visible_surface(self._model, each.item.name) for each in self.instances]
        extents = (np.ptp(surface, axis=0) for surface in self._surfaces)
        self._is_tall = [height > _TALL * max(broad) for *broad, height in extents]
        self._joints = [self._model.joint(name).qposadr[0] for name in JOINT_NAMES]
        self._robot = self._robot_geoms()
        camera = self._model.camera(EYES)
        self._camera = camera.id, camera.pos.copy(), camera.quat.copy(), float(camera.fovy[0])
        self._lights = self._model.light_pos.copy(), self._model.light_dir.copy()
        self._paint_textures()
        draw_in_one_thread()
        self._renderer = Renderer(self._model)

    def images(self) -> Iterator[dict[str, Any]]:
        """Images and what they show.

        Yields:
            `image`: (HEIGHT, WIDTH, 3) uint8, RGB; `objects`: of each that is seen `names`, `colours` and
            `box`, x0, y0, x1, y1 as fractions of width and height, from MuJoCo's segmentation.
        """
        for _ in range(IMAGES_OF_A_WORLD):
            self._shift_camera()
            self._light()
            self._pose_arms()
            shown = self._place()
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_camlight(self._model, self._data)
            image = self._render()
            boxes = self._boxes(shown)
            yield {
                "image": image,
                "objects": [
                    {"names": [*item.names], "colours": [*item.colours], "box": box} for item, box in boxes
                ],
            }

    def close(self) -> None:
        """Free what draws it."""
        self._renderer.close()

    def _robot_geoms(self) -> NDArray[np.int64]:
        named = {*self._bodies, 0}
        return np.array([geom for geom, body in enumerate(self._model.geom_bodyid) if body not in named])

    def _paint_textures(self) -> None:
        """Another wood: the texture's two colours become two others; some tables are plain and bright."""
        model, texture = self._model, self._model.texture("wood")
        start, size = int(texture.adr[0]), int(texture.height[0] * texture.width[0] * texture.nchannel[0])
        pixels = model.tex_data[start : start + size].reshape(-1, 3)
        base = self._rng.uniform(60, 245) * (1 + self._rng.uniform(-0.3, 0.3, 3))
        marks = base * self._rng.uniform(0.6, 1.15)
        if self._rng.random() < _PLAIN_TABLE:
            base = marks = self._rng.uniform(200, 255) * (1 + self._rng.uniform(-0.05, 0.05, 3))
        marked = (pixels != pixels[0]).any(axis=1)
        pixels[:] = np.clip(np.where(marked[:, None], marks, base), 0, 255).astype(np.uint8)
        model.mat_texrepeat[model.material("wood").id] = self._rng.uniform(0.7, 6, 2)

    def _shift_camera(self) -> None:
        camera, position, turned, zoom = self._camera
        self._model.cam_pos[camera] = position + self._rng.normal(0, _CAMERA_SHIFT, 3)
        axis = np.deg2rad(self._rng.normal(0, _CAMERA_TURN, 3))
        turn, angle = np.empty(4), float(np.linalg.norm(axis))
        mujoco.mju_axisAngle2Quat(turn, axis / angle, angle)
        mujoco.mju_mulQuat(self._model.cam_quat[camera], turned, turn)
        self._model.cam_fovy[camera] = zoom + self._rng.normal(0, _ZOOM)

    def _light(self) -> None:
        model, rng = self._model, self._rng
        positions, directions = self._lights
        model.light_pos[:] = positions + rng.normal(0, 0.3, positions.shape)
        aim = directions + rng.normal(0, 0.15, directions.shape)
        model.light_dir[:] = aim / np.linalg.norm(aim, axis=1, keepdims=True)
        tint = 1 + rng.uniform(-0.08, 0.08, 3)
        model.light_diffuse[0] = rng.uniform(0.2, 0.7) * tint
        model.light_diffuse[1] = rng.uniform(0, 0.4) * tint
        model.light_castshadow[0] = rng.random() < 0.8
        model.vis.headlight.ambient[:] = rng.uniform(0.25, 0.5) * tint
        model.vis.headlight.diffuse[:] = rng.uniform(0.15, 0.45) * tint
        model.geom_rgba[model.geom("floor").id, :3] = rng.uniform(0.15, 0.95) * (
            1 + rng.uniform(-0.25, 0.25, 3)
        )
        model.mat_rgba[model.material("wood").id, :3] = rng.uniform(0.6, 1.0, 3)

    def _pose_arms(self) -> None:
        rng, angles = self._rng, INITIAL_POSE_DEG.astype(np.float64)
        limits = joint_limits_deg()
        if rng.random() < _ARMS_ELSEWHERE:
            angles = angles + rng.uniform(0, 1) * (rng.uniform(limits[:, 0], limits[:, 1]) - angles)
        angles = np.clip(angles + rng.normal(0, 2, len(angles)), limits[:, 0], limits[:, 1])
        self._data.qpos[self._joints] = np.deg2rad(angles)
        self._model.geom_group[self._robot] = 3 if rng.random() < _ROBOT_HIDDEN else 0  # 3 is not drawn

    def _place(self) -> list[int]:
        """Put some of the objects on the table and the others away; their indices."""
        rng = self._rng
        count = int(rng.integers(_FEWEST_ON_THE_TABLE, _MOST_ON_THE_TABLE, endpoint=True))
        chosen = rng.choice(len(self.instances), count, replace=False).tolist()
        if rng.random() < _TWINS:
            alike = [
                other
                for other, instance in enumerate(self.instances)
                if other not in chosen and instance.names[0] == self.instances[chosen[0]].names[0]
            ]
            chosen[1:2] = alike[:1] or chosen[1:2]
        places = self._draw_places(len(chosen))
        for index, instance in enumerate(self.instances):
            self._data.joint(instance.item.name).qpos[:] = parking_place(index)
        for index, pose in zip(chosen, places, strict=False):
            fallen = self._is_tall[index] and rng.random() < _FALLEN
            place = _lying_place(self._surfaces[index], pose) if fallen else resting_place(pose)
            self._data.joint(self.instances[index].item.name).qpos[:] = place
        return chosen[: len(places)]

    def _draw_places(self, count: int) -> list[Pose]:
        rng, places = self._rng, list[Pose]()
        if rng.random() < _AT_A_HAND:
            slot = SLOT_POSES[rng.choice([0, -1])]
            x, y = rng.normal((slot.x, slot.y), _AROUND)
            places.append(Pose(x, y, rng.uniform(-180, 180)))
        for _ in range(_TRIES):
            x, y = rng.uniform(_NEAREST, _FARTHEST), rng.uniform(-_ASIDE, _ASIDE)
            if all(np.hypot(x - other.x, y - other.y) >= _APART for other in places):
                places.append(Pose(x, y, rng.uniform(-180, 180)))
            if len(places) == count:
                break
        return places

    def _render(self) -> NDArray[np.uint8]:
        self._renderer.update(self._data, EYES)
        return self._renderer.draw(HEIGHT, WIDTH)

    def _boxes(self, shown: Sequence[int]) -> list[tuple[Instance, list[float]]]:
        bodies = [self._bodies[index] for index in shown]
        boxes = segmented_boxes(self._renderer, self._data, EYES, (HEIGHT, WIDTH), bodies, _FEWEST_PIXELS)
        return [
            (self.instances[index], box.round(4).tolist())
            for index, box in zip(shown, boxes, strict=True)
            if box[0] >= 0
        ]


def _lying_place(surface: NDArray[np.float64], pose: Pose) -> tuple[float, ...]:
    """As `resting_place`, of an object with this visible surface (N, 3) that has fallen over."""
    *_, w, x, y, z = resting_place(pose)
    quaternion, turned = np.empty(4), np.empty(9)
    mujoco.mju_mulQuat(quaternion, np.array([w, x, y, z]), _FALLS)
    mujoco.mju_quat2Mat(turned, quaternion)
    lowest = (surface @ turned.reshape(3, 3).T)[:, 2].min()
    return pose.x, pose.y, TABLE_HEIGHT - lowest, *quaternion.tolist()
