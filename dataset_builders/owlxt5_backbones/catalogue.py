# SPDX-License-Identifier: Apache-2.0
"""Everyday objects without number: each category draws its instances' proportions, colours and materials.

The objects of CLAEO, and those of the shipped set `household`, are none of these instances; the categories
in `HELD_OUT` of that set are no category here at all.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nico_tabletop.objects import TabletopObject
from nico_tabletop.shapes import Box, Capsule, Cylinder, Ellipsoid, Lathe, Part, Rgba, Shape, Tube

Rgb = tuple[float, float, float]
Points = list[tuple[float, float]]

HELD_OUT = ("cactus", "hamburger", "hourglass", "padlock", "rubber duck", "teapot", "trophy")
"""Objects of `household` whose categories the detector never sees in training."""

COLOURS: dict[str, tuple[tuple[str, ...], Rgb]] = {
    "red": (("red", "scarlet"), (0.86, 0.08, 0.08)),
    "green": (("green", "harlequin"), (0.12, 0.65, 0.12)),
    "blue": (("blue", "azure"), (0.1, 0.2, 0.88)),
    "cyan": (("cyan", "greenish blue"), (0.1, 0.82, 0.88)),
    "yellow": (("yellow", "blonde"), (0.95, 0.86, 0.1)),
    "violet": (("violet", "purple"), (0.54, 0.1, 0.78)),
    "orange": (("orange",), (0.95, 0.5, 0.08)),
    "pink": (("pink", "rosy"), (0.96, 0.5, 0.7)),
    "brown": (("brown",), (0.42, 0.25, 0.12)),
    "white": (("white",), (0.94, 0.93, 0.9)),
    "black": (("black",), (0.08, 0.08, 0.09)),
    "grey": (("grey", "gray"), (0.5, 0.51, 0.53)),
}
"""Names of each colour, and what it looks like on average."""

_WHITE, _METAL, _BARK = (0.95, 0.94, 0.9), (0.74, 0.76, 0.79), (0.34, 0.2, 0.1)
# How much an instance's colour differs from its name's, in standard deviations of red, green and blue.
_COLOUR_SPREAD = 0.045


@dataclass(frozen=True)
class Instance:
    """One drawn object.

    Attributes:
        category: Key of `CATEGORIES`.
        names: What it can be called: the category's names.
        colours: Names of its colour; none if its parts differ much or its name implies it.
        item: What the world draws.
    """

    category: str
    names: tuple[str, ...]
    colours: tuple[str, ...]
    item: TabletopObject


class InstanceBuilder:
    """Draws numbers and colours for one instance, and collects its parts.

    Attributes:
        parts: What was added so far.
        colour_name: Key of `COLOURS` if the instance has a colour to be called by.
    """

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.parts: list[Part] = []
        self.colour_name: str | None = None

    def uniform(self, low: float, high: float) -> float:
        """A uniform number."""
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True in this share of cases."""
        return bool(self.rng.random() < share)

    def shade(self, rgb: Rgb, opacity: float = 1.0) -> Rgba:
        """A random shade of a colour."""
        shifted = np.clip(rgb + self.rng.normal(0, _COLOUR_SPREAD, 3), 0.02, 0.98)
        return (*map(float, shifted), opacity)  # type: ignore[return-value]  # three and one are four

    def colour(self, *among: str) -> Rgba:
        """A shade of one of these colours, or of any; the instance is called by it."""
        self.colour_name = str(self.rng.choice(among or [*COLOURS]))
        return self.shade(COLOURS[self.colour_name][1])

    def contrast(self) -> Rgba:
        """A shade of any other colour than the instance's."""
        return self.shade(
            COLOURS[str(self.rng.choice([name for name in COLOURS if name != self.colour_name]))][1]
        )

    def add(
        self,
        shape: Shape,
        rgba: Rgba,
        position: tuple[float, float, float] = (0.0, 0.0, 0.0),
        rotation: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        """Add a part."""
        self.parts.append(Part(shape, rgba, position, rotation))

    def turn(self, points: Points, rgba: Rgba, height: float = 0.0) -> None:
        """Add a surface of revolution."""
        self.add(Lathe(tuple(points)), rgba, (0.0, 0.0, height))

    def band(self, radius: float, low: float, high: float, rgba: Rgba) -> None:
        """Add a label, or a stripe, around a cylinder."""
        outside = [(radius + 3e-4, low + 1e-3), (radius + 3e-4, high - 1e-3)]
        self.turn([(radius, low), *outside, (radius, high), (radius, low)], rgba)


def _arc(centre: tuple[float, float], radius: float, start: float, end: float, count: int = 13) -> Points:
    """Points of a circle; 0 degrees point outwards, 90 up."""
    angles = np.deg2rad(np.linspace(start, end, count))
    return [
        (max(centre[0] + radius * float(np.cos(a)), 0.0), centre[1] + radius * float(np.sin(a)))
        for a in angles
    ]


def _ball(radius: float) -> Points:
    return _arc((0.0, radius), radius, -90, 90, 19)


def _cube(new: InstanceBuilder) -> None:
    edge = new.uniform(0.032, 0.054)
    size = tuple(edge * new.uniform(0.97, 1.03) for _ in range(3))
    new.add(Box(size), new.colour(), (0, 0, size[2] / 2))


def _sphere(new: InstanceBuilder) -> None:
    radius = new.uniform(0.017, 0.033)
    # Fruits are round and have these colours too: what tells balls from them takes many examples.
    among = ("orange", "red", "yellow") if new.chance(0.4) else ()
    new.turn(_ball(radius), new.colour(*among))
    if new.chance(0.6):  # a stripe, level or not
        width, lean = new.uniform(6, 22), 60 if new.chance(0.5) else 6
        tilt = (new.uniform(-lean, lean), new.uniform(-lean, lean), 0.0)
        stripe = Lathe(tuple(_arc((0, 0), radius * 1.01, -width, width)))
        new.add(stripe, new.contrast() if new.chance(0.5) else new.shade(_WHITE), (0, 0, radius), tilt)


def _can(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.018, 0.03), new.uniform(0.045, 0.095)
    tin, paint = new.shade(_METAL), new.colour()
    rim = new.uniform(0.002, 0.006)
    new.turn([(radius * 0.86, 0), (radius * 0.98, rim), (radius * 0.98, 2 * rim)], tin)
    new.turn([(radius * 0.98, 2 * rim), (radius, 2 * rim + 1e-3), (radius, height - rim)], paint)
    top = [(radius, height - rim), (radius * new.uniform(0.84, 0.98), height), (radius * 0.8, height - 2e-3)]
    new.turn([*top, (1e-4, height - 2e-3)], tin)
    if new.chance(0.6):
        middle, half = height * new.uniform(0.4, 0.6), height * new.uniform(0.06, 0.22)
        new.band(
            radius * 1.005,
            middle - half,
            middle + half,
            new.shade(_WHITE) if new.chance(0.5) else new.contrast(),
        )


def _handle(
    new: InstanceBuilder, radius: float, height: float, reach: float, thick: float, paint: Rgba
) -> None:
    path = tuple(_arc((radius, height), reach, -90, 90, 17))
    new.add(Tube(path, thick), paint, rotation=(0, 0, new.uniform(-180, 180)))


def _mug(new: InstanceBuilder) -> None:
    low, high, height = new.uniform(0.017, 0.027), new.uniform(0.021, 0.029), new.uniform(0.042, 0.075)
    china = new.colour()
    wall = new.uniform(0.002, 0.004)
    new.turn([(low * 0.9, 0), (low, 3e-3), (high, height), (high - wall, height), (low - wall, 5e-3)], china)
    reach = height * new.uniform(0.22, 0.34)
    _handle(new, (low + high) / 2 - 1e-3, height / 2, reach, new.uniform(0.0028, 0.005), china)
    if new.chance(0.25):
        new.band(max(low, high) + 5e-4, height * 0.3, height * 0.6, new.contrast())


def _wine_bottle(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.018, 0.026), new.uniform(0.115, 0.16)
    dark = [(0.1, 0.28, 0.12), (0.05, 0.16, 0.08), (0.22, 0.13, 0.05), (0.3, 0.36, 0.12), (0.16, 0.3, 0.3)]
    glass = new.shade(dark[new.rng.integers(len(dark))], new.uniform(0.65, 1.0))
    neck, shoulder = radius * new.uniform(0.3, 0.42), height * new.uniform(0.5, 0.62)
    slope = shoulder + height * new.uniform(0.08, 0.2)
    lip = [(neck, height - 6e-3), (neck * 1.25, height - 5e-3), (neck * 1.25, height), (neck * 0.9, height)]
    side = [
        (radius * 0.9, 0),
        (radius, 3e-3),
        (radius, shoulder),
        (radius * 0.85, (shoulder * 2 + slope) / 3),
    ]
    new.turn([*side, (neck * 1.15, slope), (neck, slope + 6e-3), *lip], glass)
    if new.chance(0.75):
        low = height * new.uniform(0.1, 0.2)
        paper = new.shade(_WHITE) if new.chance(0.6) else new.contrast()
        new.band(radius * 1.012, low, low + height * new.uniform(0.15, 0.28), paper)
    if new.chance(0.3):  # foil, or a cork
        new.turn([(neck * 1.3, height * 0.85), (neck * 1.32, height), (1e-4, height + 2e-3)], new.contrast())


def _water_bottle(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.018, 0.026), new.uniform(0.1, 0.15)
    clear = new.shade((0.6, 0.78, 0.9), new.uniform(0.45, 0.75))
    neck = radius * new.uniform(0.4, 0.5)
    body = [(radius * 0.9, 0), (radius, 3e-3), (radius * 0.93, height * 0.35), (radius, height * 0.62)]
    new.turn([*body, (neck, height * 0.86), (neck, height * 0.9)], clear)
    cap = neck * 1.12
    new.turn(
        [(cap, height * 0.9), (cap, height), (1e-4, height)],
        new.shade(COLOURS["blue"][1]) if new.chance(0.6) else new.contrast(),
    )
    if new.chance(0.6):
        new.band(radius * 1.01, height * 0.4, height * 0.58, new.contrast())


def _squeeze_bottle(new: InstanceBuilder, body: Rgb, nozzles: tuple[str, ...]) -> None:
    radius, height = new.uniform(0.021, 0.029), new.uniform(0.075, 0.1)
    neck, flat = radius * new.uniform(0.45, 0.62), height * new.uniform(0.62, 0.8)
    new.turn(
        [
            (radius * 0.9, 0),
            (radius, 4e-3),
            (radius, flat),
            (radius * 0.9, (flat + height) / 2),
            (neck, height),
        ],
        new.shade(body),
    )
    if new.chance(0.75):
        low = height * new.uniform(0.15, 0.3)
        paper = new.shade(_WHITE) if new.chance(0.6) else new.contrast()
        new.band(radius * 1.012, low, low + height * new.uniform(0.2, 0.38), paper)
    lid, tip = height * new.uniform(1.08, 1.2), height * new.uniform(1.25, 1.5)
    nozzle = new.shade(COLOURS[str(new.rng.choice(nozzles))][1])
    new.turn([(neck, height - 2e-3), (neck * 1.05, lid - 4e-3), (neck * 0.5, lid), (2.5e-3, tip)], nozzle)


def _mustard_bottle(new: InstanceBuilder) -> None:
    _squeeze_bottle(new, (0.93, 0.76, 0.08), ("red", "yellow", "green", "white", "brown"))


def _ketchup_bottle(new: InstanceBuilder) -> None:
    _squeeze_bottle(new, (0.8, 0.08, 0.06), ("white", "red", "green", "black"))


def _pawn(new: InstanceBuilder) -> None:
    _chessman(new, "pawn")


def _chess_piece(new: InstanceBuilder) -> None:
    _chessman(new, "bishop", "rook", "queen")


def _chessman(new: InstanceBuilder, *kinds: str) -> None:
    foot, height = new.uniform(0.018, 0.026), new.uniform(0.055, 0.1)
    wood = new.colour("white", "black", "brown") if new.chance(0.8) else new.colour()
    waist, collar = foot * new.uniform(0.32, 0.5), foot * new.uniform(0.55, 0.75)
    low, top = height * new.uniform(0.12, 0.2), height * new.uniform(0.62, 0.72)
    base = [
        (foot, 0),
        (foot, low * 0.55),
        (foot * 0.8, low * 0.8),
        (foot * 0.82, low),
        (waist * 1.25, low * 1.6),
    ]
    stem = [(waist, top * 0.85), (collar, top * 0.94), (collar, top), (waist * 0.95, top + 2e-3)]
    room = height - top
    heads = {
        "pawn": _arc((0.0, top + room * 0.55), room * 0.52, -50, 90),
        "bishop": [
            (collar * 0.6, top + room * 0.2),
            (collar * 0.72, top + room * 0.42),
            (1e-3, height),
            (2e-3, height + 3e-3),
        ],
        "rook": [
            (collar * 0.9, top + room * 0.2),
            (collar * 1.05, height),
            (collar * 0.7, height),
            (collar * 0.7, height - 4e-3),
            (1e-4, height - 4e-3),
        ],
        "queen": [
            (collar * 0.6, top + room * 0.2),
            (collar * 1.05, height),
            (collar * 0.3, height - 1e-3),
            (3e-3, height + 5e-3),
        ],
    }
    head = heads[str(new.rng.choice(kinds))]
    new.turn([*base, *stem, *head], wood)


def _bowl(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.03, 0.048), new.uniform(0.018, 0.034)
    foot, wall = radius * new.uniform(0.4, 0.6), new.uniform(0.0015, 0.004)
    outside = [(foot, 0), (foot * 1.1, 2e-3), (radius * 0.85, height * 0.45), (radius, height)]
    new.turn(
        [*outside, (radius - wall, height), (radius * 0.8, height * 0.5), (foot, 4e-3), (1e-4, 3.5e-3)],
        new.colour(),
    )


def _plate(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.036, 0.055), new.uniform(0.005, 0.012)
    inner = radius * new.uniform(0.6, 0.75)
    outside = [(inner, 0), (radius, height), (radius - 1.5e-3, height + 1e-3)]
    new.turn([*outside, (inner * 0.95, 2.5e-3), (1e-4, 2.5e-3)], new.colour())


def _glass(new: InstanceBuilder) -> None:
    low, high, height = new.uniform(0.015, 0.024), new.uniform(0.019, 0.028), new.uniform(0.05, 0.1)
    clear = new.shade((0.75, 0.85, 0.9), new.uniform(0.3, 0.5))
    new.turn([(low, 0), (high, height), (high - 2e-3, height), (low - 2e-3, 4e-3), (1e-4, 4e-3)], clear)


def _jar(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.02, 0.03), new.uniform(0.045, 0.075)
    fills = [(0.6, 0.08, 0.12), (0.85, 0.5, 0.1), (0.3, 0.4, 0.15), (0.4, 0.22, 0.1), (0.8, 0.85, 0.88)]
    new.turn(
        [(radius * 0.92, 0), (radius, 3e-3), (radius, height * 0.78), (radius * 0.85, height * 0.86)],
        new.shade(fills[new.rng.integers(len(fills))], new.uniform(0.8, 1)),
    )
    lid = radius * 0.93
    new.turn(
        [(lid, height * 0.85), (lid, height - 1e-3), (lid * 0.95, height), (1e-4, height)], new.contrast()
    )
    if new.chance(0.5):
        new.band(radius * 1.01, height * 0.2, height * 0.62, new.shade(_WHITE))


def _box(new: InstanceBuilder) -> None:
    size = (new.uniform(0.018, 0.035), new.uniform(0.035, 0.06), new.uniform(0.05, 0.1))
    new.add(Box(size), new.colour(), (0, 0, size[2] / 2))
    for side in (-1, 1):  # print on both faces
        label = (1e-3, size[1] * new.uniform(0.4, 0.85), size[2] * new.uniform(0.2, 0.5))
        new.add(Box(label), new.contrast(), (side * size[0] / 2, 0, size[2] * new.uniform(0.4, 0.65)))


def _book(new: InstanceBuilder) -> None:
    long, wide, thick = new.uniform(0.06, 0.085), new.uniform(0.042, 0.06), new.uniform(0.008, 0.022)
    cover = new.colour()
    new.add(Box((long, wide, thick)), cover, (0, 0, thick / 2))
    new.add(Box((long * 0.96, wide * 0.5, thick * 0.8)), new.shade(_WHITE), (0, wide * 0.26, thick / 2))
    if new.chance(0.7):
        title = (long * new.uniform(0.1, 0.3), wide * new.uniform(0.4, 0.7), 1e-3)
        new.add(Box(title), new.contrast(), (long * new.uniform(-0.2, 0.25), 0, thick))


def _candle(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.008, 0.02), new.uniform(0.05, 0.11)
    new.turn(
        [(radius, 0), (radius, height - 2e-3), (radius * 0.8, height), (1e-4, height - 1e-3)], new.colour()
    )
    new.add(Capsule(8e-4, 0.01), new.shade((0.1, 0.1, 0.1)), (0, 0, height + 4e-3))
    if new.chance(0.6):
        new.turn([(2e-3, 0), (3.5e-3, 4e-3), (1e-4, 0.014)], new.shade((1, 0.75, 0.2)), height + 6e-3)
    if new.chance(0.5):  # a holder
        plate = radius * new.uniform(1.4, 2.2)
        new.turn(
            [(plate, 0), (plate, 3e-3), (radius * 1.1, 4e-3), (radius * 1.15, 0.014), (radius, 0.014)],
            new.shade(_METAL),
        )


def _traffic_cone(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.017, 0.026), new.uniform(0.055, 0.09)
    paint, edge = new.shade((0.96, 0.4, 0.06)), new.uniform(0.045, 0.06)
    new.add(Box((edge, edge, 5e-3)), paint if new.chance(0.6) else new.shade((0.1, 0.1, 0.1)), (0, 0, 2.5e-3))
    new.turn([(radius, 4e-3), (radius * 0.2, height), (1e-4, height)], paint)
    for low in ((0.4,), (0.3, 0.6))[new.rng.integers(2)]:
        r = [radius * (1 - 0.8 * share) + 6e-4 for share in (low, low + 0.16)]
        new.turn([(r[0], height * low), (r[1], height * (low + 0.16))], new.shade(_WHITE))


def _cone(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.02, 0.032), new.uniform(0.04, 0.075)
    new.turn([(radius, 0), (1e-4, height)], new.colour())


def _pyramid(new: InstanceBuilder) -> None:
    edge, height = new.uniform(0.035, 0.055), new.uniform(0.03, 0.055)
    steps = 12
    colour = new.colour()
    for k in range(steps):
        wide = edge * (1 - k / steps)
        new.add(Box((wide, wide, height / steps)), colour, (0, 0, height * (k + 0.5) / steps))


def _cylinder(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.014, 0.027), new.uniform(0.025, 0.08)
    new.add(Cylinder(radius, height), new.colour(), (0, 0, height / 2))


def _ring(new: InstanceBuilder) -> None:
    _torus(new, new.uniform(0.018, 0.032), new.uniform(0.003, 0.006), new.colour())


def _torus(new: InstanceBuilder, radius: float, thick: float, paint: Rgba) -> None:
    new.turn(_arc((radius, thick), thick, -180, 180, 17), paint)


def _donut(new: InstanceBuilder) -> None:
    radius, thick = new.uniform(0.018, 0.025), new.uniform(0.009, 0.0125)
    _torus(new, radius, thick, new.shade((0.78, 0.54, 0.28)))
    icing = new.shade(((0.95, 0.55, 0.7), (0.3, 0.16, 0.08), (0.95, 0.94, 0.92))[new.rng.integers(3)])
    top = _arc((radius, thick), thick * 1.04, new.uniform(-5, 15), 175, 13)
    new.turn([*top, top[0]], icing)


def _egg(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.016, 0.022), new.uniform(0.045, 0.06)
    angles = np.linspace(-np.pi / 2, np.pi / 2, 17)
    points = [
        (radius * float(np.cos(a)) * (1 - 0.13 * float(np.sin(a))), height / 2 * (1 + float(np.sin(a))))
        for a in angles
    ]
    new.turn(points, new.shade(((0.95, 0.9, 0.82), (0.8, 0.58, 0.42))[new.rng.integers(2)]))


def _fruit_stem(new: InstanceBuilder, height: float, leaf: float) -> None:
    new.add(
        Capsule(1.6e-3, 0.018),
        new.shade(_BARK),
        (0, 0, height),
        (new.uniform(-20, 20), new.uniform(-20, 20), 0),
    )
    if new.chance(leaf):
        turn = new.uniform(-180, 180)
        place = (
            0.01 * float(np.sin(np.deg2rad(turn))),
            -0.01 * float(np.cos(np.deg2rad(turn))),
            height + 4e-3,
        )
        new.add(Ellipsoid((0.006, 0.011, 0.0015)), new.shade((0.15, 0.55, 0.15)), place, (-20, 0, turn))


def _apple(new: InstanceBuilder) -> None:
    r = new.uniform(0.02, 0.028)
    skins = [(0.8, 0.08, 0.1), (0.45, 0.7, 0.15), (0.9, 0.75, 0.2), (0.75, 0.25, 0.1)]
    outline = [
        (0.12, 0.1),
        (0.5, 0),
        (0.8, 0.3),
        (0.97, 0.75),
        (1, 1.1),
        (0.92, 1.5),
        (0.62, 1.75),
        (0.3, 1.7),
        (0.04, 1.45),
    ]
    new.turn([(r * a, r * b) for a, b in outline], new.shade(skins[new.rng.integers(len(skins))]))
    _fruit_stem(new, r * 1.85, 0.6)


def _orange(new: InstanceBuilder) -> None:
    radius = new.uniform(0.02, 0.028)
    new.turn(_ball(radius), new.shade((0.96, 0.52, 0.06)))
    _fruit_stem(new, radius * 2, 1.0)  # without a leaf it would be an orange ball


def _pear(new: InstanceBuilder) -> None:
    r = new.uniform(0.018, 0.024)
    outline = [
        (0.2, 0),
        (0.7, 0.12),
        (1, 0.6),
        (1, 1.1),
        (0.8, 1.7),
        (0.5, 2.25),
        (0.45, 2.6),
        (0.3, 2.95),
        (0.03, 3),
    ]
    new.turn(
        [(r * a, r * b) for a, b in outline],
        new.shade(((0.7, 0.75, 0.15), (0.45, 0.6, 0.15), (0.85, 0.72, 0.2))[new.rng.integers(3)]),
    )
    _fruit_stem(new, r * 3.1, 0.4)


def _lemon(new: InstanceBuilder) -> None:
    r = new.uniform(0.016, 0.021)
    outline = [(0.05, -1.6), (0.2, -1.45), (0.7, -1), (1, 0), (0.7, 1), (0.22, 1.45), (0.05, 1.6)]
    new.add(
        Lathe(tuple((r * a, r * b) for a, b in outline)),
        new.shade((0.96, 0.88, 0.12)),
        (0, 0, r),
        (90, 0, 0),
    )


def _banana(new: InstanceBuilder) -> None:
    bend, thick = new.uniform(0.038, 0.05), new.uniform(0.008, 0.011)
    skin, tip = new.shade((0.95, 0.82, 0.14)), new.shade((0.25, 0.16, 0.06))
    half = new.uniform(42, 60)
    centre = (bend * 0.6, 0.0)
    points = np.array(
        [
            (centre[0] + bend * np.cos(a), bend * np.sin(a))
            for a in np.deg2rad(np.linspace(180 - half, 180 + half, 15))
        ]
    )
    new.add(Tube(tuple(map(tuple, points.tolist())), thick), skin, (0, 0, thick), (90, 0, 0))
    for end in (points[0], points[-1]):
        new.add(
            Ellipsoid((thick * 0.5, thick * 0.5, thick * 0.5)), tip, (float(end[0]), -float(end[1]), thick)
        )


def _carrot(new: InstanceBuilder) -> None:
    radius, length = new.uniform(0.012, 0.019), new.uniform(0.065, 0.1)
    root = [
        (1e-3, 0),
        (radius * 0.35, length * 0.1),
        (radius * 0.65, length * 0.5),
        (radius, length * 0.92),
        (radius * 0.7, length),
        (1e-4, length),
    ]
    lying = (90.0, 0.0, 0.0)
    new.add(Lathe(tuple(root)), new.shade((0.95, 0.48, 0.1)), (0, length / 2, radius), lying)
    for lean in (-15, 0, 15):
        new.add(
            Capsule(1.8e-3, 0.03),
            new.shade((0.2, 0.55, 0.15)),
            (lean * 3e-4, -length / 2 - 0.008, radius),
            (90, lean, 0),
        )


def _mushroom(new: InstanceBuilder) -> None:
    stem, cap = new.uniform(0.008, 0.013), new.uniform(0.02, 0.03)
    height = new.uniform(0.03, 0.045)
    new.turn([(stem * 1.15, 0), (stem, height * 0.4), (stem * 0.9, height)], new.shade((0.93, 0.9, 0.82)))
    new.turn(
        [(1e-4, height * 0.8), *_arc((0, height * 0.82), cap, 0, 90)],
        new.shade(((0.8, 0.1, 0.08), (0.55, 0.36, 0.2), (0.88, 0.8, 0.68))[new.rng.integers(3)]),
    )


def _ice_cream(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.015, 0.02), new.uniform(0.05, 0.065)
    new.turn([(3e-3, 0), (radius, height)], new.shade((0.82, 0.6, 0.32)))
    flavours = [(0.97, 0.93, 0.8), (0.95, 0.6, 0.7), (0.36, 0.2, 0.1), (0.6, 0.85, 0.55)]
    ball = new.shade(flavours[new.rng.integers(len(flavours))])
    new.add(Ellipsoid((radius * 1.15,) * 3), ball, (0, 0, height + radius * 0.5))
    if new.chance(0.4):
        second = new.shade(flavours[new.rng.integers(len(flavours))])
        new.add(Ellipsoid((radius * 0.95,) * 3), second, (0, 0, height + radius * 1.8))


def _dice(new: InstanceBuilder) -> None:
    edge = new.uniform(0.026, 0.042)
    paint = new.colour("white", "red", "blue", "black", "green")
    spot = new.shade((0.06, 0.06, 0.06)) if _bright(paint) else new.shade(_WHITE)
    new.add(Box((edge,) * 3), paint, (0, 0, edge / 2))
    far = edge * 0.26
    layouts: list[list[tuple[float, float]]] = [
        [(0, 0)],
        [(-far, -far), (far, far)],
        [(-far, -far), (0, 0), (far, far)],
        [(a * far, b * far) for a in (-1, 1) for b in (-1, 1)],
        [(a * far, b * far) for a in (-1, 1) for b in (-1, 1)] + [(0, 0)],
        [(a * far, b * far) for a in (-1, 1) for b in (-1, 0, 1)],
    ]
    new.rng.shuffle(layouts)
    half, flat, wide = edge / 2, 6e-4, edge * 0.085
    for u, v in layouts[0]:
        new.add(Ellipsoid((wide, wide, flat)), spot, (u, v, edge))
    for side, layout in zip((-1, 1), layouts[1:3], strict=True):
        for u, v in layout:
            new.add(Ellipsoid((flat, wide, wide)), spot, (side * half, u, half + v))
    for side, layout in zip((-1, 1), layouts[3:5], strict=True):
        for u, v in layout:
            new.add(Ellipsoid((wide, flat, wide)), spot, (u, side * half, half + v))


def _bright(rgba: Rgba) -> bool:
    """Whether dark print shows on a colour."""
    return sum(rgba[:3]) > 1.6


def _light_bulb(new: InstanceBuilder) -> None:
    radius = new.uniform(0.018, 0.024)
    neck, base = radius * 0.5, new.uniform(0.014, 0.02)
    new.turn([(neck * 0.5, 0), (neck * 0.9, 3e-3), (neck, 4e-3), (neck, base)], new.shade(_METAL))
    middle = base + radius * 1.3
    glass = new.shade((0.98, 0.95, 0.8), new.uniform(0.75, 1))
    new.turn([(neck, base), (neck * 1.1, base + radius * 0.3), *_arc((0, middle), radius, -40, 90)], glass)


def _lamp(new: InstanceBuilder) -> None:
    foot, height = new.uniform(0.02, 0.028), new.uniform(0.08, 0.11)
    metal = new.shade(_METAL) if new.chance(0.5) else new.contrast()
    shade = new.colour()
    new.turn([(foot, 0), (foot, 4e-3), (4e-3, 8e-3), (3e-3, height * 0.6)], metal)
    wide, narrow = new.uniform(0.026, 0.036), new.uniform(0.012, 0.024)
    new.turn(
        [(wide, height * 0.55), (narrow, height), (narrow - 1.5e-3, height), (wide - 1.5e-3, height * 0.55)],
        shade,
    )


def _toy_car(new: InstanceBuilder) -> None:
    long, wide = new.uniform(0.06, 0.08), new.uniform(0.028, 0.036)
    wheel, low = new.uniform(0.007, 0.01), new.uniform(0.012, 0.016)
    paint = new.colour()
    new.add(Box((long, wide, low)), paint, (0, 0, wheel + low / 2))
    cabin = (long * new.uniform(0.4, 0.6), wide * 0.88, low * new.uniform(0.8, 1.1))
    back = -long * new.uniform(0, 0.12)
    new.add(Box(cabin), new.shade((0.3, 0.4, 0.5)), (back, 0, wheel + low + cabin[2] / 2))
    new.add(Box((cabin[0] * 0.9, cabin[1] * 1.02, 2e-3)), paint, (back, 0, wheel + low + cabin[2]))
    for x in (-0.3, 0.3):
        for y in (-0.5, 0.5):
            new.add(
                Cylinder(wheel, 6e-3), new.shade((0.07, 0.07, 0.07)), (x * long, y * wide, wheel), (90, 0, 0)
            )


def _spray_can(new: InstanceBuilder) -> None:
    radius, height = new.uniform(0.014, 0.02), new.uniform(0.08, 0.12)
    new.turn(
        [(radius * 0.95, 0), (radius, 2e-3), (radius, height), (radius * 0.6, height * 1.06)], new.colour()
    )
    cap = radius * new.uniform(0.6, 0.92)
    new.turn(
        [(cap, height * 1.04), (cap, height * 1.25), (cap * 0.7, height * 1.28), (1e-4, height * 1.28)],
        new.contrast(),
    )


def _vase(new: InstanceBuilder) -> None:
    belly, height = new.uniform(0.022, 0.034), new.uniform(0.07, 0.12)
    neck, lip = belly * new.uniform(0.3, 0.55), belly * new.uniform(0.5, 0.9)
    middle = height * new.uniform(0.3, 0.5)
    china = new.colour()
    new.turn(
        [
            (belly * 0.6, 0),
            (belly * 0.9, middle * 0.5),
            (belly, middle),
            (neck, height * 0.8),
            (lip, height),
            (lip - 2e-3, height),
            (neck - 2e-3, height * 0.8),
            (belly - 3e-3, middle),
            (1e-4, 5e-3),
        ],
        china,
    )


def _house(new: InstanceBuilder) -> None:
    wide, deep, wall = new.uniform(0.036, 0.05), new.uniform(0.036, 0.05), new.uniform(0.025, 0.04)
    new.add(
        Box((wide, deep, wall)), new.shade(_WHITE) if new.chance(0.5) else new.contrast(), (0, 0, wall / 2)
    )
    tiles, steps, roof = new.colour("red", "brown", "grey", "blue"), 8, new.uniform(0.018, 0.028)
    for k in range(steps):
        new.add(
            Box((wide * 1.1, deep * 1.15 * (1 - k / steps), roof / steps)),
            tiles,
            (0, 0, wall + roof * (k + 0.5) / steps),
        )
    new.add(Box((1e-3, deep * 0.25, wall * 0.6)), new.shade(_BARK), (-wide / 2, 0, wall * 0.3))


def _tree(new: InstanceBuilder) -> None:
    trunk, height = new.uniform(0.004, 0.007), new.uniform(0.07, 0.11)
    leaves = new.shade((0.12, 0.42, 0.14))
    new.add(Cylinder(trunk, height * 0.4), new.shade(_BARK), (0, 0, height * 0.2))
    wide = new.uniform(0.022, 0.034)
    if new.chance(0.5):
        for k in range(3):
            low = height * (0.2 + 0.22 * k)
            new.turn([(wide * (1 - 0.22 * k), low), (1e-4, low + height * 0.38)], leaves)
    else:
        new.add(Ellipsoid((wide, wide, wide * new.uniform(0.9, 1.2))), leaves, (0, 0, height * 0.65))


def _snowman(new: InstanceBuilder) -> None:
    radius, at = new.uniform(0.02, 0.026), 0.0
    for share in (1.0, 0.75, 0.55):
        at += radius * share * 0.9
        new.add(Ellipsoid((radius * share,) * 3), new.shade((0.95, 0.95, 0.97)), (0, 0, at))
        at += radius * share * 0.8
    hat = radius * 0.4
    new.turn(
        [(hat * 1.6, at - 2e-3), (hat * 1.6, at), (hat, at), (hat, at + hat * 1.6), (1e-4, at + hat * 1.6)],
        new.shade((0.07, 0.07, 0.08)),
    )
    new.turn([(2.5e-3, 0), (1e-4, 0.014)], new.shade((0.95, 0.5, 0.1)))
    nose = new.parts.pop()
    new.add(nose.shape, nose.rgba, (-radius * 0.5, 0, at - radius * 0.5), (0, -90, 0))


def _pen(new: InstanceBuilder) -> None:
    radius, length = new.uniform(0.004, 0.007), new.uniform(0.085, 0.11)
    new.add(
        Lathe(((radius, 0), (radius, length * 0.85), (1e-3, length))),
        new.colour(),
        (0, length / 2, radius),
        (90, 0, 0),
    )
    new.add(Cylinder(radius * 1.1, length * 0.25), new.contrast(), (0, length * 0.38, radius), (90, 0, 0))


def _hammer(new: InstanceBuilder) -> None:
    length, head = new.uniform(0.08, 0.105), new.uniform(0.035, 0.048)
    grip = new.shade((0.66, 0.45, 0.24)) if new.chance(0.6) else new.contrast()
    new.add(Capsule(5e-3, length), grip, (0, 0, 8e-3), (90, 0, 0))
    new.add(Box((head, 0.016, 0.016)), new.shade((0.35, 0.36, 0.38)), (0, -length * 0.45, 8e-3))


def _spoon(new: InstanceBuilder) -> None:
    length, metal = (
        new.uniform(0.075, 0.1),
        new.shade(_METAL) if new.chance(0.6) else new.shade((0.66, 0.45, 0.24)),
    )
    new.add(Box((5e-3, length * 0.7, 2.5e-3)), metal, (0, length * 0.15, 3e-3))
    new.add(Ellipsoid((0.012, 0.018, 3e-3)), metal, (0, -length * 0.35, 3e-3))


CATEGORIES: dict[str, tuple[tuple[str, ...], Callable[[InstanceBuilder], None]]] = {
    "cube": (("cube", "block"), _cube),
    "ball": (("ball", "sphere"), _sphere),
    "can": (("can", "tin", "soda can"), _can),
    "mug": (("mug", "cup"), _mug),
    "wine bottle": (("wine bottle", "empty wine bottle", "flask", "bottle"), _wine_bottle),
    "water bottle": (("water bottle", "plastic bottle", "bottle"), _water_bottle),
    "mustard bottle": (("mustard bottle", "mustard", "bottle"), _mustard_bottle),
    "ketchup bottle": (("ketchup bottle", "ketchup", "bottle"), _ketchup_bottle),
    "chess piece": (("chess piece", "chessman"), _chess_piece),
    "pawn": (("pawn", "chess piece", "chessman"), _pawn),
    "bowl": (("bowl", "dish"), _bowl),
    "plate": (("plate",), _plate),
    "glass": (("glass", "tumbler"), _glass),
    "jar": (("jar", "jam jar"), _jar),
    "box": (("box", "carton", "package"), _box),
    "book": (("book",), _book),
    "candle": (("candle", "candlestick"), _candle),
    "traffic cone": (("traffic cone", "pylon"), _traffic_cone),
    "cone": (("cone",), _cone),
    "pyramid": (("pyramid",), _pyramid),
    "cylinder": (("cylinder",), _cylinder),
    "ring": (("ring", "hoop"), _ring),
    "donut": (("donut", "doughnut"), _donut),
    "egg": (("egg",), _egg),
    "apple": (("apple",), _apple),
    "orange": (("orange fruit", "tangerine"), _orange),
    "pear": (("pear",), _pear),
    "lemon": (("lemon",), _lemon),
    "banana": (("banana",), _banana),
    "carrot": (("carrot",), _carrot),
    "mushroom": (("mushroom", "toadstool"), _mushroom),
    "ice cream cone": (("ice cream cone", "ice cream"), _ice_cream),
    "dice": (("dice", "die"), _dice),
    "light bulb": (("light bulb", "bulb"), _light_bulb),
    "lamp": (("lamp", "table lamp"), _lamp),
    "toy car": (("toy car", "car"), _toy_car),
    "spray can": (("spray can", "aerosol"), _spray_can),
    "vase": (("vase",), _vase),
    "house": (("house", "toy house"), _house),
    "tree": (("tree", "toy tree"), _tree),
    "snowman": (("snowman",), _snowman),
    "pen": (("pen", "marker"), _pen),
    "hammer": (("hammer",), _hammer),
    "spoon": (("spoon",), _spoon),
}
"""Names of each category, the first the usual one, and how its instances are drawn."""


def draw_instance(rng: np.random.Generator, category: str, label: str) -> Instance:
    """Draw an instance of a category.

    Args:
        rng: Where its proportions and colours come from.
        category: Key of `CATEGORIES`.
        label: The name of its body in the world, not known to who looks at it.
    """
    names, draw = CATEGORIES[category]
    new = InstanceBuilder(rng)
    draw(new)
    colours = COLOURS[new.colour_name][0] if new.colour_name else ()
    return Instance(category, names, colours, TabletopObject(label, (), tuple(new.parts)))
