# SPDX-License-Identifier: Apache-2.0
"""Tests of the scripted expert: what it plans, and what its plans do to objects in the world."""

import sys
from importlib import import_module

import numpy as np
import pytest
from numpy.typing import NDArray

from nico_tabletop.objects import read_objects
from nico_tabletop.placement import SLOT_POSES, OutOfReachError, Pose, Poses, draw_poses
from nico_tabletop.replay import replay
from nico_tabletop.robot import INITIAL_POSE_DEG, joint_limits_deg
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import CONTROL_HZ, TabletopSimulation
from nico_tabletop.starts import draw_conditions
from nico_tabletop.tasks import ACTIONS, SLOTS, VERBS, Action, find_action
from nico_tabletop.variation import Conditions, Variation

pytest.importorskip("mink", reason="the scripted expert needs the extra `scripted`")
from clant_claeo.expert import GRIPS, _Arm, plan

pytestmark = pytest.mark.slow  # moves the arms a thousand times

ARMS = {"right": slice(0, 5), "left": slice(5, 10)}


@pytest.fixture(scope="module")
def simulation() -> TabletopSimulation:
    return TabletopSimulation(read_objects("clant"))


def free_poses(number: int) -> Poses:
    return draw_poses(np.random.default_rng((5, number)))


def moved(offsets: NDArray[np.float64]) -> Poses:
    """The slots with each object moved by its (x, y) metres."""
    left, middle, right = (Pose(p.x + x, p.y + y) for p, (x, y) in zip(SLOT_POSES, offsets, strict=True))
    return left, middle, right


def act(simulation: TabletopSimulation, action: Action, poses: Poses) -> Outcome:
    """Outcome of a plan with the three objects at `poses`."""
    simulation.reset(tuple(simulation.objects)[: len(SLOTS)], poses)
    return replay(simulation, action, plan(action, poses))


def test_every_verb_has_a_grip_for_each_arm_and_no_grip_is_left_over() -> None:
    assert {verb: set(grips) for verb, grips in GRIPS.items()} == {verb.name: set(ARMS) for verb in VERBS}


@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_every_action_is_perfect_on_the_slots(simulation: TabletopSimulation, action: Action) -> None:
    assert act(simulation, action, SLOT_POSES) == Outcome.PERFECT


@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_objects_may_stand_off_their_slots(simulation: TabletopSimulation, action: Action) -> None:
    for off in [(0.005, -0.005), (-0.005, 0.005)]:
        assert act(simulation, action, moved(np.tile(off, (len(SLOTS), 1)))) == Outcome.PERFECT


def test_free_scenes_are_perfect(simulation: TabletopSimulation) -> None:
    outcomes = [act(simulation, action, free_poses(number)) for number, action in enumerate(ACTIONS)]
    assert outcomes.count(Outcome.PERFECT) >= len(outcomes) - 1, outcomes


@pytest.mark.parametrize("poses", [SLOT_POSES, free_poses(20), free_poses(21)], ids=["slots", "20", "21"])
@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_plans_look_like_clant(action: Action, poses: Poses) -> None:
    rows = plan(action, poses)
    assert rows.dtype == np.float64 and rows.shape[1:] == INITIAL_POSE_DEG.shape
    assert 40 <= len(rows) <= 85
    assert np.isfinite(rows).all()
    np.testing.assert_array_equal(rows[0], INITIAL_POSE_DEG)
    (acting,) = acts(rows)
    # The first row itself lies 0.02 degrees beyond the elbows' limits, and the resting arm stays there, as in
    # CLANT.
    low, high = joint_limits_deg()[ARMS[acting]].T
    moving = rows[1:, ARMS[acting]]
    assert (moving >= low - 1e-6).all() and (moving <= high + 1e-6).all()
    resting = np.delete(rows, ARMS[acting], axis=1)
    np.testing.assert_array_equal(resting, resting[:1].repeat(len(rows), axis=0))
    assert np.abs(np.diff(rows, axis=0)).max() * CONTROL_HZ <= 60.1


def acts(rows: NDArray[np.float64]) -> list[str]:
    """The arms that a plan moves."""
    return [side for side, arm in ARMS.items() if np.ptp(rows[:, arm], axis=0).max() > 40]


@pytest.mark.parametrize(
    "name, arm",
    [
        ("PUSH-L", "left"),
        ("PULL-R", "right"),
        ("PUSH-M", "right"),
        ("SLIDE-M-L", "left"),
        ("SLIDE-M-R", "right"),
        ("SLIDE-L-L", "left"),
        ("SLIDE-L-R", "left"),
        ("SLIDE-R-R", "right"),
    ],
)
def test_the_arm_on_the_objects_side_acts(name: str, arm: str) -> None:
    assert acts(plan(find_action(name), SLOT_POSES)) == [arm]


def test_the_arm_follows_from_the_objects_place_alone() -> None:
    near = (Pose(0.40, 0.15), Pose(0.40, 0.0), Pose(0.33, -0.10))
    far = (Pose(0.32, 0.18), Pose(0.40, 0.0), Pose(0.32, -0.18))
    for name in ("PUSH-M", "PULL-M", "SLIDE-M-L"):
        np.testing.assert_array_equal(plan(find_action(name), near), plan(find_action(name), far))


def test_a_plan_that_would_touch_another_object_is_none() -> None:
    in_the_way = (SLOT_POSES[0], SLOT_POSES[1], Pose(SLOT_POSES[1].x, -0.07))
    with pytest.raises(OutOfReachError, match=r"SLIDE-M-L at x 0\.347.*: the left hand would touch"):
        plan(find_action("SLIDE-M-L"), in_the_way)


@pytest.mark.parametrize("placement", ["slots", "free"])
def test_arms_may_start_elsewhere(simulation: TabletopSimulation, placement: str) -> None:
    outcomes = []
    for number, action in enumerate(ACTIONS):
        poses = SLOT_POSES if placement == "slots" else free_poses(number)
        conditions = draw_conditions(Variation(arms_deg=10), poses, np.random.default_rng((6, number)))
        rows = plan(action, poses, conditions.start_pose_deg)
        assert 40 <= len(rows) <= 85
        np.testing.assert_array_equal(rows[0], conditions.start_pose_deg)
        assert np.abs(np.diff(rows, axis=0)).max() * CONTROL_HZ <= 60.1
        usual = plan(action, poses)
        [resting] = ARMS.keys() - acts(usual)
        np.testing.assert_allclose(rows[-1, ARMS[resting]], INITIAL_POSE_DEG[ARMS[resting]], atol=1e-9)
        simulation.reset(tuple(simulation.objects)[: len(SLOTS)], poses, conditions)
        outcomes.append(replay(simulation, action, rows))
    assert outcomes.count(Outcome.PERFECT) >= len(outcomes) - 1, outcomes


def test_the_acting_arm_rises_straight_up_from_where_it_starts() -> None:
    start = Conditions(arms_deg=(4.0, -3, 5, 6, 5) * 2).start_pose_deg
    rows = plan(find_action("PUSH-R"), SLOT_POSES, start)
    before, risen = (_Arm("right", row).fingertips for row in rows[[0, 7]])  # 0.7 s
    x, y, z = risen - before
    # Joint speeds and limits bend the way a little, as from the initial pose.
    assert z > 0.03 and np.hypot(x, y) < z / 2


def test_the_initial_pose_is_the_usual_start() -> None:
    action = find_action("PULL-L")
    np.testing.assert_array_equal(plan(action, SLOT_POSES, INITIAL_POSE_DEG), plan(action, SLOT_POSES))


def test_plan_is_deterministic() -> None:
    action = find_action("SLIDE-L-L")
    np.testing.assert_array_equal(plan(action, SLOT_POSES), plan(action, SLOT_POSES))


def test_place_out_of_reach_is_named() -> None:
    poses = (SLOT_POSES[0], Pose(0.6, 0.0), SLOT_POSES[2])
    with pytest.raises(OutOfReachError, match=r"PULL-M at x 0\.600 m, y 0\.000 m: the right hand stays"):
        plan(find_action("PULL-M"), poses)


def test_missing_mink_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mink", None)
    monkeypatch.delitem(sys.modules, "clant_claeo.expert")
    with pytest.raises(ModuleNotFoundError, match=r"lerobot_policy_owlxt5\[scripted\]"):
        import_module("clant_claeo.expert")
