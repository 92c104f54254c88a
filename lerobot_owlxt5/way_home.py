# SPDX-License-Identifier: Apache-2.0
"""The way back to where movements begin, in the space of the joints: nobody here knows the arms' shape.

All joints are scaled to [-1, 1]. The rules are our decision; `benchmarks/robustness.py` measures them.
"""

import torch
from torch import Tensor

APPROACH_STEPS = 20
"""After so many steps (2 s) a hand has risen and turned, and has not been lowered beside a thing yet."""
FASTEST = 0.1
"""No joint moves by more in a step, as a share of half its range, if it is not known how fast it may be."""
_SHARE_OF_SPEED = 0.8


def way_back(movement: Tensor) -> Tensor:
    """Go back to where a finished movement began: to the end of its approach, which is then retraced.

    Args:
        movement: (steps, joints), the first pose and all that followed.

    Returns:
        (steps, joints), no joint faster than in the movement.
    """
    approach = movement[: APPROACH_STEPS + 1].flip(0)
    return along(torch.cat([movement[-1:], approach]), _fastest(movement))


def way_out(done: Tensor) -> Tensor:
    """Go back from the middle of a movement: retrace it, as a hand beside a thing has only this way out.

    Args:
        done: (steps, joints), the first pose and all that followed until now.
    """
    if len(done) < 2:
        return done
    return along(done.flip(0), _fastest(done))


def _fastest(movement: Tensor) -> Tensor:
    """How far each joint went in its fastest step, (joints,) or (1,); a joint that rested may creep."""
    fastest = movement.diff(dim=0).abs().amax(dim=0) if len(movement) > 1 else movement.new_zeros(1)
    return fastest.clamp(min=FASTEST / 10)


def straight(pose: Tensor, goal: Tensor) -> Tensor:
    """Go from a pose to another one (joints,) when it is not known how the arms came there."""
    return along(torch.stack([pose, goal]), pose.new_tensor(FASTEST))


def along(points: Tensor, fastest: Tensor) -> Tensor:
    """Follow a line through points, at one pace from its slow start to its slow end.

    Args:
        points: (points, joints), at least two; the first is where the arms are.
        fastest: (joints,) or one for all: how far each joint may go in a step.

    Returns:
        (steps, joints), from the first step on; the last is the last point.
    """
    legs = (points.diff(dim=0).abs() / fastest).amax(dim=1)
    passed = torch.cat([legs.new_zeros(1), legs.cumsum(dim=0)])
    steps = max(1, int(torch.ceil(passed[-1] / _SHARE_OF_SPEED)))
    time = torch.arange(1, steps + 1, device=points.device) / steps
    # A trapezoid of speed: it grows over the first tenth and falls over the last.
    eased = torch.where(
        time < 0.1, 5 * time**2, torch.where(time > 0.9, 0.9 - 5 * (1 - time) ** 2, time - 0.05)
    )
    way = (eased / 0.9 * passed[-1]).clamp(max=passed[-1])
    leg = torch.searchsorted(passed[1:], way).clamp(max=len(legs) - 1)
    share = (way - passed[leg]) / legs[leg].clamp(min=1e-9)
    return torch.cat([torch.lerp(points[leg], points[leg + 1], share[:, None])[:-1], points[-1:]])
