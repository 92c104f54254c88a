# SPDX-License-Identifier: Apache-2.0
"""What one robot is doing about its task: the path that it follows, and what comes at its end."""

from dataclasses import dataclass
from enum import StrEnum

import torch
from torch import Tensor

from .commands.answer import Request, Target
from .commands.happened import Change
from .commands.instruction import Instruction
from .commands.replies import MOVEMENT_OVER
from .commands.verbs import VERBS
from .look_again import Memory
from .scene import Moved
from .way_home import APPROACH_STEPS, straight, way_back, way_out

BLEND_STEPS = 8
"""So many steps pass from an old plan to a new one, when the thing was moved in the middle of a movement."""
_ON_ITS_PATH = 0.1
"""A robot is where its path has led it if no joint is farther off, as a share of half its range."""


class Next(StrEnum):
    """What comes at the end of a path."""

    NOTHING = "nothing"
    """The robot has done what it was asked for, and holds still."""
    PLAN = "plan"
    """The arms are at home now: look, and plan the movement."""
    REPORT = "report"
    """The arms are at home again: look, and say what happened."""


@dataclass
class Execution:
    """One robot on one task.

    Attributes:
        task: What it was asked for; None if it is to be planned anew.
        instruction: What that was understood as.
        start: (joints,), scaled to [-1, 1], where the path begins.
        path: (steps, joints), where to go step by step; the last is held at its end.
        response: What is said about it.
        spoken_of: What "it" means from now on.
        next: What comes at the path's end.
        movement: How many steps of the path move a thing; then comes the way home.
        memory: What was seen before the movement; None if nobody can compare.
        step: How many steps are done.
        change: What was seen to have happened; None before the report, or if nobody can compare.
        moved: What the robot has moved, now or before, each thing where it was seen then.
        came: (steps, joints), how the arms came from home to where the path begins; None if
            that is home, or not known.
    """

    task: str | None
    instruction: Instruction
    start: Tensor
    path: Tensor
    response: str
    spoken_of: Target | None
    next: Next = Next.NOTHING
    movement: int = 0
    memory: Memory | None = None
    step: int = 0
    change: Change | None = None
    moved: Moved = ()
    came: Tensor | None = None

    @property
    def waits(self) -> bool:
        """Whether the path is at its end, and something comes then."""
        return self._ended and self.next is not Next.NOTHING

    @property
    def came_home(self) -> bool:
        """Whether the arms have just gone home, to begin there."""
        return self._ended and self.next is Next.PLAN

    @property
    def request(self) -> Request | None:
        """What it was asked for, and what comes after it; None where nothing is to be moved.

        The thing has the name under which it was found. Before that, "it" is what was spoken of before.
        """
        return self.instruction.request(self.spoken_of if self.movement else None)

    @property
    def succeeded(self) -> bool:
        """Whether the thing was seen to have gone where it should."""
        verb = self.instruction.verb
        return self.change is not None and verb is not None and self.change.way == VERBS[verb].way

    @property
    def is_over(self) -> bool:
        """Whether the path is at its end, and nothing comes then."""
        return self.task is not None and self._ended and self.next is Next.NOTHING

    @property
    def _ended(self) -> bool:
        return self.step >= len(self.path)

    def next_action(self) -> Tensor:
        """The next joint target, (joints,)."""
        action = self.path[min(self.step, len(self.path) - 1)]
        self.step += 1
        return action

    def chunk(self, steps: int) -> Tensor:
        """The movement alone, (steps, joints), its end held; or the way home, as far as it fits."""
        end = (self.movement or len(self.path)) - 1
        return self.path[torch.arange(steps, device=self.path.device).clamp(max=end)]

    def is_time_to_look(self, every: int) -> bool:
        """Whether it is at one of every so many steps, and no hand has reached the thing yet.

        After the approach it is the hand that moves the thing.
        """
        return 0 < self.step <= min(self.movement - 1, APPROACH_STEPS) and self.step % every == 0

    def report(self, change: Change | None) -> str:
        """Say what happened. Who cannot compare claims nothing."""
        if change is None or self.memory is None or self.instruction.verb is None:
            return MOVEMENT_OVER
        return change.report(self.instruction.verb, self.memory.thing.name)

    def way_home(self, pose: Tensor, home: Tensor) -> Tensor:
        """How to get home, (steps, joints): back as the robot came, if it is where the path has led it.

        Who is on its way home already goes on with that.

        Args:
            pose: (joints,), where the robot is.
            home: (joints,), where movements begin.
        """
        if not self._is_at(pose):
            return straight(pose, home)
        if self._goes_home:
            return torch.cat([self.path[self.step :], straight(self.path[-1], home)])
        done = self._done
        return torch.cat([way_out(done), straight(done[0], home)])

    def way_here(self, pose: Tensor) -> Tensor | None:
        """How the arms came from home to a pose (joints,), (steps, joints); None if that is not known."""
        return self._done if self._is_at(pose) and not self._goes_home else None

    @property
    def _done(self) -> Tensor:
        """All poses since the arms were at home, (steps, joints)."""
        here = torch.cat([self.start[None], self.path[: self.step]])
        return here if self.came is None else torch.cat([self.came, here])

    @property
    def _goes_home(self) -> bool:
        """Whether what is left of the path leads home."""
        return self.next is Next.PLAN or 0 < self.movement <= self.step

    def _is_at(self, pose: Tensor) -> bool:
        """Whether a robot in a pose (joints,) is where the path has led it."""
        return bool((pose - self._done[-1]).abs().max() <= _ON_ITS_PATH)

    def change_plan(self, plan: Tensor, memory: Memory) -> None:
        """Pass over to another plan (L, joints) of the same start: the thing is elsewhere now.

        A plan that is over by now, as of a thing that is out of reach, changes nothing.
        """
        old = self.path[self.step - 1] if self.step else self.start
        movement, back = _path_of(self.start, plan)
        if len(movement) <= self.step:
            return
        rest = movement[self.step :]
        share = torch.arange(1, len(rest) + 1, device=rest.device)[:, None] / BLEND_STEPS
        rest = torch.lerp(rest + (old - movement[self.step - 1]), rest, share.clamp(max=1.0)).clamp(-1.0, 1.0)
        self.path = torch.cat([self.path[: self.step], rest, back])
        self.movement, self.memory = len(movement), memory


def carry_out(
    task: str,
    instruction: Instruction,
    pose: Tensor,
    plan: Tensor,
    response: str,
    spoken_of: Target | None,
    memory: Memory | None,
) -> Execution:
    """Follow a plan (L, joints) from a pose (joints,); after a movement of ours go home, and look."""
    movement, back = _path_of(pose, plan)
    path = torch.cat([movement, back]) if instruction.verb else movement
    after = Next.REPORT if instruction.verb else Next.NOTHING
    return Execution(task, instruction, pose, path, response, spoken_of, after, len(movement), memory)


def _path_of(start: Tensor, plan: Tensor) -> tuple[Tensor, Tensor]:
    """A plan (L, joints) up to its end, and the way home after it, both (steps, joints)."""
    changes = (plan.diff(dim=0) != 0).any(dim=1).nonzero()
    movement = plan[: int(changes[-1, 0]) + 2] if len(changes) else plan[:1]
    return movement, way_back(torch.cat([start[None], movement]))
