# SPDX-License-Identifier: Apache-2.0
"""What one may ask about a picture, and which of its objects are meant."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from .catalogue import CATEGORIES, COLOURS
from .dice import pick

_NAMES = sorted({name for names, _ in CATEGORIES.values() for name in names})
_COLOUR_NAMES = sorted({name for names, _ in COLOURS.values() for name in names})
# The policy asks `a photo of a {name}`; the others keep the eyes from knowing that one alone.
_PATTERNS = ("a photo of a {}", "a photo of a {}", "{}", "the {}", "a picture of the {}")
_MOST_ASKED_TWICE = 20


class Query(NamedTuple):
    """A text and the objects that it means.

    Attributes:
        text: As the eyes' text encoder gets it.
        meant: Indices of the picture's objects; none if what is asked for is not there.
    """

    text: str
    meant: tuple[int, ...]


def draw_queries(
    objects: Sequence[Mapping[str, Any]], random: np.random.Generator, count: int
) -> list[Query]:
    """Draw queries about a picture: half of them about what is there, the others about what is not.

    Args:
        objects: `names`, `colours` and `box` of each object of the picture.
        random: Where the choices come from.
        count: How many.
    """
    queries: list[Query] = []
    for _ in range(count * _MOST_ASKED_TWICE):
        if len(queries) == count:
            break
        present = bool(objects) and random.random() < 0.5
        kinds = _PRESENT if present else _ABSENT
        ask = kinds[int(random.integers(len(kinds)))]
        phrase, meant = ask(objects, random)
        if phrase and bool(meant) == present:
            pattern = _PATTERNS[int(random.integers(len(_PATTERNS)))]
            queries.append(Query(pattern.format(phrase), meant))
    return queries or [Query("a photo of nothing", ())]


def _called(objects: Sequence[Mapping[str, Any]], name: str) -> tuple[int, ...]:
    return tuple(index for index, item in enumerate(objects) if name in item["names"])


def _coloured(objects: Sequence[Mapping[str, Any]], colour: str, name: str) -> tuple[str, tuple[int, ...]]:
    """Objects of this name and colour; no phrase if one of this name has no colour to be called by."""
    called = _called(objects, name)
    if any(not objects[index]["colours"] for index in called):
        return "", ()
    return f"{colour} {name}", tuple(index for index in called if colour in objects[index]["colours"])


Ask = Callable[[Sequence[Mapping[str, Any]], np.random.Generator], tuple[str, tuple[int, ...]]]


def _name(objects: Sequence[Mapping[str, Any]], random: np.random.Generator) -> tuple[str, tuple[int, ...]]:
    name = pick(random, pick(random, objects)["names"])
    return name, _called(objects, name)


def _colour_and_name(
    objects: Sequence[Mapping[str, Any]], random: np.random.Generator
) -> tuple[str, tuple[int, ...]]:
    item = pick(random, objects)
    if not item["colours"]:
        return "", ()
    return _coloured(objects, pick(random, item["colours"]), pick(random, item["names"]))


def _side(objects: Sequence[Mapping[str, Any]], random: np.random.Generator) -> tuple[str, tuple[int, ...]]:
    """The left or the right one of two or more of the same name."""
    name = pick(random, pick(random, objects)["names"])
    called = _called(objects, name)
    if len(called) < 2:
        return "", ()
    side, choose = pick(random, (("left", min), ("right", max)))
    return f"{name} on the {side}", (choose(called, key=lambda index: objects[index]["box"][0]),)


def _other_name(
    objects: Sequence[Mapping[str, Any]], random: np.random.Generator
) -> tuple[str, tuple[int, ...]]:
    name = pick(random, _NAMES)
    return name, _called(objects, name)


def _other_colour(
    objects: Sequence[Mapping[str, Any]], random: np.random.Generator
) -> tuple[str, tuple[int, ...]]:
    """Something of a name that is there, in a colour that is not."""
    name = pick(random, pick(random, objects)["names"]) if objects else pick(random, _NAMES)
    return _coloured(objects, pick(random, _COLOUR_NAMES), name)


def _other_name_in_the_colour(
    objects: Sequence[Mapping[str, Any]], random: np.random.Generator
) -> tuple[str, tuple[int, ...]]:
    """Something of a colour that is there, with a name that is not."""
    colours = [colour for item in objects for colour in item["colours"]]
    return _coloured(objects, pick(random, colours or _COLOUR_NAMES), pick(random, _NAMES))


_PRESENT: tuple[Ask, ...] = (_name, _name, _colour_and_name, _side)
_ABSENT: tuple[Ask, ...] = (_other_name, _other_name, _other_colour, _other_name_in_the_colour)


def all_texts() -> list[str]:
    """Every name and every name with a colour, in each pattern: what the tokenizer is fitted to."""
    phrases = [*_NAMES, *(f"{colour} {name}" for colour in _COLOUR_NAMES for name in _NAMES)]
    phrases += [f"{name} on the {side}" for name in _NAMES for side in ("left", "right")]
    return [pattern.format(phrase) for pattern in dict.fromkeys(_PATTERNS) for phrase in phrases]
