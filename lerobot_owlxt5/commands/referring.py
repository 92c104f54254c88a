# SPDX-License-Identifier: Apache-2.0
"""Which of several things is meant: side, order, and relation to others, as the robot sees them.

All places are in the image: x grows to the right, y towards the robot, both as shares of its size.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

from .answer import RANKS, Relation, Target

APART = 0.04
"""Things that differ by less are side by side, and neither is farther left or nearer (our decision)."""
LEFT_END, RIGHT_END = 0.42, 0.58
"""What is alone of its kind is on the left below the first, on the right above the second share."""
NEXT = 1.3
"""Next to a thing is what is at most so many times as far from it as the nearest."""


class Place(NamedTuple):
    """Where a thing stands: where its box meets the table, in the middle."""

    x: float
    y: float


def matching(
    target: Target, places: Sequence[Place], landmarks: Sequence[Place], before: Place | None
) -> list[int]:
    """Which of the things that are called like a target can be meant by its other marks.

    Args:
        target: What was asked for.
        places: Of all things that have the target's name and colour.
        landmarks: Of the things that its relation names.
        before: Where the thing is that was spoken of before, if there is one.

    Returns:
        Indices into `places`. Several: it was not said clearly which. None: there is no such thing.
    """
    left = [*range(len(places))]
    if target.reference == "other" and before is not None:
        left = [index for index in left if are_apart(places[index], before)]
    if target.relation:
        left = _related(target.relation, {index: places[index] for index in left}, landmarks)
    if target.order:
        rank, side = target.order
        row = sorted(left, key=lambda index: places[index].x, reverse=side == "right")
        number = RANKS.index(rank) + 1
        left = row[number : number + 1]
    if target.side:
        left = _on_side(target.side, {index: places[index] for index in left})
    return left


def are_apart(place: Place, other: Place) -> bool:
    """Whether two things stand at different places."""
    return distance(place, other) > APART


def side_of(place: Place) -> str:
    """Where in the image a thing is: "left", "right" or "middle"."""
    return "left" if place.x < LEFT_END else "right" if place.x > RIGHT_END else "middle"


def _on_side(side: str, places: dict[int, Place]) -> list[int]:
    if len(places) == 1:
        # Near and far compare things with each other.
        return [index for index, place in places.items() if side in ("near", "far", side_of(place))]
    keys: dict[str, Callable[[Place], float]] = {
        **{"left": lambda place: place.x, "right": lambda place: -place.x},
        **{"near": lambda place: -place.y, "far": lambda place: place.y},
    }
    if side in keys:
        key = keys[side]
        first = min((key(place) for place in places.values()), default=0.0)
        return [index for index, place in places.items() if key(place) - first < APART]
    row = sorted(places, key=lambda index: places[index].x)
    return row[(len(row) - 1) // 2 : len(row) // 2 + 1]


def _related(relation: Relation, places: dict[int, Place], landmarks: Sequence[Place]) -> list[int]:
    mark = landmarks[0]
    if relation.kind == "between":
        low, high = sorted(each.x for each in landmarks)
        return [index for index, place in places.items() if low + APART < place.x < high - APART]
    apart: dict[str, Callable[[Place], float]] = {
        "left of": lambda place: mark.x - place.x,
        "right of": lambda place: place.x - mark.x,
        "behind": lambda place: mark.y - place.y,
        "before": lambda place: place.y - mark.y,
    }
    others = {index: place for index, place in places.items() if are_apart(place, mark)}
    if relation.kind in apart:
        return [index for index, place in others.items() if apart[relation.kind](place) > APART]
    nearest = min((distance(place, mark) for place in others.values()), default=0.0)
    return [index for index, place in others.items() if distance(place, mark) <= NEXT * nearest]


def distance(place: Place, other: Place) -> float:
    """How far apart two places are, as a share of the image."""
    return ((place.x - other.x) ** 2 + (place.y - other.y) ** 2) ** 0.5
