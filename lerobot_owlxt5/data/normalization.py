# SPDX-License-Identifier: Apache-2.0
"""The one range by which state and action are scaled."""

from typing import Any

import numpy as np
from lerobot.utils.constants import ACTION, OBS_STATE

# A joint that moves less than this share of the widest joint's range counts as constant.
SMALLEST_RANGE = 1e-3

Stats = dict[str, dict[str, Any]]


def share_joint_range(stats: Stats) -> Stats:
    """Give state and action one range, as they are positions of the same joints.

    The action decoder reads the first pose and then its own outputs (paper, section 3), which must therefore
    be scaled alike. A constant joint gets a small symmetric range around its value: scaled by the width of
    its own range, the slightest deviation of a real joint would be blown up to infinity.

    Args:
        stats: Statistics by feature; `min` and `max` of state and action have shape (joints,).

    Returns:
        A copy with the common `min` and `max` in both features, or the same statistics if one is missing.
        Sharing again changes nothing.
    """
    if OBS_STATE not in stats or ACTION not in stats:
        return stats
    state, action = stats[OBS_STATE], stats[ACTION]
    low = np.minimum(np.asarray(state["min"]), np.asarray(action["min"])).astype(np.float64)
    high = np.maximum(np.asarray(state["max"]), np.asarray(action["max"])).astype(np.float64)
    smallest = SMALLEST_RANGE * (np.max(high - low) or 1.0)
    lack = np.maximum(smallest - (high - low), 0.0) / 2
    common = {"min": low - lack, "max": high + lack}
    return {**stats, OBS_STATE: {**state, **common}, ACTION: {**action, **common}}
