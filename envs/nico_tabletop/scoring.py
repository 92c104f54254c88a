# SPDX-License-Identifier: Apache-2.0
"""How well an action went (paper, figure 3).

The paper names three outcomes and leaves the numbers open; the thresholds are our decision.
"""

from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from .tasks import ACTIONS, Action

PERFECT_DISTANCE = 0.03
"""The target must move this far for a perfect outcome, metres."""
TARGET_MOVED = 0.005
"""From here on the target counts as moved, metres."""
OTHER_MOVED = 0.01
"""From here on another object counts as moved, metres."""
DIRECTION_TOLERANCE_DEG = 45.0
"""Largest angle between the target's motion and the intended direction, degrees."""


class Outcome(StrEnum):
    """The paper's three outcomes."""

    PERFECT = "perfect"
    SUCCESSFUL = "successful"
    FAILURE = "failure"

    @property
    def reward(self) -> float:
        """1 for perfect, 0.5 for successful, 0 for failure."""
        return {Outcome.PERFECT: 1.0, Outcome.SUCCESSFUL: 0.5, Outcome.FAILURE: 0.0}[self]


class Failure(StrEnum):
    """In which way an action failed."""

    REFUSED = "refused"
    """The robot held still."""
    MISSED = "missed"
    """It moved, and no object did."""
    MOVED_WRONGLY = "moved wrongly"
    """An object moved that should not, or another way than it should."""


def judge(action: Action, start: NDArray[np.float64], end: NDArray[np.float64]) -> Outcome:
    """Compare the objects' places before and after an action.

    *Perfect*: the right object moved in the intended direction beyond the threshold, and no other moved.
    *Successful*: the same without the threshold. *Failure*: anything else.

    Args:
        action: What was to be done.
        start: Object positions before, shape (objects, 3), metres: by slot, then any others.
        end: Object positions after, the same shape.
    """
    motion = (end - start)[:, :2]
    distance = np.linalg.norm(motion, axis=1)
    others = np.delete(distance, action.slot)
    moved = distance[action.slot]
    along = motion[action.slot] @ np.array(action.verb.direction, dtype=float)
    right_way = along >= moved * np.cos(np.deg2rad(DIRECTION_TOLERANCE_DEG))
    if moved < TARGET_MOVED or not right_way or (others >= OTHER_MOVED).any():
        return Outcome.FAILURE
    return Outcome.PERFECT if moved >= PERFECT_DISTANCE else Outcome.SUCCESSFUL


def why_it_failed(
    action: Action | None, start: NDArray[np.float64], end: NDArray[np.float64], *, held_still: bool
) -> Failure:
    """Say in which way an action failed.

    Args:
        action: What was to be done; None: nothing.
        start: Object positions before, shape (objects, 3), metres: by slot, then any others.
        end: Object positions after, the same shape.
        held_still: Whether the robot was told to stay in its pose all the time.
    """
    if held_still:
        return Failure.REFUSED
    distance = np.linalg.norm((end - start)[:, :2], axis=1)
    least = np.full(len(distance), OTHER_MOVED)
    if action is not None:
        least[action.slot] = TARGET_MOVED
    return Failure.MOVED_WRONGLY if (distance >= least).any() else Failure.MISSED


def recognize(start: NDArray[np.float64], end: NDArray[np.float64]) -> tuple[Action, Outcome] | None:
    """Which of the twelve actions was done, whatever was intended.

    Args:
        start: Object positions before, shape (3, 3), metres, by slot.
        end: Object positions after, the same shape.

    Returns:
        The action and its outcome, perfect or successful; None if it was none of them.
    """
    outcomes = ((action, judge(action, start, end)) for action in ACTIONS)
    return next((done for done in outcomes if done[1] is not Outcome.FAILURE), None)


def describe_changes(names: Sequence[str], start: NDArray[np.float64], end: NDArray[np.float64]) -> str:
    """Say what was done: `push red: perfect`, or how far objects moved, or that none did.

    Args:
        names: The objects on the left, middle and right slot.
        start: Object positions before, shape (3, 3), metres, by slot.
        end: Object positions after, the same shape.
    """
    if done := recognize(start, end):
        action, outcome = done
        return f"{action.verb.name} {names[action.slot]}: {outcome}"
    distance = np.linalg.norm((end - start)[:, :2], axis=1)
    moved = [
        f"{name} moved {100 * far:.1f} cm"
        for name, far in zip(names, distance, strict=True)
        if far >= TARGET_MOVED
    ]
    return f"none of the twelve actions; {', '.join(moved)}" if moved else "no object moved"
