# SPDX-License-Identifier: Apache-2.0
"""Joint positions and displacements as whole numbers, so that they can be tokens (RT-2, section 3.2)."""

import math

import torch
from torch import Tensor

N_BINS = 256
"""As in RT-2. All bins are equally wide."""
ZERO_BIN = N_BINS // 2
"""Its middle is exactly 0, so a robot that holds does not creep (our decision)."""
BINS_PER_UNIT = ZERO_BIN - 1
"""So that 1 is the middle of the last bin, as in a signed byte."""


def to_bins(values: Tensor) -> Tensor:
    """Which bin each value is in.

    Args:
        values: (...), scaled to [-1, 1]; what is beyond is in the outermost bin.

    Returns:
        (...), int64, from 0 to `N_BINS` - 1.
    """
    return ((values * BINS_PER_UNIT).round() + ZERO_BIN).clamp(0, N_BINS - 1).to(torch.int64)


def to_values(bins: Tensor) -> Tensor:
    """The middle of each bin, at most half a bin (0.5 / `BINS_PER_UNIT`) from all values in [-1, 1] in it.

    Args:
        bins: (...), int64.

    Returns:
        (...), float32, scaled to [-1, 1]; the first bin, which only values below -1 are in, is just beyond.
    """
    return (bins - ZERO_BIN) / BINS_PER_UNIT


def ordered_embeddings(width: int) -> Tensor:
    """Embeddings in which near bins are alike, to begin with (our decision; RT-2's numbers are pre-trained).

    Sines and cosines of the bin's number, like those of positions in a Transformer (Vaswani et al., 2017),
    from half a wave over all bins to one over four.

    Returns:
        (`N_BINS`, width), with the size that T5's embeddings have: a mean square of 1.
    """
    slowest, quickest = math.pi / N_BINS, math.pi / 2
    frequencies = torch.logspace(math.log10(slowest), math.log10(quickest), math.ceil(width / 2))
    angles = torch.arange(N_BINS)[:, None] * frequencies
    return math.sqrt(2) * torch.cat([angles.sin(), angles.cos()], dim=1)[:, :width]
