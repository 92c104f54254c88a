# SPDX-License-Identifier: Apache-2.0
"""What a cheap camera does to an image: its lens blurs, its sensor adds noise, its driver compresses."""

from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageFilter

from .variation import Conditions


def add_camera_effects(image: NDArray[np.uint8], conditions: Conditions, step: int) -> NDArray[np.uint8]:
    """Blur an image, add noise and compress it, in this order, as far as `conditions` say so.

    Args:
        image: Shape (height, width, 3), RGB.
        conditions: Whose `blur`, `noise`, `jpeg` and `seed` count.
        step: Number of the image in its episode: the noise of each is another.

    Returns:
        The image itself if nothing is to be done to it, otherwise a new one of the same shape.
    """
    if conditions.blur:
        image = np.asarray(Image.fromarray(image).filter(ImageFilter.GaussianBlur(conditions.blur)))
    if conditions.noise:
        random = np.random.default_rng((conditions.seed, step))
        noisy = image + random.normal(0, conditions.noise, image.shape)
        image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    if conditions.jpeg:
        file = BytesIO()
        Image.fromarray(image).save(file, "JPEG", quality=conditions.jpeg)
        image = np.asarray(Image.open(file))
    return image
