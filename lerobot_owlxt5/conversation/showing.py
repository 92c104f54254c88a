# SPDX-License-Identifier: Apache-2.0
"""What somebody shows a robot by moving its arms: the paper's modes describe and repeat action."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any, cast

import torch
from lerobot.utils.constants import OBS_STATE
from torch import Tensor

from ..commands.happened import retell
from ..data.windows import finished_episode
from ..executing_policy import ExecutingPolicy
from ..modeling_crossmodal import CrossmodalPolicy
from .body import Body

WATCHING = "I watch. Move my arms, and say 'done' at the end."
NOTHING_SHOWN = "You have not moved my arms."
NOTHING_TO_IMITATE = "You have shown me nothing yet: say 'watch me' first."
CANNOT_DESCRIBE = "I cannot tell what is done to things: this policy has not learnt it."
CANNOT_IMITATE = "I cannot do it as you did: this policy has not learnt it."
MOVED = 1.0
"""A joint that is farther off has been moved; in the robot's unit, mostly degrees (our decision)."""


class Demonstration:
    """Watches from when the arms begin to move; before that somebody is about to begin.

    Args:
        policy: It was trained in describe.
        body: Its arms are moved by somebody else.
    """

    def __init__(self, policy: CrossmodalPolicy, body: Body) -> None:
        self._policy, self._body = policy, body
        body.look()
        [scene] = policy.scenes(body.batch(""))
        self._labels = [*dict.fromkeys(thing.name for thing in scene.things)]
        self._first: Mapping[str, Any] = body.observation("")
        self._last = self._first
        self._positions: list[Tensor] = []

    def watch(self) -> None:
        """Take in what is to be seen now."""
        self._body.look()
        now = self._body.observation("")
        moved = (now[OBS_STATE] - self._first[OBS_STATE]).abs().max() > MOVED
        if self._positions or moved:
            self._last = now
            self._positions.append(now[OBS_STATE])
        else:
            self._first = now

    @property
    def has_begun(self) -> bool:
        """Whether the arms have moved."""
        return bool(self._positions)

    @property
    def is_full(self) -> bool:
        """Whether no more steps can be watched: L of the policy."""
        return len(self._positions) == self._policy.config.max_episode_steps

    def describe(self) -> str:
        """Say what was done, in a sentence."""
        return retell(self._description)

    @torch.no_grad()
    def repeat(self) -> Tensor:
        """The same movement again, (L, joints), scaled as the policy scales joints."""
        return self._policy.repeat_action(self._episode | {"task": [self._description]})[0]

    @cached_property
    def _description(self) -> str:
        return self._policy.describe(self._episode, self._labels)[0] if self._labels else ""

    @cached_property
    def _episode(self) -> dict[str, Any]:
        """A finished episode. Each position is where an action led: nobody has commanded any."""
        length = self._policy.config.max_episode_steps
        return self._body.preprocess(finished_episode([self._first, self._last], self._positions, length))


class Showing:
    """Somebody shows something, and the robot tells what it was, or does it again.

    Args:
        policy: Any; one that has not learnt to describe says so.
        body: Its robot.

    Attributes:
        goes_on: Whether the robot is watching.
    """

    def __init__(self, policy: ExecutingPolicy, body: Body) -> None:
        tells_objects = isinstance(policy, CrossmodalPolicy) and policy.visual.names_objects
        self._policy = cast(CrossmodalPolicy, policy) if tells_objects else None
        self._body = body
        self._shown: Demonstration | None = None
        self._copy: list[Tensor] = []
        self.goes_on = False

    @property
    def copies(self) -> bool:
        """Whether the robot is doing again what was shown, or is about to."""
        return bool(self._copy)

    def stop(self) -> None:
        """Neither watch nor copy any longer."""
        self.goes_on, self._copy = False, []

    def begin(self) -> str:
        """Watch from now on; what to say about it."""
        if self._policy is None or not self._policy.config.was_trained_in("describe"):
            return CANNOT_DESCRIBE
        self._shown, self.goes_on = Demonstration(self._policy, self._body), True
        return WATCHING

    def watch(self) -> str:
        """Go on watching; what to say, if no more can be watched."""
        assert self._shown is not None
        self._shown.watch()
        return self.end() if self._shown.is_full else ""

    def end(self) -> str:
        """Watch no longer; say what was shown."""
        self.goes_on = False
        if self._shown and not self._shown.has_begun:
            self._shown = None
        return self._shown.describe() if self._shown else NOTHING_SHOWN

    def movement(self) -> Tensor | str:
        """What was shown as a movement, (L, joints), scaled; or why there is none."""
        if self._policy is None or not self._policy.config.was_trained_in("repeat_action"):
            return CANNOT_IMITATE
        if self._shown is None or not self._shown.has_begun:
            return NOTHING_TO_IMITATE
        return self._shown.repeat()

    def copy(self, movement: Tensor) -> None:
        """Do again what `movement` returned, a step at each `act`."""
        self._copy = [*movement]

    def act(self) -> bool:
        """One step of the copy; whether it was the last: the ones behind it only hold its end."""
        action = self._copy.pop(0)
        self._body.act(action[None])
        if all(torch.equal(action, later) for later in self._copy):
            self._copy = []
        return not self._copy
