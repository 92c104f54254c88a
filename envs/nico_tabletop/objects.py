# SPDX-License-Identifier: Apache-2.0
"""The objects of both suites and the shapes they are drawn with.

Every object has the physics of CLANT's cube (paper, section 4): an unseen box carries its mass and its
contacts. What the camera sees are coloured surfaces made here in code, with the table at height 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

import numpy as np
from numpy.typing import NDArray

from .mjcf import text

CUBE_HALF_WIDTH = 0.02324
"""Half the edge of CLANT's cubes and of every object's collision box, metres (our decision)."""
_CUBE_MASS = 0.1  # kilograms
_SEGMENTS = 36

Rgba = tuple[float, float, float, float]


@dataclass(frozen=True)
class Lathe:
    """A surface of revolution about the upright axis.

    Attributes:
        profile: (radius, height) pairs along the surface, metres.
        rgba: Colour and opacity.
    """

    profile: tuple[tuple[float, float], ...]
    rgba: Rgba


@dataclass(frozen=True)
class Tube:
    """A bent round rod such as a handle: points (x, z) of its middle line and its radius, metres."""

    path: tuple[tuple[float, float], ...]
    radius: float
    rgba: Rgba


@dataclass(frozen=True)
class Block:
    """A box on the upright axis: half widths (x, y, z) and height of its middle, metres."""

    half: tuple[float, float, float]
    height: float
    rgba: Rgba


Part = Lathe | Tube | Block


@dataclass(frozen=True)
class TabletopObject:
    """Something to act on: its name in commands, a synonym and the parts it is drawn with."""

    name: str
    synonym: str
    parts: tuple[Part, ...]


def _ring(radius: float, height: float) -> NDArray[np.float64]:
    angle = np.linspace(0, 2 * np.pi, _SEGMENTS, endpoint=False)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, height)], axis=1)


def _skin(rings: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (N, 3) and triangles (M, 3) of the closed skin over consecutive rings of points."""
    size = len(rings[0])
    ends = [rings[0].mean(axis=0, keepdims=True), rings[-1].mean(axis=0, keepdims=True)]
    vertices = np.concatenate([*rings, *ends])
    here = np.arange(size)
    following = (here + 1) % size
    faces = []
    for k in range(len(rings) - 1):
        low, high = k * size, (k + 1) * size
        faces.append(np.stack([low + here, low + following, high + here], axis=1))
        faces.append(np.stack([low + following, high + following, high + here], axis=1))
    bottom, top = np.full(size, len(vertices) - 2), np.full(size, len(vertices) - 1)
    last = (len(rings) - 1) * size
    faces.append(np.stack([bottom, following, here], axis=1))
    faces.append(np.stack([top, last + here, last + following], axis=1))
    return vertices, np.concatenate(faces)


def _lathe_mesh(part: Lathe) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    # A radius of zero would fold a ring into one point and its triangles into lines.
    return _skin([_ring(max(radius, 1e-4), height) for radius, height in part.profile])


def _tube_mesh(part: Tube) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    path = np.array([(x, 0.0, z) for x, z in part.path])
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    sideways = np.array([0.0, 1.0, 0.0])
    circle = _ring(part.radius, 0.0)
    rings = [
        middle + circle[:, :1] * np.cross(sideways, along) + circle[:, 1:2] * sideways
        for middle, along in zip(path, forward, strict=True)
    ]
    return _skin(rings)


def add_object(item: TabletopObject, asset: Element, worldbody: Element) -> None:
    """Add `item` as a free body with its collision box; its meshes go to `asset`.

    The body is called `item.name`; its frame sits in the middle of the collision box.
    """
    body = SubElement(worldbody, "body", name=item.name)
    SubElement(body, "freejoint", name=item.name)
    half = text(CUBE_HALF_WIDTH, CUBE_HALF_WIDTH, CUBE_HALF_WIDTH)
    SubElement(body, "geom", {"class": "solid", "type": "box", "size": half, "mass": text(_CUBE_MASS)})
    for index, part in enumerate(item.parts):
        look = {"class": "seen", "rgba": text(*part.rgba)}
        if isinstance(part, Block):
            pos = text(0, 0, part.height - CUBE_HALF_WIDTH)
            SubElement(body, "geom", look | {"type": "box", "size": text(*part.half), "pos": pos})
            continue
        vertices, faces = _lathe_mesh(part) if isinstance(part, Lathe) else _tube_mesh(part)
        name = f"{item.name} {index}"
        mesh = {
            "name": name,
            "vertex": text(*vertices.ravel()),
            "face": text(*faces.ravel()),
            "inertia": "shell",
        }
        SubElement(asset, "mesh", mesh)
        SubElement(body, "geom", look | {"type": "mesh", "mesh": name, "pos": text(0, 0, -CUBE_HALF_WIDTH)})


def _cube(name: str, synonym: str, rgb: tuple[float, float, float]) -> TabletopObject:
    half = (CUBE_HALF_WIDTH,) * 3
    return TabletopObject(name, synonym, (Block(half, CUBE_HALF_WIDTH, (*rgb, 1.0)),))


def _arc(
    centre: tuple[float, float], radius: float, start: float, end: float
) -> tuple[tuple[float, float], ...]:
    """Points of an arc in the plane of (radius or x, height); angles in degrees, 0 points outwards."""
    angles = np.deg2rad(np.linspace(start, end, 17))
    return tuple((centre[0] + radius * np.cos(a), centre[1] + radius * np.sin(a)) for a in angles)


_MUSTARD, _GLASS, _IVORY = (0.95, 0.75, 0.05, 1.0), (0.10, 0.28, 0.12, 0.75), (0.93, 0.92, 0.86, 1.0)
_PAPER = (0.96, 0.95, 0.9, 1.0)
_TIN, _LABEL, _CHINA = (0.75, 0.77, 0.8, 1.0), (0.82, 0.1, 0.12, 1.0), (0.2, 0.45, 0.75, 1.0)

_CUBES = (
    _cube("blue", "azure", (0.1, 0.2, 0.9)),
    _cube("cyan", "greenish-blue", (0.1, 0.85, 0.9)),
    _cube("green", "harlequin", (0.1, 0.7, 0.1)),
    _cube("red", "scarlet", (0.9, 0.08, 0.08)),
    _cube("violet", "purple", (0.55, 0.1, 0.8)),
    _cube("yellow", "blonde", (0.95, 0.88, 0.1)),
)
_EVERYDAY = (
    TabletopObject(
        "mustard bottle",
        "mustard",
        (
            Lathe(((0.024, 0), (0.027, 0.004), (0.027, 0.06), (0.025, 0.075), (0.015, 0.088)), _MUSTARD),
            Lathe(((0.0275, 0.022), (0.0276, 0.023), (0.0276, 0.052), (0.0275, 0.053)), _PAPER),
            Lathe(((0.015, 0.086), (0.016, 0.096), (0.008, 0.1), (0.003, 0.118)), (0.8, 0.15, 0.08, 1.0)),
        ),
    ),
    TabletopObject(
        "can",
        "tin",
        (
            Lathe(((0.021, 0), (0.0245, 0.004), (0.0245, 0.012)), _TIN),
            Lathe(((0.0245, 0.012), (0.025, 0.013), (0.025, 0.066), (0.0245, 0.067)), _LABEL),
            Lathe(((0.0252, 0.03), (0.0253, 0.031), (0.0253, 0.044), (0.0252, 0.045)), _PAPER),
            Lathe(((0.0245, 0.067), (0.0245, 0.07), (0.021, 0.076), (0.02, 0.074), (0.0001, 0.074)), _TIN),
        ),
    ),
    TabletopObject(
        "mug",
        "cup",
        (
            Lathe(
                ((0.022, 0), (0.025, 0.003), (0.025, 0.056), (0.024, 0.058), (0.022, 0.056), (0.021, 0.006)),
                _CHINA,
            ),
            Tube(_arc((0.024, 0.03), 0.016, -90, 90), 0.0038, _CHINA),
        ),
    ),
    TabletopObject(
        "white chess piece",
        "pawn",
        (
            Lathe(
                (
                    (0.024, 0), (0.024, 0.008), (0.019, 0.013), (0.02, 0.017), (0.012, 0.026), (0.009, 0.045),
                    (0.009, 0.052), (0.016, 0.056), (0.016, 0.059), (0.009, 0.061),
                    *_arc((0, 0.073), 0.014, -45, 90),
                ),
                _IVORY,
            ),
        ),
    ),
    TabletopObject(
        "ball",
        "sphere",
        (
            Lathe(_arc((0, 0.025), 0.025, -90, 90), (0.95, 0.5, 0.1, 1.0)),
            Lathe(_arc((0, 0.025), 0.0253, -14, 14), _PAPER),
        ),
    ),
    TabletopObject(
        "empty wine bottle",
        "flask",
        (
            Lathe(
                (
                    (0.021, 0), (0.0235, 0.003), (0.0235, 0.07), (0.021, 0.082), (0.011, 0.096),
                    (0.0085, 0.104), (0.0085, 0.128), (0.0105, 0.129), (0.0105, 0.134), (0.0085, 0.135),
                ),
                _GLASS,
            ),
            Lathe(((0.0238, 0.02), (0.024, 0.021), (0.024, 0.052), (0.0238, 0.053)), _PAPER),
        ),
    ),
)  # fmt: skip

SUITES: dict[str, tuple[TabletopObject, ...]] = {"clant": _CUBES, "claeo": _EVERYDAY}
"""CLANT's six coloured cubes, and the six everyday objects of CLAEO (paper, section 4)."""
