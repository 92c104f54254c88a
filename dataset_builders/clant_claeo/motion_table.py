# SPDX-License-Identifier: Apache-2.0
"""The motions of the policy `motion_library`: python -m clant_claeo.motion_table.

The scripted expert solves each verb's movement with each arm for the places of a grid on the table. The
table goes into the package of the policy, which knows neither MuJoCo nor inverse kinematics. Grid and format
are our decision.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save_file
from tqdm import tqdm

from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.motion_library import ARMS, SHIPPED
from nico_tabletop.placement import OutOfReachError, Pose
from nico_tabletop.robot import INITIAL_POSE_DEG, JOINT_NAMES
from nico_tabletop.tasks import VERBS, Verb

from .expert import MIDDLE, acting_arm, move

X = np.linspace(0.315, 0.435, 7)
"""Places of the grid, forward, metres: the region of the free placement. Nearer, nothing can be pulled."""
OUTWARD = np.linspace(-0.08, 0.22, 16)
"""Places to the side of the acting arm, metres; below 0 it reaches over to the other side."""
TURN_SECONDS = 3.2
"""On the longest way of the grid, and the same everywhere, so that rows of neighbours match."""


@dataclass
class MotionTableConfig:
    """Where the table goes.

    Args:
        output: File; the policy reads the one in its package.
    """

    output: Path = SHIPPED


def _solve(verb: Verb, arm: str, x: float, outward: float) -> NDArray[np.float64] | None:
    """The movement of the acting arm at one place, (steps, 5), degrees; None if the arm cannot make it."""
    side = 1 if arm == "left" else -1
    try:
        rows = move(verb, Pose(x, side * outward), arm, turn_seconds=TURN_SECONDS)
    except OutOfReachError:
        return None
    return rows[1:, [name.startswith(arm[0]) for name in JOINT_NAMES]]


def stretch(rows: NDArray[np.float64], steps: int) -> NDArray[np.float64]:
    """The same movement in so many steps, (steps, joints)."""
    times = np.linspace(0, len(rows) - 1, steps)
    return np.stack([np.interp(times, np.arange(len(rows)), column) for column in rows.T], axis=1)


def solve_motions() -> dict[str, NDArray[np.generic]]:
    """Solve all motions.

    Returns:
        The tensors that `lerobot_owlxt5.motion_library.MotionLibrary` describes.
    """
    cells = [
        (verb, arm, x, outward)
        for verb, direction in enumerate(VERBS)
        for arm in range(len(ARMS))
        for x in range(len(X))
        for outward in range(len(OUTWARD))
    ]
    solved = {
        cell: rows
        for cell in tqdm(cells, unit="motion")
        if (rows := _solve(VERBS[cell[0]], ARMS[cell[1]], X[cell[2]], OUTWARD[cell[3]])) is not None
    }
    # A leg has a row more or less where the fingertips were off before it.
    longest = max(map(len, solved.values()))
    shape = (len(VERBS), len(ARMS), len(X), len(OUTWARD), longest, len(JOINT_NAMES) // len(ARMS))
    motions = np.full(shape, np.nan, dtype=np.float16)
    for cell, rows in solved.items():
        motions[cell] = stretch(rows, longest)
    acting = np.moveaxis(motions, 1, 0).reshape(len(ARMS), -1, shape[-1]).astype(np.float32)
    first = [ARMS.index(acting_arm(verb, Pose(X[0], 0.0))) for verb in VERBS]
    return {
        "motions": motions,
        "x": X.astype(np.float32),
        "outward": OUTWARD.astype(np.float32),
        "rest": INITIAL_POSE_DEG.astype(np.float32),
        "low": np.minimum(np.nanmin(acting, axis=1).ravel(), INITIAL_POSE_DEG).astype(np.float32),
        "high": np.maximum(np.nanmax(acting, axis=1).ravel(), INITIAL_POSE_DEG).astype(np.float32),
        "middle": np.array(MIDDLE, dtype=np.float32),
        "arm_in_middle": np.array(first, dtype=np.int64),
    }


@command("motion_table")
def main(config: MotionTableConfig) -> None:
    """Solve and write."""
    save_file(solve_motions(), config.output)


if __name__ == "__main__":
    main()
