# SPDX-License-Identifier: Apache-2.0
"""Acts a recorded trajectory to the end of an episode and judges it."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .scoring import Outcome, judge
from .simulation import TabletopSimulation
from .tasks import EPISODE_STEPS, Action


def replay(
    simulation: TabletopSimulation,
    action: Action,
    joints: NDArray[np.float64],
    on_frame: Callable[[int], None] | None = None,
) -> Outcome:
    """Follow a trajectory in a world that was just reset, hold its end, and judge what happened.

    Args:
        simulation: The world, after `reset`; afterwards it is in the episode's last state.
        action: What the trajectory shall do.
        joints: Shape (T, 10), degrees, 10 rows a second; the first row is the pose to start from.
        on_frame: Called with 0 to T - 1, each time before the step towards the following row.

    Returns:
        The outcome after `EPISODE_STEPS` steps, as in the environment.

    Raises:
        ValueError: If the trajectory is longer than an episode.
    """
    if len(joints) > EPISODE_STEPS:
        raise ValueError(
            f"a trajectory of {len(joints)} rows is longer than an episode ({EPISODE_STEPS} steps)"
        )
    start = simulation.object_positions()
    for step in range(EPISODE_STEPS):
        if on_frame and step < len(joints):
            on_frame(step)
        simulation.step(joints[min(step + 1, len(joints) - 1)])
    return judge(action, start, simulation.object_positions())
