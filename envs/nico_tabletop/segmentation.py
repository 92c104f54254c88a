# SPDX-License-Identifier: Apache-2.0
"""Where bodies are in a camera's image, from MuJoCo's segmentation."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import mujoco
import numpy as np
from numpy.typing import NDArray

from .drawing import Renderer


def segmented_boxes(
    renderer: Renderer,
    data: mujoco.MjData,
    camera: str,
    size: tuple[int, int],
    bodies: Sequence[int],
    fewest_pixels: int = 1,
) -> NDArray[np.float64]:
    """The boxes of the pixels that show each body in a camera's image.

    Args:
        renderer: Of the world's model.
        data: State of the world, after `mj_kinematics`.
        camera: Its name.
        size: Height and width of the image.
        bodies: Their ids.
        fewest_pixels: A body that shows in fewer pixels has no box.

    Returns:
        Shape (bodies, 4): x0, y0, x1, y1 from the image's upper left corner, as fractions of its width and
        height; all -1 for a body without a box.
    """
    seen = _seen_bodies(renderer, data, camera, size)
    height, width = size
    boxes = np.full((len(bodies), 4), -1.0)
    for index, body in enumerate(bodies):
        rows, columns = np.nonzero(seen == body)
        if rows.size >= fewest_pixels:
            corners = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
            boxes[index] = np.array(corners) / [width, height, width, height]
    return boxes


def _seen_bodies(
    renderer: Renderer, data: mujoco.MjData, camera: str, size: tuple[int, int]
) -> NDArray[np.int64]:
    """The body that each pixel of a camera's image shows, (height, width): 0, the world, if none."""
    scene = renderer.scene
    renderer.update(data, camera)
    with _numbered_colours(scene):
        numbers = renderer.draw(*size).astype(np.int64) @ [1, 256, 256**2]
    bodies = np.zeros(scene.ngeom + 1, dtype=np.int64)  # number 0 is the background
    for geom in scene.geoms[: scene.ngeom]:
        if geom.segid >= 0 and geom.objtype == mujoco.mjtObj.mjOBJ_GEOM:
            bodies[geom.segid + 1] = data.model.geom_bodyid[geom.objid]
    return bodies[numbers]


@contextmanager
def _numbered_colours(scene: mujoco.MjvScene) -> Iterator[None]:
    """Draw each shape in the colour that is its `segid`, plus one."""
    usual = scene.flags.copy()
    for flag in mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR:
        scene.flags[flag] = True
    try:
        yield
    finally:
        scene.flags[:] = usual
