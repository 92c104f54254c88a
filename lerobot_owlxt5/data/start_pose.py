# SPDX-License-Identifier: Apache-2.0
"""Where a plan may begin: near the first poses of the training data, where those that were learnt begin."""

import numpy as np
from torch import Tensor

from .windows import at_step

NEAR = 0.04
"""How far from the trained first poses a plan may begin, as a share of half a joint's range.

NICO's arms may be off by some 4 degrees: a thing that was pulled to a resting hand pushes it by up to 3.
With 10 degrees a hand met balls at the wrong place (measured).
"""
# The same for a joint that hardly moves, as a share of the range of the joint that moves most.
LEAST_NEAR = 0.2


def start_tolerance(poses: np.ndarray, ranges: np.ndarray) -> np.ndarray:
    """How far from the mean of the first poses a plan may begin: as far as they do, and `NEAR`.

    A joint that hardly moves is scaled up. It may be off by what others may, not by a share of its own range.

    Args:
        poses: The episodes' first poses, (episodes, joints), scaled.
        ranges: Of the joints, before they were scaled, (joints,).

    Returns:
        (joints,), scaled.
    """
    spread = np.abs(poses - poses.mean(axis=0)).max(axis=0)
    tolerance: np.ndarray = spread + NEAR * np.maximum(1.0, LEAST_NEAR * ranges.max() / ranges)
    return tolerance


def is_far(state: Tensor, rest_pose: Tensor, tolerance: Tensor) -> Tensor:
    """Whether a robot is too far from where the movements of the training data begin.

    Args:
        state: Scaled joints (batch, joints), or with a time axis, of which the first step counts.
        rest_pose: Mean first pose of the training data, (joints,), scaled.
        tolerance: How far from it each joint may be, (joints,), scaled.

    Returns:
        (batch,) bool.
    """
    return ((at_step(state, 0) - rest_pose).abs() > tolerance).any(dim=1)
