# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nico_tabletop.scoring import Failure, Outcome, judge, why_it_failed
from nico_tabletop.tasks import ACTIONS, find_action

START = np.array([[0.3, 0.15, 0.5], [0.34, 0.0, 0.5], [0.3, -0.15, 0.5]])


def moved(slot: int, dx: float, dy: float) -> np.ndarray:
    end = START.copy()
    end[slot, :2] += dx, dy
    return end


@pytest.mark.parametrize(
    ("dx", "dy", "expected"),
    [
        (0.031, 0.0, Outcome.PERFECT),
        (0.029, 0.0, Outcome.SUCCESSFUL),
        (0.006, 0.0, Outcome.SUCCESSFUL),
        (0.004, 0.0, Outcome.FAILURE),  # as good as not moved
        (0.05, 0.049, Outcome.PERFECT),
        (0.05, 0.051, Outcome.FAILURE),  # more than 45 degrees off
        (-0.05, 0.0, Outcome.FAILURE),
    ],
)
def test_distance_and_direction(dx: float, dy: float, expected: Outcome):
    assert judge(find_action("PUSH-M"), START, moved(1, dx, dy)) is expected


def test_another_object_that_moves_is_a_failure():
    end = moved(1, 0.05, 0.0)
    end[2, 1] -= 0.009
    assert judge(find_action("PUSH-M"), START, end) is Outcome.PERFECT
    end[2, 1] -= 0.002
    assert judge(find_action("PUSH-M"), START, end) is Outcome.FAILURE


@pytest.mark.parametrize(
    ("slot", "dx", "held_still", "expected"),
    [
        (1, 0.0, True, Failure.REFUSED),
        (1, 0.004, False, Failure.MISSED),
        (1, -0.006, False, Failure.MOVED_WRONGLY),  # the right object, the wrong way
        (2, 0.009, False, Failure.MISSED),
        (2, 0.011, False, Failure.MOVED_WRONGLY),  # another object
    ],
)
def test_failures_are_told_apart(slot: int, dx: float, held_still: bool, expected: Failure):
    end = moved(slot, dx, 0.0)
    action = find_action("PUSH-M")
    assert judge(action, START, end) is Outcome.FAILURE
    assert why_it_failed(action, START, end, held_still=held_still) is expected


@given(
    action=st.sampled_from(ACTIONS),
    distance=st.floats(0.0, 0.3),
    angle=st.floats(-180, 180).filter(lambda a: abs(abs(a) - 45) > 1e-6),
)
def test_the_outcome_depends_on_distance_and_angle_alone(action, distance: float, angle: float):
    turn = np.deg2rad(angle)
    x, y = action.verb.direction
    dx, dy = (
        distance * (x * np.cos(turn) - y * np.sin(turn)),
        distance * (x * np.sin(turn) + y * np.cos(turn)),
    )
    outcome = judge(action, START, moved(action.slot, dx, dy))
    if distance < 0.005 - 1e-9 or abs(angle) > 45:
        assert outcome is Outcome.FAILURE
    elif distance > 0.03 + 1e-9:
        assert outcome is Outcome.PERFECT
    elif 0.005 + 1e-9 < distance < 0.03 - 1e-9:
        assert outcome is Outcome.SUCCESSFUL


def test_the_twelve_actions_are_clants():
    left, middle = "PUSH-L PULL-L SLIDE-L-L SLIDE-L-R", "PUSH-M PULL-M SLIDE-M-L SLIDE-M-R"
    right = "PUSH-R PULL-R SLIDE-R-L SLIDE-R-R"
    assert [action.name for action in ACTIONS] == f"{left} {middle} {right}".split()
    with pytest.raises(ValueError, match=r"LIFT-M.*PUSH-L"):
        find_action("LIFT-M")
