# SPDX-License-Identifier: Apache-2.0
"""Where bodies are in a camera's image, from MuJoCo's segmentation."""

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray


def segmented_boxes(
    renderer: mujoco.Renderer,
    data: mujoco.MjData,
    camera: str,
    bodies: Sequence[int],
    fewest_pixels: int = 1,
) -> NDArray[np.float64]:
    """The boxes of the pixels that show each body in a camera's image.

    Args:
        renderer: Of the image's size.
        data: State of the world, after `mj_kinematics`.
        camera: Its name.
        bodies: Their ids.
        fewest_pixels: A body that shows in fewer pixels has no box.

    Returns:
        Shape (bodies, 4): x0, y0, x1, y1 from the image's upper left corner, as fractions of its width and
        height; all -1 for a body without a box.
    """
    seen = _seen_bodies(renderer, data, camera)
    height, width = seen.shape
    boxes = np.full((len(bodies), 4), -1.0)
    for index, body in enumerate(bodies):
        rows, columns = np.nonzero(seen == body)
        if rows.size >= fewest_pixels:
            corners = columns.min(), rows.min(), columns.max() + 1, rows.max() + 1
            boxes[index] = np.array(corners) / [width, height, width, height]
    return boxes


def _seen_bodies(renderer: mujoco.Renderer, data: mujoco.MjData, camera: str) -> NDArray[np.int64]:
    """The body that each pixel of a camera's image shows, (height, width): 0, the world, if none."""
    renderer.enable_segmentation_rendering()
    try:
        renderer.update_scene(data, camera)
        ids, kinds = np.moveaxis(renderer.render(), -1, 0)
    finally:
        renderer.disable_segmentation_rendering()
    # Geom -1, the background, is no geom: it takes body 0.
    return np.where(kinds == mujoco.mjtObj.mjOBJ_GEOM, data.model.geom_bodyid[ids], 0)
