# SPDX-License-Identifier: Apache-2.0
"""Tests of the scripted expert: what it plans, and what its plans do to objects in the world."""

import sys
from importlib import import_module

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from nico_tabletop.objects import SUITES
from nico_tabletop.replay import replay
from nico_tabletop.robot import INITIAL_POSE_DEG, joint_limits_deg
from nico_tabletop.scene import SLOT_XY
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import CONTROL_HZ, TabletopSimulation
from nico_tabletop.tasks import ACTIONS, SLOTS, Action, find_action

pytest.importorskip("mink", reason="the scripted expert needs the extra `scripted`")
from clant_claeo.expert import OutOfReachError, plan

STILL = np.zeros((len(SLOTS), 2))


@pytest.fixture(scope="module")
def simulation() -> TabletopSimulation:
    return TabletopSimulation(SUITES["clant"])


def act(simulation: TabletopSimulation, action: Action, offsets: NDArray[np.float64]) -> Outcome:
    """Outcome of a plan with the three objects moved off their slots by (x, y) metres each."""
    simulation.reset(tuple(simulation.objects)[: len(SLOTS)])
    for slot, name in enumerate(simulation.arrangement):
        simulation.data.joint(name).qpos[:2] += offsets[slot]
    mujoco.mj_forward(simulation.model, simulation.data)
    x, y, _ = simulation.object_positions()[action.slot]
    return replay(simulation, action, plan(action, (x, y)))


@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_every_action_is_perfect(simulation: TabletopSimulation, action: Action) -> None:
    assert act(simulation, action, STILL) == Outcome.PERFECT


@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_objects_may_stand_off_their_slots(simulation: TabletopSimulation, action: Action) -> None:
    for off in [(0.005, -0.005), (-0.005, 0.005)]:
        assert act(simulation, action, np.tile(off, (len(SLOTS), 1))) == Outcome.PERFECT


def test_plans_follow_the_place_within_two_centimetres(simulation: TabletopSimulation) -> None:
    random = np.random.default_rng(5)
    outcomes = [act(simulation, action, random.uniform(-0.02, 0.02, (3, 2))) for action in ACTIONS]
    assert outcomes.count(Outcome.PERFECT) >= 0.9 * len(outcomes)


@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_plans_look_like_clant(action: Action) -> None:
    rows = plan(action, SLOT_XY[action.slot])
    assert rows.dtype == np.float64 and rows.shape[1:] == INITIAL_POSE_DEG.shape
    assert 40 <= len(rows) <= 85
    assert np.isfinite(rows).all()
    np.testing.assert_array_equal(rows[0], INITIAL_POSE_DEG)
    # The first row itself lies 0.02 degrees beyond the elbows' limits, as in CLANT.
    low, high = joint_limits_deg().T
    assert (rows[1:] >= low - 1e-6).all() and (rows[1:] <= high + 1e-6).all()
    assert np.abs(np.diff(rows, axis=0)).max() * CONTROL_HZ <= 60.1


@pytest.mark.parametrize("name, turn", [("PUSH-R", 0.0), ("SLIDE-L-L", 30.0)])
def test_idle_arm_makes_room_where_the_other_reaches_over(name: str, turn: float) -> None:
    action = find_action(name)
    left = plan(action, SLOT_XY[action.slot])[-1, 5:]
    np.testing.assert_allclose(left, INITIAL_POSE_DEG[5:] + turn * np.eye(5)[0], atol=0.05)


def test_plan_is_deterministic() -> None:
    action = find_action("SLIDE-L-L")
    np.testing.assert_array_equal(plan(action, SLOT_XY[0]), plan(action, SLOT_XY[0]))


def test_place_out_of_reach_is_named() -> None:
    with pytest.raises(OutOfReachError, match=r"PULL-M at x 0\.600 m, y 0\.000 m: the right hand stays"):
        plan(find_action("PULL-M"), (0.6, 0.0))


def test_missing_mink_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mink", None)
    monkeypatch.delitem(sys.modules, "clant_claeo.expert")
    with pytest.raises(ModuleNotFoundError, match=r"lerobot_policy_owlxt5\[scripted\]"):
        import_module("clant_claeo.expert")
