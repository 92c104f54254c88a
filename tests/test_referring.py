# SPDX-License-Identifier: Apache-2.0
"""Which of several things is meant."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from lerobot_owlxt5.commands.answer import Landmark, Relation, Target
from lerobot_owlxt5.commands.referring import Place, matching, side_of

ROW = (Place(0.2, 0.5), Place(0.5, 0.52), Place(0.8, 0.48))
DEPTH = (Place(0.3, 0.4), Place(0.5, 0.6), Place(0.7, 0.8))


@pytest.mark.parametrize(
    ("target", "places", "left"),
    [
        (Target(name="cube"), ROW, [0, 1, 2]),
        (Target(side="left"), ROW, [0]),
        (Target(side="middle"), ROW, [1]),
        (Target(side="right"), ROW, [2]),
        (Target(side="middle"), ROW[:2], [0, 1]),
        # What is as near as another is not nearest.
        (Target(side="near"), ROW, [0, 1]),
        (Target(side="near"), DEPTH, [2]),
        (Target(side="far"), DEPTH, [0]),
        (Target(order=("second", "left")), ROW, [1]),
        (Target(order=("third", "left")), ROW, [2]),
        (Target(order=("second", "right")), ROW[:2], [0]),
        (Target(order=("fourth", "left")), ROW, []),
        # A side that contradicts the image.
        (Target(side="left"), ROW[:1], [0]),
        (Target(side="left"), ROW[2:], []),
        (Target(side="middle"), ROW[2:], []),
        (Target(side="far"), ROW[2:], [0]),
    ],
)
def test_sides_and_order(target: Target, places: tuple[Place, ...], left: list[int]) -> None:
    assert matching(target, places, (), None) == left


@pytest.mark.parametrize(
    ("kind", "marks", "places", "left"),
    [
        ("left of", ROW[1:2], ROW, [0]),
        ("right of", ROW[1:2], ROW, [2]),
        ("left of", ROW[2:], ROW, [0, 1]),
        ("left of", ROW[:1], ROW, []),
        ("next to", ROW[:1], ROW, [1]),
        ("next to", ROW[1:2], ROW, [0, 2]),
        ("behind", DEPTH[1:2], DEPTH, [0]),
        ("before", DEPTH[1:2], DEPTH, [2]),
        ("between", (ROW[0], ROW[2]), ROW, [1]),
        ("between", (ROW[1], ROW[2]), ROW, []),
    ],
)
def test_relations(kind: str, marks: tuple[Place, ...], places: tuple[Place, ...], left: list[int]) -> None:
    target = Target(relation=Relation(kind, (Landmark("can"),) * len(marks)))
    assert matching(target, places, marks, None) == left


def test_the_other_one_is_none_that_was_spoken_of_before() -> None:
    other = Target(name="cube", reference="other")
    assert matching(other, ROW[:2], (), ROW[0]) == [1]
    assert matching(other, ROW, (), ROW[0]) == [1, 2]
    assert matching(other, ROW[:1], (), ROW[0]) == []
    assert matching(other, ROW[:2], (), None) == [0, 1]


@given(st.lists(st.builds(Place, st.floats(0, 1), st.floats(0, 1)), min_size=2, max_size=6))
def test_a_side_never_leaves_out_the_outermost(places: list[Place]) -> None:
    left = matching(Target(side="left"), places, (), None)
    assert min(range(len(places)), key=lambda index: places[index].x) in left
    assert matching(Target(side="left"), [Place(1 - p.x, p.y) for p in places], (), None) == matching(
        Target(side="right"), places, (), None
    )


def test_where_in_the_image() -> None:
    assert [side_of(place) for place in ROW] == ["left", "middle", "right"]
