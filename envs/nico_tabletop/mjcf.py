# SPDX-License-Identifier: Apache-2.0
"""MJCF as text: the face of MuJoCo that stays the same from 3.8 to 4.x."""

from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import ArrayLike


def text(*numbers: float) -> str:
    """Numbers as an MJCF attribute."""
    return " ".join(f"{number:.9g}" for number in numbers)


def shape(body: Element, kind: str, size: tuple[float, ...], pos: tuple[float, ...], **more: str) -> None:
    """Add a primitive geom: `size` and `pos` in metres, in the body's frame."""
    SubElement(body, "geom", {"type": kind, "size": text(*size), "pos": text(*pos)} | more)


def rod(body: Element, start: ArrayLike, end: ArrayLike, radius: float, **more: str) -> None:
    """Add a capsule from `start` to `end`, metres, in the body's frame."""
    ends = text(*np.ravel([start, end]))
    SubElement(body, "geom", {"type": "capsule", "fromto": ends, "size": text(radius)} | more)
