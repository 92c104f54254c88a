# SPDX-License-Identifier: Apache-2.0
"""The objects on the table and the YAML files that list them (docs/objects.md).

Every object has the physics of CLANT's cube (paper, section 4): an unseen box carries its mass and its
contacts. What the camera sees are the coloured parts that the file names.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import cast
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import mujoco
import numpy as np
import yaml
from numpy.typing import NDArray

from .mjcf import text
from .reading import ObjectsError, Value
from .shapes import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Lathe,
    Mesh,
    Part,
    Rgba,
    Shape,
    Tube,
    Vector,
    add_part,
    surface_points,
)
from .tasks import SLOTS

CUBE_HALF_WIDTH = 0.02324
"""Half the edge of CLANT's cubes and of every object's collision box, metres (our decision)."""
_CUBE_MASS = 0.1  # kilograms

NAME_BYTES = 24
"""Room for an object's name in the ground truth, UTF-8."""

SHIPPED = ("clant", "claeo", "household")
"""Sets of objects that come with the package.

`clant` has CLANT's six coloured cubes, `claeo` CLAEO's six everyday objects (paper, section 4), `household`
everyday objects that neither has.
"""

NAME_CHECKS: list[Callable[[str], str]] = []
"""What else a name must pass: each says what is wrong with a name, or "".

The world has commands in CLANT's words alone. Who reads commands adds here what it does not understand.
"""

_FOLDER = Path(__file__).with_name("objects")
# What an object may fill: it must fit between its neighbours and under the robot's eyes (our decision).
_REACH, _TALLEST, _SMALLEST, _SUNK = 0.06, 0.2, 0.01, 0.001
_ARC_POINTS = 17
_TEXTURE_COORDINATES = re.compile(rb"^vt\s", re.MULTILINE)


@dataclass(frozen=True)
class TabletopObject:
    """Something to act on.

    Attributes:
        name: What commands call it, at most `NAME_BYTES` bytes in UTF-8.
        synonyms: Other names, at least one.
        parts: What it is drawn with.
        scale: Factor for all lengths of the parts.
        noun: What follows a name in a sentence, where names are adjectives: `cube` of "the red cube".
    """

    name: str
    synonyms: tuple[str, ...]
    parts: tuple[Part, ...]
    scale: float = 1.0
    noun: str = ""

    def phrase(self, name: str | None = None) -> str:
        """What stands behind "the" in a sentence: its name, or another one of it, and its noun."""
        return f"{name or self.name} {self.noun}".rstrip()


def add_object(item: TabletopObject, asset: Element, worldbody: Element) -> None:
    """Add `item` as a free body with its collision box; its meshes go to `asset`.

    The body is called `item.name`; its frame sits in the middle of the collision box.
    """
    body = SubElement(worldbody, "body", name=item.name)
    SubElement(body, "freejoint", name=item.name)
    half = text(CUBE_HALF_WIDTH, CUBE_HALF_WIDTH, CUBE_HALF_WIDTH)
    SubElement(body, "geom", {"class": "solid", "type": "box", "size": half, "mass": text(_CUBE_MASS)})
    for index, part in enumerate(item.parts):
        add_part(
            part,
            f"{item.name} {index}",
            scale=item.scale,
            table=-CUBE_HALF_WIDTH,
            look={"class": "seen"},
            body=body,
            asset=asset,
        )


def visible_surface(model: mujoco.MjModel, name: str) -> NDArray[np.float64]:
    """Points (N, 3) of an object's visible parts in its body's frame, metres; their hull is the object's."""
    body = model.body(name)
    geoms = range(body.geomadr[0], body.geomadr[0] + body.geomnum[0])
    seen = [geom for geom in geoms if model.geom_contype[geom] == 0]  # the collision box is not seen
    return np.concatenate([surface_points(model, geom) for geom in seen])


def read_objects(source: str | Path) -> tuple[TabletopObject, ...]:
    """Read and check a set of objects.

    A shipped set is read once per process, a file each time: its author may be changing it.

    Args:
        source: Name of a shipped set (`SHIPPED`) or path of a YAML file. Mesh files are relative to it.

    Returns:
        The objects in the file's order, at least three.

    Raises:
        ObjectsError: If the file or anything in it is wrong; the message says where, why, and what to do.
    """
    return _read_shipped(str(source)) if str(source) in SHIPPED else _read(Path(source))


@cache
def _read_shipped(name: str) -> tuple[TabletopObject, ...]:
    return _read(_FOLDER / f"{name}.yaml")


def _read(path: Path) -> tuple[TabletopObject, ...]:
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        known = ", ".join(SHIPPED)
        problem = f"cannot read objects from {str(path)!r} ({error.strerror})"
        raise ObjectsError(f"{problem}; name a YAML file or one of the shipped sets: {known}") from error
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise ObjectsError(f"{path} is no YAML file in UTF-8: {error}") from error
    listed = Value(content, (str(path),)).mapping(("objects",))["objects"]
    values = [_named(value, str(path)) for value in listed.items("object", least=len(SLOTS))]
    objects = tuple(_object(value, path.parent) for value in values)
    taken: set[str] = set()
    for value, item in zip(values, objects, strict=True):
        for name in (item.name, *item.synonyms):
            if name in taken:
                raise value.error(f"{name!r} is a name or synonym already; each may stand only once")
            for problem in filter(None, (check(name) for check in NAME_CHECKS)):
                raise value.error(f"{name!r} cannot be a name, because {problem}; choose another one")
            taken.add(name)
        _check_size(value, item)
    return objects


def _named(value: Value, path: str) -> Value:
    """The same value, called by the object's name if it has one."""
    name = value.content.get("name") if isinstance(value.content, dict) else None
    return Value(value.content, (path, f"object {name!r}")) if name else value


def _object(value: Value, folder: Path) -> TabletopObject:
    keys = value.mapping(("name", "synonyms", "parts"), ("scale", "noun"))
    name = keys["name"].words(NAME_BYTES)
    synonyms = tuple(synonym.words() for synonym in keys["synonyms"].items("synonym"))
    parts = tuple(_part(part, folder) for part in keys["parts"].items("part"))
    noun = keys["noun"].words() if "noun" in keys else ""
    return TabletopObject(name, synonyms, parts, _factor(keys), noun)


def _factor(keys: dict[str, Value]) -> float:
    return keys["scale"].number(least=1e-6, most=1e6) if "scale" in keys else 1.0


def _part(value: Value, folder: Path) -> Part:
    keys = value.mapping((), ("color", "position", "rotation", *_SHAPES))
    shapes = [kind for kind in _SHAPES if kind in keys]
    if len(shapes) != 1:
        raise value.error(
            f"a part has exactly one of {', '.join(_SHAPES)}; got {', '.join(shapes) or 'none'}"
        )
    shape = _SHAPES[shapes[0]](keys[shapes[0]], folder)
    rgba: Rgba = (1.0, 1.0, 1.0, 1.0)
    if not (isinstance(shape, Mesh) and shape.texture) or "color" in keys:
        red, green, blue, *opacity = value.mapping(("color",), tuple(keys))["color"].numbers(
            3, 4, least=0, most=1
        )
        rgba = (red, green, blue, *(opacity or [1.0]))  # type: ignore[assignment]  # three and one are four
    places = {key: keys[key].numbers(3) for key in ("position", "rotation") if key in keys}
    return Part(shape, rgba, **places)


def _lathe(value: Value, _: Path) -> Lathe:
    profile = _outline(value)
    if any(radius < 0 for radius, _ in profile):
        raise value.error("each point is [radius, height], and no radius may be negative")
    return Lathe(profile)


def _tube(value: Value, _: Path) -> Tube:
    keys = value.mapping(("path", "radius"))
    path = _outline(keys["path"])
    if (np.linalg.norm(np.gradient(np.array(path), axis=0), axis=1) < 1e-9).any():
        raise keys["path"].error("the path turns back on itself; leave the repeated point out")
    return Tube(path, keys["radius"].length())


def _outline(value: Value) -> tuple[Vector, ...]:
    """A list of points; an entry `arc` stands for points on a circle."""
    points: list[Vector] = []
    for entry in value.items("point"):
        if not isinstance(entry.content, dict):
            points.append(entry.numbers(2))
            continue
        arc = entry.mapping(("arc",))["arc"].mapping(("center", "radius", "from", "to"))
        (across, up), radius = arc["center"].numbers(2), arc["radius"].length()
        # Degrees; 0 points outwards, 90 up.
        for angle in np.deg2rad(np.linspace(arc["from"].number(), arc["to"].number(), _ARC_POINTS)):
            points.append((float(across + radius * np.cos(angle)), float(up + radius * np.sin(angle))))
    if len(points) < 2:
        raise value.error("a line has two or more points")
    return tuple(points)


def _sphere(value: Value, _: Path) -> Ellipsoid:
    return Ellipsoid((value.mapping(("radius",))["radius"].length(),) * 3)


def _cylinder(value: Value, _: Path) -> Cylinder:
    keys = value.mapping(("radius", "height"))
    return Cylinder(keys["radius"].length(), keys["height"].length())


def _capsule(value: Value, _: Path) -> Capsule:
    keys = value.mapping(("radius", "height"))
    radius, height = keys["radius"].length(), keys["height"].length()
    if height <= 2 * radius:
        raise value.error("the height counts the round ends: it must be more than twice the radius")
    return Capsule(radius, height)


def _mesh(value: Value, folder: Path) -> Mesh:
    keys = value.mapping(("file",), ("scale", "texture"))
    file = _file(keys["file"], folder, "an OBJ or STL", ".obj", ".stl")
    if "texture" not in keys:
        return Mesh(file, _factor(keys))
    texture = _file(keys["texture"], folder, "a PNG", ".png")
    if file.suffix.lower() != ".obj" or not _TEXTURE_COORDINATES.search(file.read_bytes()):
        raise keys["texture"].error(
            f"{file} has no texture coordinates; export the mesh as an OBJ file that has them (lines `vt`)"
        )
    return Mesh(file, _factor(keys), texture)


def _file(value: Value, folder: Path, kind: str, *suffixes: str) -> Path:
    name = value.content
    if not isinstance(name, str) or Path(name).suffix.lower() not in suffixes:
        raise value.error(f"expected the name of {kind} file; got {name!r}")
    file = (folder / name).resolve()
    if not file.is_file():
        raise value.error(f"there is no file {file}; names are relative to the YAML file")
    return file


_SHAPES: dict[str, Callable[[Value, Path], Shape]] = {
    "lathe": _lathe,
    "tube": _tube,
    "box": lambda value, _: Box(value.mapping(("size",))["size"].lengths(3)),
    "sphere": _sphere,
    "ellipsoid": lambda value, _: Ellipsoid(value.mapping(("radii",))["radii"].lengths(3)),
    "cylinder": _cylinder,
    "capsule": _capsule,
    "mesh": _mesh,
}

_ALONE = """
<mujoco>
  <compiler angle="radian" eulerseq="XYZ"/>
  <default>
    <default class="solid"/>
    <default class="seen"><geom contype="0" conaffinity="0" density="0"/></default>
  </default>
  <asset/>
  <worldbody/>
</mujoco>
"""


def _check_size(value: Value, item: TabletopObject) -> None:
    """Let MuJoCo compile the object, and measure it."""
    root = fromstring(_ALONE)
    asset, worldbody = (cast(Element, root.find(tag)) for tag in ("asset", "worldbody"))
    add_object(item, asset, worldbody)
    try:
        model = mujoco.MjModel.from_xml_string(tostring(root, encoding="unicode"))
    except (ValueError, mujoco.FatalError) as error:
        raise value.error(f"MuJoCo cannot build it: {error}") from error
    points = visible_surface(model, item.name) + np.array([0, 0, CUBE_HALF_WIDTH])
    low, high = points.min(axis=0), points.max(axis=0)
    centimetres = " x ".join(f"{100 * edge:.4g}" for edge in high - low)
    reach = np.abs([low[:2], high[:2]]).max()
    hint = "lengths are metres, and `scale` changes them all (0.001 for a mesh in millimetres)"
    if not (reach <= _REACH and high[2] <= _TALLEST):
        raise value.error(
            f"it is {centimetres} cm and reaches {100 * reach:.4g} cm sideways from its middle and "
            f"{100 * high[2]:.4g} cm up, where {100 * _REACH:g} and {100 * _TALLEST:g} are allowed; {hint}"
        )
    if (high - low).max() < _SMALLEST:
        raise value.error(f"it is {centimetres} cm, too small to be seen; {hint}")
    if low[2] < -_SUNK:
        raise value.error(
            f"it reaches {-100 * low[2]:.4g} cm into the table, which is at height 0; raise its parts with "
            "`position: [x, y, z]` (boxes, spheres, cylinders and capsules have their middle there)"
        )
