# SPDX-License-Identifier: Apache-2.0
"""Joint positions as whole numbers, so that they can be tokens of a vocabulary (RT-2, section 3.2)."""

import torch
from torch import Tensor

N_BINS = 256
"""As in RT-2. All bins are equally wide."""


def to_bins(joints: Tensor) -> Tensor:
    """Which bin each position is in.

    Args:
        joints: (...), scaled to [-1, 1]; what is beyond is in the outermost bin.

    Returns:
        (...), int64, from 0 to `N_BINS` - 1.
    """
    return ((joints + 1) / 2 * N_BINS).floor().clamp(0, N_BINS - 1).to(torch.int64)


def to_joints(bins: Tensor) -> Tensor:
    """The middle of each bin, at most half a bin (1 / `N_BINS`) from all positions in it.

    Args:
        bins: (...), int64.

    Returns:
        (...), float32, scaled to [-1, 1].
    """
    return (bins + 0.5) / N_BINS * 2 - 1
