# SPDX-License-Identifier: Apache-2.0
"""Motions solved beforehand by inverse kinematics: a verb and a place on the table in, joint targets out."""

from collections.abc import Sequence
from pathlib import Path

import torch
from safetensors.torch import load_file
from torch import Tensor, nn

from .commands.parser import parse_command
from .commands.verbs import VERBS

SHIPPED = Path(__file__).with_name("motions.safetensors")
"""The table of NICO's motions, made by `python -m clant_claeo.motion_table`."""
ARMS = ("right", "left")
"""In the order of the joints: those of the right arm, then as many of the left one."""
_RIGHT, _LEFT = range(len(ARMS))
_VERBS = [*VERBS]
EDGE = 0.02
"""Places so far outside the grid are taken to its edge: a look may be off by that (our decision), metres."""

ALIKE_DEG = 60.0
"""Motions between which a joint differs more at any step hold the arm in different ways (our decision)."""


class MotionLibrary(nn.Module):
    """A table of motions over a grid of places, between which joint angles are interpolated.

    It has no parameters. Its buffers, in degrees, metres and the robot's frame (x forward, y to its left):

    Attributes:
        motions: (verbs, arms, x, outward, steps, joints of the arm), in the orders of `VERBS` and `ARMS`; NaN
            where the arm cannot make the motion.
        x: (x,), places of the grid, equally spaced.
        outward: (outward,), places to the side of the acting arm, equally spaced.
        rest: (joints,), where all motions begin.
        low: (joints,), least angle of each joint in the table; `high` is the greatest.
        middle: (), an object farther from y = 0 is on the side of an arm, which acts.
        arm_in_middle: (verbs,), which arm acts on other objects. If it cannot, the other one does.
    """

    motions: Tensor
    x: Tensor
    outward: Tensor
    rest: Tensor
    low: Tensor
    high: Tensor
    middle: Tensor
    arm_in_middle: Tensor

    def __init__(self) -> None:
        """Read the shipped table."""
        super().__init__()
        for name, tensor in load_file(SHIPPED).items():
            self.register_buffer(name, tensor)

    def reaches(self, place: Tensor) -> bool:
        """Whether each verb's motion can be made at a place (2,), x and y."""
        return all(self._find(verb, place) is not None for verb in range(len(_VERBS)))

    def joint_targets(self, verb: str, place: Tensor) -> tuple[slice, Tensor] | None:
        """The motion that a verb asks for at a place.

        Args:
            verb: One of `VERBS`.
            place: (2,), where the object stands.

        Returns:
            The joints of the acting arm, and their targets (steps, joints of the arm), float32, degrees; None
            if no arm can make the motion.
        """
        found = self._find(_VERBS.index(verb), place)
        if found is None:
            return None
        arm, corners, weights = found
        joints = corners.shape[-1]
        targets = (corners.float() * weights[:, None, None]).sum(dim=0)
        return slice(arm * joints, (arm + 1) * joints), targets

    def _find(self, verb: int, place: Tensor) -> tuple[int, Tensor, Tensor] | None:
        """The acting arm, its motions at the four corners of the grid's cell, and their weights (4,)."""
        x, y = place.tolist()
        is_left = y > 0 if abs(y) > float(self.middle) else int(self.arm_in_middle[verb]) == _LEFT
        for arm in (_LEFT, _RIGHT) if is_left else (_RIGHT, _LEFT):
            forward, sideways = _locate(self.x, x), _locate(self.outward, y if arm == _LEFT else -y)
            if forward is None or sideways is None:
                continue
            (row, along), (column, across) = forward, sideways
            corners = self.motions[verb, arm, row : row + 2, column : column + 2].flatten(0, 1)
            if corners.isfinite().all():
                weights = [
                    (1 - along) * (1 - across),
                    (1 - along) * across,
                    along * (1 - across),
                    along * across,
                ]
                return arm, corners, _of_one_kind(corners, torch.tensor(weights, device=corners.device))
        return None

    def plan(self, prompts: Sequence[str], visual: Tensor, joints: Tensor, steps: int) -> Tensor:
        """Answer prompts with motions, as `CrossmodalModel.plan` does.

        Args:
            prompts: One for each sample, such as `execute: push red`.
            visual: (batch, 1, 2), where the object stands; what is out of reach is left alone.
            joints: (batch, steps, joints), scaled to [-1, 1]; the joints of the other arm stay as they are.
            steps: Length of a plan; the last target is held.

        Returns:
            (batch, steps, joints), scaled to [-1, 1].
        """
        plans = joints[:, :1].repeat(1, steps, 1)
        for plan, prompt, [place] in zip(plans, prompts, visual, strict=True):
            verb = parse_command(prompt.partition(":")[2]).verb
            motion = self.joint_targets(verb, place) if verb else None
            if motion:
                arm, targets = motion
                low, high = self.low[arm], self.high[arm]
                rows = torch.arange(steps, device=targets.device).clamp(max=len(targets) - 1)
                plan[:, arm] = 2 * (targets[rows] - low) / (high - low) - 1
        return plans


def _of_one_kind(corners: Tensor, weights: Tensor) -> Tensor:
    """Weights without motions that hold the arm otherwise than the nearest: between two ways is none."""
    nearest = corners[weights.argmax()]
    alike = (corners - nearest).abs().amax(dim=(1, 2)) <= ALIKE_DEG
    return weights * alike / (weights * alike).sum()


def _locate(grid: Tensor, value: float) -> tuple[int, float] | None:
    """The cell of an equally spaced grid that a value is in, and the share of the way through it."""
    first, last, cells = float(grid[0]), float(grid[-1]), len(grid) - 1
    if not first - EDGE <= value <= last + EDGE:
        return None
    way = min(max((value - first) / (last - first), 0.0), 1.0) * cells
    cell = min(int(way), cells - 1)
    return cell, way - cell
