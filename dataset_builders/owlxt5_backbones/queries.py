# SPDX-License-Identifier: Apache-2.0
"""What one may ask about an image, and which of its objects are meant."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .catalogue import CATEGORIES, COLOURS
from .rng import choice

NAMES = sorted({name for names, _ in CATEGORIES.values() for name in names})
"""All names of all categories."""
_COLOUR_NAMES = sorted({name for names, _ in COLOURS.values() for name in names})
_SIDES = ("left", "right")
# The policy asks `a photo of a {name}`; the others keep the detector from knowing that one alone.
PATTERNS = ("a photo of a {}", "a photo of a {}", "{}", "the {}", "a picture of the {}")

Objects = Sequence[Mapping[str, Any]]
"""`names`, `colours` and `box` of each object of an image."""


class Query(NamedTuple):
    """Something to look for: what is called so, of this colour, or the one farthest to this side."""

    name: str
    colour: str | None = None
    side: str | None = None

    @property
    def phrase(self) -> str:
        """In words."""
        words = f"{self.colour} {self.name}" if self.colour else self.name
        return f"{words} on the {self.side}" if self.side else words

    def meant(self, objects: Objects) -> tuple[int, ...] | None:
        """Indices of the objects that are meant, none if it is not there; None if nobody could say.

        Nobody could say whether an object without a colour's name is red, or which of one is on the left.
        """
        called = tuple(index for index, item in enumerate(objects) if self.name in item["names"])
        if self.colour:
            if any(not objects[index]["colours"] for index in called):
                return None
            return tuple(index for index in called if self.colour in objects[index]["colours"])
        if self.side and called:
            if len(called) == 1:
                return None
            choose = min if self.side == "left" else max
            return (choose(called, key=lambda index: objects[index]["box"][0]),)
        return called


def draw_queries(images: Sequence[Objects], rng: np.random.Generator, others: int) -> list[Query]:
    """All names, and some queries with colours and sides that make sense in one of the images or another.

    Args:
        images: The objects of each.
        rng: Where the choices come from.
        others: How many queries with colours and sides.
    """
    queries = dict.fromkeys(Query(name) for name in NAMES)
    there = [item for objects in images for item in objects]
    while len(queries) < len(NAMES) + others:
        names = choice(rng, there)["names"] if there and rng.random() < 0.8 else NAMES
        colours = choice(rng, there)["colours"] if there and rng.random() < 0.7 else ()
        if rng.random() < 0.2:
            query = Query(choice(rng, names), side=choice(rng, _SIDES))
        else:
            query = Query(choice(rng, names), choice(rng, colours or _COLOUR_NAMES))
        queries[query] = None
    return [*queries]


def all_texts() -> list[str]:
    """Every name and every name with a colour, in each pattern: what the tokenizer is fitted to."""
    phrases = [Query(name).phrase for name in NAMES]
    phrases += [Query(name, colour).phrase for colour in _COLOUR_NAMES for name in NAMES]
    phrases += [Query(name, side=side).phrase for name in NAMES for side in _SIDES]
    return [pattern.format(phrase) for pattern in dict.fromkeys(PATTERNS) for phrase in phrases]
