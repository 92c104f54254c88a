# SPDX-License-Identifier: Apache-2.0
"""A second look, after a movement: what stands elsewhere now.

The arms are at home in both images, so what did not move looks the same. Measured with the embedded detector
on 863 things that nobody touched: their places differ by at most 0.004 of the image in 99.5 % of the pairs.
They differ by at least 0.007 where a thing moved by 5 mm, and by 0.02 where it moved by 1 cm.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from .commands.happened import Change
from .commands.verbs import AWAY, CLOSER, LEFT, RIGHT
from .scene import Scene, Thing

STILL, OTHER_STILL = 0.007, 0.012
"""What is nearer to its old place did not move: the thing that was meant, and others."""
# A thing that fell is flatter: its box has less than this share of its height over width before.
_FLATTER, _UPRIGHT = 0.7, 1.1
# Of two boxes one is a part of the other, if so much of it lies in there.
_PART = 0.93
# A thing that is seen whole keeps its size but for this share.
_SAME_SIZE = 0.25


@dataclass(frozen=True)
class Memory:
    """What was seen before a movement.

    Attributes:
        thing: What was to be moved.
        others: All other things.
    """

    thing: Thing
    others: tuple[Thing, ...]


def remember(scene: Scene, thing: Thing) -> Memory:
    """Note what is seen, and which of it is meant."""
    return Memory(thing, tuple(other for other in scene.things if other.apart_from(thing)))


def changed(memory: Memory, scene: Scene) -> Change:
    """Compare what is seen now with what was seen before."""
    old, alike = memory.thing, scene.called(memory.thing.name)
    seen = [*alike, *scene.things]
    new = [thing for thing in scene.things if all(_elsewhere(thing, other) for other in memory.others)]
    there = [thing for thing in alike if all(_elsewhere(thing, other) for other in memory.others)] or new
    now = min(seen if _stands(old, seen) else there, key=old.distance, default=None)
    known = (old, *memory.others) if now is None else (old, now, *memory.others)
    arrived = [thing for thing in new if not any(_is_part(thing, other) for other in known)]
    gone = [other for other in memory.others if all(_elsewhere(thing, other) for thing in seen)]
    return Change(
        None if now is None else "" if _stands(old, seen) else _way(old, now),
        fell=now is not None and _flatness(old) > _UPRIGHT and _flatness(now) < _FLATTER * _flatness(old),
        # No more than are seen at new places: what moved may hide what did not.
        others=tuple(other.name for other in gone[: len(arrived)]),
    )


def displaced(memory: Memory, scene: Scene) -> Thing | None:
    """The thing that was meant, if it is seen elsewhere now, and whole; else an arm may hide it: None."""
    old, alike = memory.thing, scene.called(memory.thing.name)
    if not all(_elsewhere(thing, old) for thing in alike):
        return None
    there = [thing for thing in alike if all(_elsewhere(thing, other) for other in memory.others)]
    now = min(there, key=old.distance, default=None)
    return now if now is not None and abs(_area(now) / _area(old) - 1) < _SAME_SIZE else None


def _stands(thing: Thing, seen: Sequence[Thing]) -> bool:
    return any(thing.distance(other) < STILL for other in seen)


def _elsewhere(thing: Thing, other: Thing) -> bool:
    return thing.distance(other) >= OTHER_STILL


def _is_part(thing: Thing, other: Thing) -> bool:
    """Whether one of two boxes lies in the other: a hand hides a part of the same thing in one image."""
    (x0, y0, x1, y1), (u0, v0, u1, v1) = thing.box.tolist(), other.box.tolist()
    common = max(min(x1, u1) - max(x0, u0), 0.0) * max(min(y1, v1) - max(y0, v0), 0.0)
    return common > _PART * min(_area(thing), _area(other))


def _way(old: Thing, now: Thing) -> str:
    """Where a thing went: in the image away is up."""
    right, down = now.place.x - old.place.x, now.place.y - old.place.y
    if abs(right) > abs(down):
        return RIGHT if right > 0 else LEFT
    return CLOSER if down > 0 else AWAY


def _flatness(thing: Thing) -> float:
    left, upper, right, lower = thing.box.tolist()
    return (lower - upper) / max(right - left, 1e-6)


def _area(thing: Thing) -> float:
    left, upper, right, lower = thing.box.tolist()
    return max((right - left) * (lower - upper), 1e-9)
