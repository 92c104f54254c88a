# SPDX-License-Identifier: Apache-2.0
"""Further objects on the table: where they stand, and that they are out of the way."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_tabletop.configuration import ClaeoEnvConfig, ClantEnvConfig
from nico_tabletop.distractors import (
    APART,
    BEHIND,
    FARTHEST_DISTRACTOR,
    HALF_WIDTH,
    MOST,
    Distractor,
    DistractorError,
    check_distractors,
    draw_distractors,
)
from nico_tabletop.objects import CUBE_HALF_WIDTH, read_objects
from nico_tabletop.placement import CLEARANCE, SLOT_POSES, Pose, draw_mixed
from nico_tabletop.robot import EYES, INITIAL_POSE_DEG
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import VERBS

NAMES = tuple("abcdefghij")
CORNER = CUBE_HALF_WIDTH * 2**0.5
PUSHED = 0.127
"""CLANT's longest push, docs/world.md, metres."""


@given(st.integers(0, 2**63), st.integers(0, MOST))
def test_distractors_are_clear_of_each_other_of_objects_and_of_strokes(seed: int, count: int) -> None:
    poses = draw_mixed(np.random.default_rng(seed))
    drawn = draw_distractors(count, NAMES, poses, np.random.default_rng(seed))
    assert drawn == draw_distractors(count, NAMES, poses, np.random.default_rng(seed))
    assert len({name for name, _ in drawn}) == count and {name for name, _ in drawn} <= {*NAMES}
    for _, pose in drawn:
        assert abs(pose.y) <= HALF_WIDTH + 1e-9 and pose.x <= FARTHEST_DISTRACTOR + 1e-9
        for each in poses:
            assert np.hypot(pose.x - each.x, pose.y - each.y) >= CLEARANCE
            for verb in VERBS:  # none is touched even by an object that is pushed as far as on CLANT's slots
                moved = np.array(each[:2]) + PUSHED * np.array(verb.direction)
                assert np.hypot(*(moved - pose[:2])) > 2 * CORNER
    assert all(left.pose.y - right.pose.y >= APART - 1e-9 for left, right in pairwise(drawn))
    assert 2 * CORNER < APART


@pytest.mark.parametrize("objects", ["clant", "claeo", "household"])
def test_the_eyes_see_every_distractor(objects: str) -> None:
    simulation = TabletopSimulation(read_objects(objects))
    names = list(simulation.objects)
    nearest = max(pose.x for pose in SLOT_POSES) + BEHIND
    ends = [(x, y) for x in (nearest, FARTHEST_DISTRACTOR) for y in (-HALF_WIDTH, HALF_WIDTH)]
    for name in names:  # in the role of an object, whose box is known
        others = [other for other in names if other != name][:2]
        for x, y in ends:
            simulation.reset((name, *others), (Pose(x, y, 45.0), *SLOT_POSES[1:]))
            x0, y0, x1, y1 = simulation.object_boxes(4 / 3)[0]
            assert 0 < x0 < x1 < 1 and y1 < 1, "only the image's upper edge may cut it"
            assert (y1 - y0) * 240 > 10, "and some rows of it are in the smallest usual image"


def test_distractors_stay_where_they_are_put() -> None:
    simulation = TabletopSimulation(read_objects("household"))
    names = tuple(simulation.objects)
    drawn = draw_distractors(MOST, names[3:], SLOT_POSES, np.random.default_rng(0))
    simulation.reset(names[:3], distractors=drawn)
    start = simulation.distractor_positions()
    np.testing.assert_allclose(start[:, :2], [distractor.pose[:2] for distractor in drawn])
    for _ in range(5):
        simulation.step(INITIAL_POSE_DEG)
    np.testing.assert_allclose(simulation.distractor_positions(), start, atol=1e-3)
    assert simulation.object_positions().shape == (3, 3)
    simulation.reset(names[:3])
    assert simulation.distractor_positions().shape == (0, 3)


def test_what_cannot_be_placed_is_refused_in_one_sentence() -> None:
    for config, message in (
        (ClaeoEnvConfig(distractors=4), "distractors=4 needs 7 objects, but the set has 6: .*distractors=3"),
        (ClantEnvConfig(distractors=-1), f"distractors must lie between 0 and {MOST}"),
        (
            ClantEnvConfig(objects="household", distractors=MOST + 1),
            f"and {MOST}, .*got {MOST + 1}",
        ),
    ):
        with pytest.raises(DistractorError, match=message):
            config.create_envs(n_envs=1)
    with pytest.raises(DistractorError, match=r"=6 moves away: with placement=free, lower it to 4\.0"):
        check_distractors(1, 6, "free", 6)
    check_distractors(3, 6, "slots", 6)
    with pytest.raises(DistractorError, match=r"behind an object at x = 0\.500"):
        draw_distractors(1, NAMES, [Pose(0.5, 0.0)], np.random.default_rng(0))
    simulation = TabletopSimulation(read_objects("clant"))
    for wrong in ("red", "pink"):
        with pytest.raises(ValueError, match="distractors are further objects of the set"):
            simulation.reset(("red", "green", "blue"), distractors=[Distractor(wrong, Pose(0.6, 0))])


def test_a_distractor_is_seen_in_the_image() -> None:
    simulation = TabletopSimulation(read_objects("clant"))
    images = []
    for distractors in ((), (Distractor("violet", Pose(0.58, 0.0)),)):
        simulation.reset(("red", "green", "blue"), distractors=distractors)
        images.append(simulation.render(EYES, 96, 128).astype(float))
    simulation.close()
    differs = np.abs(images[1] - images[0]).max(axis=2) > 40
    rows, columns = np.nonzero(differs)
    assert 20 < differs.sum() < 600 and rows.max() < 30 and abs(columns.mean() - 64) < 10
