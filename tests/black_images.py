# SPDX-License-Identifier: Apache-2.0
"""A world that draws nothing, for what depends on its movements alone: drawing takes most of the time."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from nico_tabletop.simulation import TabletopSimulation


@contextmanager
def black_images() -> Iterator[None]:
    """Meanwhile all cameras see nothing."""

    def draw(simulation: TabletopSimulation, camera: str, height: int, width: int) -> np.ndarray:
        return np.zeros((height, width, 3), np.uint8)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TabletopSimulation, "render", draw)
        yield
