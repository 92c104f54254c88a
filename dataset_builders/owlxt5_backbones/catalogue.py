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

HELD_OUT = ("cactus", "hamburger", "hourglass", "padlock", "rubber duck", "teapot", "trophy")
"""Objects of `household` whose categories the eyes never see in training."""

COLOURS: dict[str, tuple[tuple[str, ...], tuple[float, float, float]]] = {
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

Points = list[tuple[float, float]]


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


class Brush:
    """Draws numbers and colours for one instance, and collects its parts.

    Attributes:
        parts: What was added so far.
        colour: Key of `COLOURS` if the instance has a colour to be called by.
    """

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self.parts: list[Part] = []
        self.colour: str | None = None

    def within(self, low: float, high: float) -> float:
        """A uniform number."""
        return float(self.random.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True in this share of cases."""
        return bool(self.random.random() < share)

    def near(self, rgb: tuple[float, float, float], opacity: float = 1.0) -> Rgba:
        """A colour like this one."""
        shifted = np.clip(rgb + self.random.normal(0, _COLOUR_SPREAD, 3), 0.02, 0.98)
        return (*map(float, shifted), opacity)  # type: ignore[return-value]  # three and one are four

    def named(self, *among: str) -> Rgba:
        """A colour with a name, which becomes the instance's."""
        self.colour = str(self.random.choice(among or [*COLOURS]))
        return self.near(COLOURS[self.colour][1])

    def other(self) -> Rgba:
        """Any other colour than the instance's."""
        return self.near(
            COLOURS[str(self.random.choice([name for name in COLOURS if name != self.colour]))][1]
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


def _cube(brush: Brush) -> None:
    edge = brush.within(0.032, 0.054)
    size = tuple(edge * brush.within(0.97, 1.03) for _ in range(3))
    brush.add(Box(size), brush.named(), (0, 0, size[2] / 2))


def _sphere(brush: Brush) -> None:
    radius = brush.within(0.017, 0.033)
    brush.turn(_ball(radius), brush.named())
    if brush.chance(0.6):  # a stripe, level or not
        width, lean = brush.within(6, 22), 60 if brush.chance(0.7) else 6
        tilt = (brush.within(-lean, lean), brush.within(-lean, lean), 0.0)
        stripe = Lathe(tuple(_arc((0, 0), radius * 1.01, -width, width)))
        brush.add(stripe, brush.other() if brush.chance(0.5) else brush.near(_WHITE), (0, 0, radius), tilt)


def _can(brush: Brush) -> None:
    radius, height = brush.within(0.018, 0.03), brush.within(0.045, 0.095)
    tin, paint = brush.near(_METAL), brush.named()
    rim = brush.within(0.002, 0.006)
    brush.turn([(radius * 0.86, 0), (radius * 0.98, rim), (radius * 0.98, 2 * rim)], tin)
    brush.turn([(radius * 0.98, 2 * rim), (radius, 2 * rim + 1e-3), (radius, height - rim)], paint)
    top = [(radius, height - rim), (radius * brush.within(0.84, 0.98), height), (radius * 0.8, height - 2e-3)]
    brush.turn([*top, (1e-4, height - 2e-3)], tin)
    if brush.chance(0.6):
        middle, half = height * brush.within(0.4, 0.6), height * brush.within(0.06, 0.22)
        brush.band(
            radius * 1.005,
            middle - half,
            middle + half,
            brush.near(_WHITE) if brush.chance(0.5) else brush.other(),
        )


def _handle(brush: Brush, radius: float, height: float, reach: float, thick: float, paint: Rgba) -> None:
    path = tuple(_arc((radius, height), reach, -90, 90, 17))
    brush.add(Tube(path, thick), paint, rotation=(0, 0, brush.within(-180, 180)))


def _mug(brush: Brush) -> None:
    low, high, height = brush.within(0.017, 0.027), brush.within(0.021, 0.029), brush.within(0.042, 0.075)
    china = brush.named()
    wall = brush.within(0.002, 0.004)
    brush.turn(
        [(low * 0.9, 0), (low, 3e-3), (high, height), (high - wall, height), (low - wall, 5e-3)], china
    )
    reach = height * brush.within(0.22, 0.34)
    _handle(brush, (low + high) / 2 - 1e-3, height / 2, reach, brush.within(0.0028, 0.005), china)
    if brush.chance(0.25):
        brush.band(max(low, high) + 5e-4, height * 0.3, height * 0.6, brush.other())


def _wine_bottle(brush: Brush) -> None:
    radius, height = brush.within(0.018, 0.026), brush.within(0.115, 0.16)
    dark = [(0.1, 0.28, 0.12), (0.05, 0.16, 0.08), (0.22, 0.13, 0.05), (0.3, 0.36, 0.12), (0.16, 0.3, 0.3)]
    glass = brush.near(dark[brush.random.integers(len(dark))], brush.within(0.65, 1.0))
    neck, shoulder = radius * brush.within(0.3, 0.42), height * brush.within(0.5, 0.62)
    slope = shoulder + height * brush.within(0.08, 0.2)
    lip = [(neck, height - 6e-3), (neck * 1.25, height - 5e-3), (neck * 1.25, height), (neck * 0.9, height)]
    side = [
        (radius * 0.9, 0),
        (radius, 3e-3),
        (radius, shoulder),
        (radius * 0.85, (shoulder * 2 + slope) / 3),
    ]
    brush.turn([*side, (neck * 1.15, slope), (neck, slope + 6e-3), *lip], glass)
    if brush.chance(0.75):
        low = height * brush.within(0.1, 0.2)
        paper = brush.near(_WHITE) if brush.chance(0.6) else brush.other()
        brush.band(radius * 1.012, low, low + height * brush.within(0.15, 0.28), paper)
    if brush.chance(0.3):  # foil, or a cork
        brush.turn([(neck * 1.3, height * 0.85), (neck * 1.32, height), (1e-4, height + 2e-3)], brush.other())


def _water_bottle(brush: Brush) -> None:
    radius, height = brush.within(0.018, 0.026), brush.within(0.1, 0.15)
    clear = brush.near((0.6, 0.78, 0.9), brush.within(0.45, 0.75))
    neck = radius * brush.within(0.4, 0.5)
    body = [(radius * 0.9, 0), (radius, 3e-3), (radius * 0.93, height * 0.35), (radius, height * 0.62)]
    brush.turn([*body, (neck, height * 0.86), (neck, height * 0.9)], clear)
    cap = neck * 1.12
    brush.turn(
        [(cap, height * 0.9), (cap, height), (1e-4, height)],
        brush.near(COLOURS["blue"][1]) if brush.chance(0.6) else brush.other(),
    )
    if brush.chance(0.6):
        brush.band(radius * 1.01, height * 0.4, height * 0.58, brush.other())


def _squeeze_bottle(brush: Brush, body: tuple[float, float, float], nozzles: tuple[str, ...]) -> None:
    radius, height = brush.within(0.021, 0.029), brush.within(0.075, 0.1)
    neck, flat = radius * brush.within(0.45, 0.62), height * brush.within(0.62, 0.8)
    brush.turn(
        [
            (radius * 0.9, 0),
            (radius, 4e-3),
            (radius, flat),
            (radius * 0.9, (flat + height) / 2),
            (neck, height),
        ],
        brush.near(body),
    )
    if brush.chance(0.75):
        low = height * brush.within(0.15, 0.3)
        paper = brush.near(_WHITE) if brush.chance(0.6) else brush.other()
        brush.band(radius * 1.012, low, low + height * brush.within(0.2, 0.38), paper)
    lid, tip = height * brush.within(1.08, 1.2), height * brush.within(1.25, 1.5)
    nozzle = brush.near(COLOURS[str(brush.random.choice(nozzles))][1])
    brush.turn([(neck, height - 2e-3), (neck * 1.05, lid - 4e-3), (neck * 0.5, lid), (2.5e-3, tip)], nozzle)


def _mustard_bottle(brush: Brush) -> None:
    _squeeze_bottle(brush, (0.93, 0.76, 0.08), ("red", "yellow", "green", "white", "brown"))


def _ketchup_bottle(brush: Brush) -> None:
    _squeeze_bottle(brush, (0.8, 0.08, 0.06), ("white", "red", "green", "black"))


def _pawn(brush: Brush) -> None:
    _chessman(brush, "pawn")


def _chess_piece(brush: Brush) -> None:
    _chessman(brush, "bishop", "rook", "queen")


def _chessman(brush: Brush, *kinds: str) -> None:
    foot, height = brush.within(0.018, 0.026), brush.within(0.055, 0.1)
    wood = brush.named("white", "black", "brown") if brush.chance(0.8) else brush.named()
    waist, collar = foot * brush.within(0.32, 0.5), foot * brush.within(0.55, 0.75)
    low, top = height * brush.within(0.12, 0.2), height * brush.within(0.62, 0.72)
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
    head = heads[str(brush.random.choice(kinds))]
    brush.turn([*base, *stem, *head], wood)


def _bowl(brush: Brush) -> None:
    radius, height = brush.within(0.03, 0.048), brush.within(0.018, 0.034)
    foot, wall = radius * brush.within(0.4, 0.6), brush.within(0.0015, 0.004)
    outside = [(foot, 0), (foot * 1.1, 2e-3), (radius * 0.85, height * 0.45), (radius, height)]
    brush.turn(
        [*outside, (radius - wall, height), (radius * 0.8, height * 0.5), (foot, 4e-3), (1e-4, 3.5e-3)],
        brush.named(),
    )


def _plate(brush: Brush) -> None:
    radius, height = brush.within(0.036, 0.055), brush.within(0.005, 0.012)
    inner = radius * brush.within(0.6, 0.75)
    outside = [(inner, 0), (radius, height), (radius - 1.5e-3, height + 1e-3)]
    brush.turn([*outside, (inner * 0.95, 2.5e-3), (1e-4, 2.5e-3)], brush.named())


def _glass(brush: Brush) -> None:
    low, high, height = brush.within(0.015, 0.024), brush.within(0.019, 0.028), brush.within(0.05, 0.1)
    clear = brush.near((0.75, 0.85, 0.9), brush.within(0.3, 0.5))
    brush.turn([(low, 0), (high, height), (high - 2e-3, height), (low - 2e-3, 4e-3), (1e-4, 4e-3)], clear)


def _jar(brush: Brush) -> None:
    radius, height = brush.within(0.02, 0.03), brush.within(0.045, 0.075)
    fills = [(0.6, 0.08, 0.12), (0.85, 0.5, 0.1), (0.3, 0.4, 0.15), (0.4, 0.22, 0.1), (0.8, 0.85, 0.88)]
    brush.turn(
        [(radius * 0.92, 0), (radius, 3e-3), (radius, height * 0.78), (radius * 0.85, height * 0.86)],
        brush.near(fills[brush.random.integers(len(fills))], brush.within(0.8, 1)),
    )
    lid = radius * 0.93
    brush.turn(
        [(lid, height * 0.85), (lid, height - 1e-3), (lid * 0.95, height), (1e-4, height)], brush.other()
    )
    if brush.chance(0.5):
        brush.band(radius * 1.01, height * 0.2, height * 0.62, brush.near(_WHITE))


def _box(brush: Brush) -> None:
    size = (brush.within(0.018, 0.035), brush.within(0.035, 0.06), brush.within(0.05, 0.1))
    brush.add(Box(size), brush.named(), (0, 0, size[2] / 2))
    for side in (-1, 1):  # print on both faces
        picture = (1e-3, size[1] * brush.within(0.4, 0.85), size[2] * brush.within(0.2, 0.5))
        brush.add(Box(picture), brush.other(), (side * size[0] / 2, 0, size[2] * brush.within(0.4, 0.65)))


def _book(brush: Brush) -> None:
    long, wide, thick = brush.within(0.06, 0.085), brush.within(0.042, 0.06), brush.within(0.008, 0.022)
    cover = brush.named()
    brush.add(Box((long, wide, thick)), cover, (0, 0, thick / 2))
    brush.add(Box((long * 0.96, wide * 0.5, thick * 0.8)), brush.near(_WHITE), (0, wide * 0.26, thick / 2))
    if brush.chance(0.7):
        title = (long * brush.within(0.1, 0.3), wide * brush.within(0.4, 0.7), 1e-3)
        brush.add(Box(title), brush.other(), (long * brush.within(-0.2, 0.25), 0, thick))


def _candle(brush: Brush) -> None:
    radius, height = brush.within(0.008, 0.02), brush.within(0.05, 0.11)
    brush.turn(
        [(radius, 0), (radius, height - 2e-3), (radius * 0.8, height), (1e-4, height - 1e-3)], brush.named()
    )
    brush.add(Capsule(8e-4, 0.01), brush.near((0.1, 0.1, 0.1)), (0, 0, height + 4e-3))
    if brush.chance(0.6):
        brush.turn([(2e-3, 0), (3.5e-3, 4e-3), (1e-4, 0.014)], brush.near((1, 0.75, 0.2)), height + 6e-3)
    if brush.chance(0.5):  # a holder
        plate = radius * brush.within(1.4, 2.2)
        brush.turn(
            [(plate, 0), (plate, 3e-3), (radius * 1.1, 4e-3), (radius * 1.15, 0.014), (radius, 0.014)],
            brush.near(_METAL),
        )


def _traffic_cone(brush: Brush) -> None:
    radius, height = brush.within(0.017, 0.026), brush.within(0.055, 0.09)
    paint, edge = brush.near((0.96, 0.4, 0.06)), brush.within(0.045, 0.06)
    brush.add(
        Box((edge, edge, 5e-3)), paint if brush.chance(0.6) else brush.near((0.1, 0.1, 0.1)), (0, 0, 2.5e-3)
    )
    brush.turn([(radius, 4e-3), (radius * 0.2, height), (1e-4, height)], paint)
    for low in ((0.4,), (0.3, 0.6))[brush.random.integers(2)]:
        r = [radius * (1 - 0.8 * share) + 6e-4 for share in (low, low + 0.16)]
        brush.turn([(r[0], height * low), (r[1], height * (low + 0.16))], brush.near(_WHITE))


def _cone(brush: Brush) -> None:
    radius, height = brush.within(0.02, 0.032), brush.within(0.04, 0.075)
    brush.turn([(radius, 0), (1e-4, height)], brush.named())


def _pyramid(brush: Brush) -> None:
    edge, height = brush.within(0.035, 0.055), brush.within(0.03, 0.055)
    steps = 12
    colour = brush.named()
    for k in range(steps):
        wide = edge * (1 - k / steps)
        brush.add(Box((wide, wide, height / steps)), colour, (0, 0, height * (k + 0.5) / steps))


def _cylinder(brush: Brush) -> None:
    radius, height = brush.within(0.014, 0.027), brush.within(0.025, 0.08)
    brush.add(Cylinder(radius, height), brush.named(), (0, 0, height / 2))


def _ring(brush: Brush) -> None:
    _torus(brush, brush.within(0.018, 0.032), brush.within(0.003, 0.006), brush.named())


def _torus(brush: Brush, radius: float, thick: float, paint: Rgba) -> None:
    brush.turn(_arc((radius, thick), thick, -180, 180, 17), paint)


def _donut(brush: Brush) -> None:
    radius, thick = brush.within(0.018, 0.025), brush.within(0.009, 0.0125)
    _torus(brush, radius, thick, brush.near((0.78, 0.54, 0.28)))
    icing = brush.near(((0.95, 0.55, 0.7), (0.3, 0.16, 0.08), (0.95, 0.94, 0.92))[brush.random.integers(3)])
    top = _arc((radius, thick), thick * 1.04, brush.within(-5, 15), 175, 13)
    brush.turn([*top, top[0]], icing)


def _egg(brush: Brush) -> None:
    radius, height = brush.within(0.016, 0.022), brush.within(0.045, 0.06)
    angles = np.linspace(-np.pi / 2, np.pi / 2, 17)
    points = [
        (radius * float(np.cos(a)) * (1 - 0.13 * float(np.sin(a))), height / 2 * (1 + float(np.sin(a))))
        for a in angles
    ]
    brush.turn(points, brush.near(((0.95, 0.9, 0.82), (0.8, 0.58, 0.42))[brush.random.integers(2)]))


def _fruit_stem(brush: Brush, height: float, leaf: float) -> None:
    brush.add(
        Capsule(1.6e-3, 0.018),
        brush.near(_BARK),
        (0, 0, height),
        (brush.within(-20, 20), brush.within(-20, 20), 0),
    )
    if brush.chance(leaf):
        turn = brush.within(-180, 180)
        place = (
            0.01 * float(np.sin(np.deg2rad(turn))),
            -0.01 * float(np.cos(np.deg2rad(turn))),
            height + 4e-3,
        )
        brush.add(Ellipsoid((0.006, 0.011, 0.0015)), brush.near((0.15, 0.55, 0.15)), place, (-20, 0, turn))


def _apple(brush: Brush) -> None:
    r = brush.within(0.02, 0.028)
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
    brush.turn([(r * a, r * b) for a, b in outline], brush.near(skins[brush.random.integers(len(skins))]))
    _fruit_stem(brush, r * 1.85, 0.6)


def _orange(brush: Brush) -> None:
    radius = brush.within(0.02, 0.028)
    brush.turn(_ball(radius), brush.near((0.96, 0.52, 0.06)))
    brush.add(Ellipsoid((0.003, 0.003, 0.0012)), brush.near((0.25, 0.4, 0.1)), (0, 0, radius * 2))


def _pear(brush: Brush) -> None:
    r = brush.within(0.018, 0.024)
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
    brush.turn(
        [(r * a, r * b) for a, b in outline],
        brush.near(((0.7, 0.75, 0.15), (0.45, 0.6, 0.15), (0.85, 0.72, 0.2))[brush.random.integers(3)]),
    )
    _fruit_stem(brush, r * 3.1, 0.4)


def _lemon(brush: Brush) -> None:
    r = brush.within(0.016, 0.021)
    outline = [(0.05, -1.6), (0.2, -1.45), (0.7, -1), (1, 0), (0.7, 1), (0.22, 1.45), (0.05, 1.6)]
    brush.add(
        Lathe(tuple((r * a, r * b) for a, b in outline)),
        brush.near((0.96, 0.88, 0.12)),
        (0, 0, r),
        (90, 0, 0),
    )


def _banana(brush: Brush) -> None:
    bend, thick = brush.within(0.038, 0.05), brush.within(0.008, 0.011)
    skin, tip = brush.near((0.95, 0.82, 0.14)), brush.near((0.25, 0.16, 0.06))
    half = brush.within(42, 60)
    centre = (bend * 0.6, 0.0)
    points = np.array(
        [
            (centre[0] + bend * np.cos(a), bend * np.sin(a))
            for a in np.deg2rad(np.linspace(180 - half, 180 + half, 15))
        ]
    )
    brush.add(Tube(tuple(map(tuple, points.tolist())), thick), skin, (0, 0, thick), (90, 0, 0))
    for end in (points[0], points[-1]):
        brush.add(
            Ellipsoid((thick * 0.5, thick * 0.5, thick * 0.5)), tip, (float(end[0]), -float(end[1]), thick)
        )


def _carrot(brush: Brush) -> None:
    radius, length = brush.within(0.012, 0.019), brush.within(0.065, 0.1)
    root = [
        (1e-3, 0),
        (radius * 0.35, length * 0.1),
        (radius * 0.65, length * 0.5),
        (radius, length * 0.92),
        (radius * 0.7, length),
        (1e-4, length),
    ]
    lying = (90.0, 0.0, 0.0)
    brush.add(Lathe(tuple(root)), brush.near((0.95, 0.48, 0.1)), (0, length / 2, radius), lying)
    for lean in (-15, 0, 15):
        brush.add(
            Capsule(1.8e-3, 0.03),
            brush.near((0.2, 0.55, 0.15)),
            (lean * 3e-4, -length / 2 - 0.008, radius),
            (90, lean, 0),
        )


def _mushroom(brush: Brush) -> None:
    stem, cap = brush.within(0.008, 0.013), brush.within(0.02, 0.03)
    height = brush.within(0.03, 0.045)
    brush.turn([(stem * 1.15, 0), (stem, height * 0.4), (stem * 0.9, height)], brush.near((0.93, 0.9, 0.82)))
    brush.turn(
        [(1e-4, height * 0.8), *_arc((0, height * 0.82), cap, 0, 90)],
        brush.near(((0.8, 0.1, 0.08), (0.55, 0.36, 0.2), (0.88, 0.8, 0.68))[brush.random.integers(3)]),
    )


def _ice_cream(brush: Brush) -> None:
    radius, height = brush.within(0.015, 0.02), brush.within(0.05, 0.065)
    brush.turn([(3e-3, 0), (radius, height)], brush.near((0.82, 0.6, 0.32)))
    flavours = [(0.97, 0.93, 0.8), (0.95, 0.6, 0.7), (0.36, 0.2, 0.1), (0.6, 0.85, 0.55)]
    ball = brush.near(flavours[brush.random.integers(len(flavours))])
    brush.add(Ellipsoid((radius * 1.15,) * 3), ball, (0, 0, height + radius * 0.5))
    if brush.chance(0.4):
        second = brush.near(flavours[brush.random.integers(len(flavours))])
        brush.add(Ellipsoid((radius * 0.95,) * 3), second, (0, 0, height + radius * 1.8))


def _dice(brush: Brush) -> None:
    edge = brush.within(0.026, 0.042)
    paint = brush.named("white", "red", "blue", "black", "green")
    spot = brush.near((0.06, 0.06, 0.06)) if _bright(paint) else brush.near(_WHITE)
    brush.add(Box((edge,) * 3), paint, (0, 0, edge / 2))
    far = edge * 0.26
    layouts: list[list[tuple[float, float]]] = [
        [(0, 0)],
        [(-far, -far), (far, far)],
        [(-far, -far), (0, 0), (far, far)],
        [(a * far, b * far) for a in (-1, 1) for b in (-1, 1)],
        [(a * far, b * far) for a in (-1, 1) for b in (-1, 1)] + [(0, 0)],
        [(a * far, b * far) for a in (-1, 1) for b in (-1, 0, 1)],
    ]
    brush.random.shuffle(layouts)
    half, flat, wide = edge / 2, 6e-4, edge * 0.085
    for u, v in layouts[0]:
        brush.add(Ellipsoid((wide, wide, flat)), spot, (u, v, edge))
    for side, layout in zip((-1, 1), layouts[1:3], strict=True):
        for u, v in layout:
            brush.add(Ellipsoid((flat, wide, wide)), spot, (side * half, u, half + v))
    for side, layout in zip((-1, 1), layouts[3:5], strict=True):
        for u, v in layout:
            brush.add(Ellipsoid((wide, flat, wide)), spot, (u, side * half, half + v))


def _bright(rgba: Rgba) -> bool:
    """Whether dark print shows on a colour."""
    return sum(rgba[:3]) > 1.6


def _light_bulb(brush: Brush) -> None:
    radius = brush.within(0.018, 0.024)
    neck, base = radius * 0.5, brush.within(0.014, 0.02)
    brush.turn([(neck * 0.5, 0), (neck * 0.9, 3e-3), (neck, 4e-3), (neck, base)], brush.near(_METAL))
    middle = base + radius * 1.3
    glass = brush.near((0.98, 0.95, 0.8), brush.within(0.75, 1))
    brush.turn([(neck, base), (neck * 1.1, base + radius * 0.3), *_arc((0, middle), radius, -40, 90)], glass)


def _lamp(brush: Brush) -> None:
    foot, height = brush.within(0.02, 0.028), brush.within(0.08, 0.11)
    metal = brush.near(_METAL) if brush.chance(0.5) else brush.other()
    shade = brush.named()
    brush.turn([(foot, 0), (foot, 4e-3), (4e-3, 8e-3), (3e-3, height * 0.6)], metal)
    wide, narrow = brush.within(0.026, 0.036), brush.within(0.012, 0.024)
    brush.turn(
        [(wide, height * 0.55), (narrow, height), (narrow - 1.5e-3, height), (wide - 1.5e-3, height * 0.55)],
        shade,
    )


def _toy_car(brush: Brush) -> None:
    long, wide = brush.within(0.06, 0.08), brush.within(0.028, 0.036)
    wheel, low = brush.within(0.007, 0.01), brush.within(0.012, 0.016)
    paint = brush.named()
    brush.add(Box((long, wide, low)), paint, (0, 0, wheel + low / 2))
    cabin = (long * brush.within(0.4, 0.6), wide * 0.88, low * brush.within(0.8, 1.1))
    back = -long * brush.within(0, 0.12)
    brush.add(Box(cabin), brush.near((0.3, 0.4, 0.5)), (back, 0, wheel + low + cabin[2] / 2))
    brush.add(Box((cabin[0] * 0.9, cabin[1] * 1.02, 2e-3)), paint, (back, 0, wheel + low + cabin[2]))
    for x in (-0.3, 0.3):
        for y in (-0.5, 0.5):
            brush.add(
                Cylinder(wheel, 6e-3), brush.near((0.07, 0.07, 0.07)), (x * long, y * wide, wheel), (90, 0, 0)
            )


def _spray_can(brush: Brush) -> None:
    radius, height = brush.within(0.014, 0.02), brush.within(0.08, 0.12)
    brush.turn(
        [(radius * 0.95, 0), (radius, 2e-3), (radius, height), (radius * 0.6, height * 1.06)], brush.named()
    )
    cap = radius * brush.within(0.6, 0.92)
    brush.turn(
        [(cap, height * 1.04), (cap, height * 1.25), (cap * 0.7, height * 1.28), (1e-4, height * 1.28)],
        brush.other(),
    )


def _vase(brush: Brush) -> None:
    belly, height = brush.within(0.022, 0.034), brush.within(0.07, 0.12)
    neck, lip = belly * brush.within(0.3, 0.55), belly * brush.within(0.5, 0.9)
    middle = height * brush.within(0.3, 0.5)
    china = brush.named()
    brush.turn(
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


def _house(brush: Brush) -> None:
    wide, deep, wall = brush.within(0.036, 0.05), brush.within(0.036, 0.05), brush.within(0.025, 0.04)
    brush.add(
        Box((wide, deep, wall)), brush.near(_WHITE) if brush.chance(0.5) else brush.other(), (0, 0, wall / 2)
    )
    tiles, steps, roof = brush.named("red", "brown", "grey", "blue"), 8, brush.within(0.018, 0.028)
    for k in range(steps):
        brush.add(
            Box((wide * 1.1, deep * 1.15 * (1 - k / steps), roof / steps)),
            tiles,
            (0, 0, wall + roof * (k + 0.5) / steps),
        )
    brush.add(Box((1e-3, deep * 0.25, wall * 0.6)), brush.near(_BARK), (-wide / 2, 0, wall * 0.3))


def _tree(brush: Brush) -> None:
    trunk, height = brush.within(0.004, 0.007), brush.within(0.07, 0.11)
    leaves = brush.near((0.12, 0.42, 0.14))
    brush.add(Cylinder(trunk, height * 0.4), brush.near(_BARK), (0, 0, height * 0.2))
    wide = brush.within(0.022, 0.034)
    if brush.chance(0.5):
        for k in range(3):
            low = height * (0.2 + 0.22 * k)
            brush.turn([(wide * (1 - 0.22 * k), low), (1e-4, low + height * 0.38)], leaves)
    else:
        brush.add(Ellipsoid((wide, wide, wide * brush.within(0.9, 1.2))), leaves, (0, 0, height * 0.65))


def _snowman(brush: Brush) -> None:
    radius, at = brush.within(0.02, 0.026), 0.0
    for share in (1.0, 0.75, 0.55):
        at += radius * share * 0.9
        brush.add(Ellipsoid((radius * share,) * 3), brush.near((0.95, 0.95, 0.97)), (0, 0, at))
        at += radius * share * 0.8
    hat = radius * 0.4
    brush.turn(
        [(hat * 1.6, at - 2e-3), (hat * 1.6, at), (hat, at), (hat, at + hat * 1.6), (1e-4, at + hat * 1.6)],
        brush.near((0.07, 0.07, 0.08)),
    )
    brush.turn([(2.5e-3, 0), (1e-4, 0.014)], brush.near((0.95, 0.5, 0.1)))
    nose = brush.parts.pop()
    brush.add(nose.shape, nose.rgba, (-radius * 0.5, 0, at - radius * 0.5), (0, -90, 0))


def _pen(brush: Brush) -> None:
    radius, length = brush.within(0.004, 0.007), brush.within(0.085, 0.11)
    brush.add(
        Lathe(((radius, 0), (radius, length * 0.85), (1e-3, length))),
        brush.named(),
        (0, length / 2, radius),
        (90, 0, 0),
    )
    brush.add(Cylinder(radius * 1.1, length * 0.25), brush.other(), (0, length * 0.38, radius), (90, 0, 0))


def _hammer(brush: Brush) -> None:
    length, head = brush.within(0.08, 0.105), brush.within(0.035, 0.048)
    grip = brush.near((0.66, 0.45, 0.24)) if brush.chance(0.6) else brush.other()
    brush.add(Capsule(5e-3, length), grip, (0, 0, 8e-3), (90, 0, 0))
    brush.add(Box((head, 0.016, 0.016)), brush.near((0.35, 0.36, 0.38)), (0, -length * 0.45, 8e-3))


def _spoon(brush: Brush) -> None:
    length, metal = (
        brush.within(0.075, 0.1),
        brush.near(_METAL) if brush.chance(0.6) else brush.near((0.66, 0.45, 0.24)),
    )
    brush.add(Box((5e-3, length * 0.7, 2.5e-3)), metal, (0, length * 0.15, 3e-3))
    brush.add(Ellipsoid((0.012, 0.018, 3e-3)), metal, (0, -length * 0.35, 3e-3))


CATEGORIES: dict[str, tuple[tuple[str, ...], Callable[[Brush], None]]] = {
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


def draw_instance(random: np.random.Generator, category: str, label: str) -> Instance:
    """Draw an instance of a category.

    Args:
        random: Where its proportions and colours come from.
        category: Key of `CATEGORIES`.
        label: The name of its body in the world, not known to who looks at it.
    """
    names, draw = CATEGORIES[category]
    brush = Brush(random)
    draw(brush)
    colours = COLOURS[brush.colour][0] if brush.colour else ()
    return Instance(category, names, colours, TabletopObject(label, (), tuple(brush.parts)))
