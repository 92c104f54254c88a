# SPDX-License-Identifier: Apache-2.0
"""What objects are drawn with: MuJoCo's primitives, mesh files, surfaces of revolution and bent rods.

Lengths are metres. A part stands upright over its own origin; `Part.position` and `Part.rotation` place it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
from numpy.typing import NDArray

from .mjcf import text

_SEGMENTS = 36

Vector = tuple[float, ...]
Rgba = tuple[float, float, float, float]


@dataclass(frozen=True)
class Lathe:
    """A surface of revolution about the upright axis: (radius, height) pairs along the surface."""

    profile: tuple[Vector, ...]


@dataclass(frozen=True)
class Tube:
    """A bent round rod such as a handle: points (x, z) of its middle line and its radius."""

    path: tuple[Vector, ...]
    radius: float


@dataclass(frozen=True)
class Box:
    """A box with its middle in the origin: edges along x, y and z."""

    size: Vector


@dataclass(frozen=True)
class Ellipsoid:
    """An ellipsoid with its middle in the origin: half axes along x, y and z."""

    radii: Vector


@dataclass(frozen=True)
class Cylinder:
    """An upright cylinder with its middle in the origin."""

    radius: float
    height: float


@dataclass(frozen=True)
class Capsule:
    """An upright cylinder with round ends, its middle in the origin; the height is that of the whole."""

    radius: float
    height: float


@dataclass(frozen=True)
class Mesh:
    """A mesh file that MuJoCo reads (OBJ, binary STL), the factor from its unit to metres, and what is on it.

    A texture (PNG) needs an OBJ file with texture coordinates. The part's colour tints it.
    """

    file: Path
    scale: float
    texture: Path | None = None


Shape = Lathe | Tube | Box | Ellipsoid | Cylinder | Capsule | Mesh


@dataclass(frozen=True)
class Part:
    """A shape with its colour and its place.

    Attributes:
        shape: Its form.
        rgba: Colour and opacity, each from 0 to 1.
        position: Of the shape's origin, from the point of the table under the object's middle.
        rotation: Degrees about the object's x, then y, then z axis.
    """

    shape: Shape
    rgba: Rgba
    position: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (0.0, 0.0, 0.0)


def _ring(radius: float, height: float) -> NDArray[np.float64]:
    angle = np.linspace(0, 2 * np.pi, _SEGMENTS, endpoint=False)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), np.full_like(angle, height)], axis=1)


def _skin(rings: Sequence[NDArray[np.float64]]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices (N, 3) and triangles (M, 3) of the closed skin over consecutive rings of points.

    Discs close its ends, unless it returns to where it began: then it is a ring with a hole.
    """
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
    if not np.allclose(rings[0], rings[-1]):
        bottom, top = np.full(size, len(vertices) - 2), np.full(size, len(vertices) - 1)
        last = (len(rings) - 1) * size
        faces.append(np.stack([bottom, following, here], axis=1))
        faces.append(np.stack([top, last + here, last + following], axis=1))
    return vertices, np.concatenate(faces)


def _lathe_rings(profile: tuple[Vector, ...]) -> list[NDArray[np.float64]]:
    # A radius of zero would fold a ring into one point and its triangles into lines.
    return [_ring(max(radius, 1e-4), height) for radius, height in profile]


def _tube_rings(tube: Tube) -> list[NDArray[np.float64]]:
    path = np.array([(x, 0.0, z) for x, z in tube.path])
    forward = np.gradient(path, axis=0)
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    sideways = np.array([0.0, 1.0, 0.0])
    circle = _ring(tube.radius, 0.0)
    return [
        middle + circle[:, :1] * np.cross(sideways, along) + circle[:, 1:2] * sideways
        for middle, along in zip(path, forward, strict=True)
    ]


def _mesh(shape: Lathe | Tube | Mesh, scale: float) -> dict[str, str]:
    """MJCF attributes of a mesh."""
    if isinstance(shape, Mesh):
        return {"file": str(shape.file), "scale": text(*[shape.scale * scale] * 3)}
    rings = _lathe_rings(shape.profile) if isinstance(shape, Lathe) else _tube_rings(shape)
    vertices, faces = _skin(rings)
    return {"vertex": text(*(scale * vertices).ravel()), "face": text(*faces.ravel())}


def _primitive(shape: Box | Ellipsoid | Cylinder | Capsule, scale: float) -> dict[str, str]:
    """MJCF attributes of a primitive geom; MuJoCo wants half lengths."""
    match shape:
        case Box(size):
            half: Vector = tuple(edge / 2 for edge in size)
        case Ellipsoid(radii):
            half = radii
        case Cylinder(radius, height):
            half = radius, height / 2
        case Capsule(radius, height):
            half = radius, height / 2 - radius
    return {"type": type(shape).__name__.lower(), "size": text(*(scale * length for length in half))}


def add_part(
    part: Part, name: str, *, scale: float, table: float, look: dict[str, str], body: Element, asset: Element
) -> None:
    """Add a geom to `body` and, if it has them, its mesh, texture and material `name` to `asset`.

    Args:
        part: What to draw, its rotation in a model with angles in radians and fixed axes (`eulerseq="XYZ"`).
        name: Of mesh, texture and material.
        scale: Factor for all lengths.
        table: Height of the table in the body's frame, metres.
        look: Further attributes of the geom.
        body: Element of the body.
        asset: Element of the assets.
    """
    x, y, z = (scale * along for along in part.position)
    geom = look | {"rgba": text(*part.rgba), "pos": text(x, y, table + z)}
    if any(part.rotation):
        geom["euler"] = text(*np.deg2rad(part.rotation))
    if isinstance(part.shape, Lathe | Tube | Mesh):
        # As shells, open surfaces have an inertia too, as MuJoCo demands.
        SubElement(asset, "mesh", {"name": name, "inertia": "shell"} | _mesh(part.shape, scale))
        geom |= {"type": "mesh", "mesh": name}
        if isinstance(part.shape, Mesh) and part.shape.texture:
            SubElement(asset, "texture", name=name, type="2d", file=str(part.shape.texture))
            SubElement(asset, "material", name=name, texture=name)
            geom["material"] = name
    else:
        geom |= _primitive(part.shape, scale)
    SubElement(body, "geom", geom)


def _sphere() -> NDArray[np.float64]:
    around = [_ring(np.cos(tilt), np.sin(tilt)) for tilt in np.linspace(-np.pi / 2, np.pi / 2, 19)]
    return np.concatenate(around)


def surface_points(model: mujoco.MjModel, geom: int) -> NDArray[np.float64]:
    """Points (N, 3) of a geom's surface in its body's frame, metres: their hull is the geom's."""
    size = model.geom_size[geom]
    match model.geom_type[geom]:
        case mujoco.mjtGeom.mjGEOM_MESH:
            mesh = model.geom_dataid[geom]
            start = model.mesh_vertadr[mesh]
            points = model.mesh_vert[start : start + model.mesh_vertnum[mesh]].astype(np.float64)
        case mujoco.mjtGeom.mjGEOM_BOX:
            points = np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3) * size
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            points = _sphere() * size
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            points = np.concatenate([_ring(size[0], -size[1]), _ring(size[0], size[1])])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            ball, end = _sphere() * size[0], [0.0, 0.0, size[1]]
            points = np.concatenate([ball - end, ball + end])
        case kind:
            raise NotImplementedError(f"no surface points of geom type {kind}")
    turned = np.empty(9)
    mujoco.mju_quat2Mat(turned, model.geom_quat[geom])
    return points @ turned.reshape(3, 3).T + model.geom_pos[geom]
