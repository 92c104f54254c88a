# SPDX-License-Identifier: Apache-2.0
"""What a second look makes of two images' boxes."""

from dataclasses import dataclass
from typing import cast

import pytest
import torch

from lerobot_owlxt5.commands.happened import Change
from lerobot_owlxt5.commands.verbs import AWAY, CLOSER, LEFT, RIGHT
from lerobot_owlxt5.look_again import Memory, changed, find_again
from lerobot_owlxt5.scene import Scene, Thing


@dataclass
class Seen:
    """A scene whose things are known."""

    things: list[Thing]

    def called(self, name: str) -> list[Thing]:
        return [thing for thing in self.things if thing.name == name]


def thing(name: str, left: float, upper: float, right: float, lower: float) -> Thing:
    return Thing(name, torch.tensor([left, upper, right, lower]))


def after(now: Thing, *others: Thing) -> Change:
    """What changed since the cube stood upright in the image's middle, and the mug beside it."""
    before = Memory(thing("cube", 0.45, 0.45, 0.55, 0.55), (thing("mug", 0.2, 0.4, 0.3, 0.55),))
    seen = cast(Scene, Seen([now, *(others or before.others)]))
    return changed(before, seen, find_again(before, seen))


@pytest.mark.parametrize(
    "by, way",
    [
        ((0.0, -0.05), AWAY),
        ((0.02, 0.05), CLOSER),
        ((-0.06, 0.05), LEFT),
        ((0.06, -0.05), RIGHT),
        ((0.001, 0.002), ""),
    ],
)
def test_a_thing_went_where_its_box_went(by: tuple[float, float], way: str) -> None:
    right, down = by
    assert after(thing("cube", 0.45 + right, 0.45 + down, 0.55 + right, 0.55 + down)) == Change(way)


def test_a_corner_in_front_is_no_way_closer() -> None:
    """A cube that was dragged aside and turned: its box grew, and its lower edge is that of a corner."""
    assert after(thing("cube", 0.452, 0.445, 0.588, 0.585)).way == RIGHT


def test_a_fallen_thing_did_not_come_closer_because_its_top_came_down() -> None:
    before = Memory(thing("bottle", 0.45, 0.2, 0.55, 0.55), ())
    now = thing("bottle", 0.35, 0.4, 0.6, 0.5)
    assert changed(before, cast(Scene, Seen([now])), now) == Change(AWAY, fell=True)


def test_what_another_thing_did_is_told_too() -> None:
    change = after(thing("cube", 0.45, 0.4, 0.55, 0.5), thing("mug", 0.25, 0.4, 0.35, 0.55))
    assert change == Change(AWAY, others=("mug",))


def test_a_thing_keeps_its_name_where_it_looks_like_another_one() -> None:
    before = Memory(thing("cube", 0.45, 0.45, 0.55, 0.55), (thing("mug", 0.2, 0.4, 0.3, 0.55),))
    book = thing("book", 0.45, 0.3, 0.55, 0.4)
    for things, name in (([*before.others, book], "cube"), ([*before.others], None)):
        now = find_again(before, cast(Scene, Seen(things)))
        assert (now.name if now else None) == name
