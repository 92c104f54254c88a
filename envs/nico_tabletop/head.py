# SPDX-License-Identifier: Apache-2.0
"""How NICO's head moves to express something: it turns to a place, nods and shakes.

The head is drawn and nothing else (`drawn_head`): no physics, and the eyes' camera stays where it is.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .nico_mjcf import HEAD_PITCH_DEG

MOST_DEG = np.array([[-60.0, 60.0], [-40.0, 20.0]])
"""Farthest turns to right and left, and up and down, shape (2, 2), degrees from the middle (our decision).

They lie within the joints' limits in `nico_kinematics.json`: `head_z` has -179 to 180 degrees, `head_y` -89
to 79 degrees. The middle is at `HEAD_PITCH_DEG` of the latter.
"""
NOD_DEG, SHAKE_DEG = 14.0, 20.0
"""How far a nod goes down and up, and a shake to the left and to the right (our decision)."""
PERIODS = 10
"""So many control periods, one second, does each expression take (our decision)."""

_TIMES = np.arange(1, PERIODS + 1)[:, None] / PERIODS
_EASE = (1 - np.cos(np.pi * _TIMES)) / 2  # both begin and end without a jerk
_SWING = (np.sin(2 * np.pi * _TIMES) * np.sin(np.pi * _TIMES) / 0.77)[:-1]  # at most 1; the last is 0


class Head:
    """A head that turns somewhere, and nods or shakes meanwhile; the last of each counts.

    Poses are two angles, degrees from the middle, where the eyes' camera looks: to the left, and down.
    """

    def __init__(self) -> None:
        self._gaze: NDArray[np.float64] = np.zeros(2)
        self._turns: list[NDArray[np.float64]] = []
        self._swings: list[NDArray[np.float64]] = []

    def turn_to(self, pose_deg: ArrayLike) -> None:
        """Turn to a pose, shape (2,), and stay there; what is out of `MOST_DEG` is cut."""
        goal = np.clip(pose_deg, *MOST_DEG.T)
        self._turns = [*(self._gaze + (goal - self._gaze) * _EASE)[:-1], goal]

    def nod(self) -> None:
        """Nod once, down and up."""
        self._swings = [*(_SWING * [0, NOD_DEG])]

    def shake(self) -> None:
        """Shake once, to the left and to the right."""
        self._swings = [*(_SWING * [SHAKE_DEG, 0])]

    def next_pose(self) -> NDArray[np.float64]:
        """The pose after one more control period (0.1 s), shape (2,)."""
        if self._turns:
            self._gaze = self._turns.pop(0)
        if not self._swings:
            return self._gaze
        return np.clip(self._gaze + self._swings.pop(0), *MOST_DEG.T)


def pose_towards(x: float, y: float, aspect: float, fovy_deg: float) -> NDArray[np.float64]:
    """The head's pose towards what the eyes' camera shows at a place of its image.

    Args:
        x: From the image's left edge, as a share of its width.
        y: From its upper edge, as a share of its height.
        aspect: Width over height of the image.
        fovy_deg: The camera's vertical field of view, degrees.

    Returns:
        Shape (2,), degrees from the middle, see `Head`.
    """
    reach = np.tan(np.deg2rad(fovy_deg) / 2)
    left, below = (1 - 2 * x) * reach * aspect, (2 * y - 1) * reach
    middle = np.deg2rad(HEAD_PITCH_DEG)
    ahead = np.cos(middle) - below * np.sin(middle)
    down = np.sin(middle) + below * np.cos(middle)
    pose = np.array([np.arctan2(left, ahead), np.arctan2(down, np.hypot(ahead, left)) - middle])
    return np.rad2deg(pose)
