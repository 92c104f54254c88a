# SPDX-License-Identifier: Apache-2.0
"""What a robot expresses with its head while it talks, if it has one that can."""

import re
from typing import Protocol, runtime_checkable

from lerobot.robots import Robot

from ..scene import Thing

_NODS = re.compile(r"Yes\b|I will\b|I move my arms\b|I watch\b")
_SHAKES = re.compile(r"No[,.]|I hold still, because\b|I cannot\b|I see no\b")
_MIDDLE = 0.5


@runtime_checkable
class Expressive(Protocol):
    """A robot with a head that looks, nods and shakes (LaMI's atomic expressions, Wang et al. 2024).

    Expressions begin at once, and `express` carries them on. A robot whose camera moves with its head has to
    be back in the middle before `get_observation` takes an image.
    """

    def look_at(self, x: float, y: float) -> None:
        """Look at a place in the camera's image, and stay so; (0.5, 0.5) is the middle.

        Args:
            x: From the image's left edge, as a share of its width.
            y: From its upper edge, as a share of its height.
        """

    def nod(self) -> None:
        """Nod once."""

    def shake(self) -> None:
        """Shake the head once."""

    def express(self) -> None:
        """Go on with it for one control period, 0.1 s."""


class Expressions:
    """What a conversation lets a robot express; nothing with a robot that is not `Expressive`.

    Args:
        robot: It is connected.
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot if isinstance(robot, Expressive) else None

    def look_at(self, thing: Thing | None) -> None:
        """Look at a thing where it was seen, or into the middle."""
        if self._robot is None:
            return
        left, upper, right, lower = thing.box.tolist() if thing else [_MIDDLE] * 4
        self._robot.look_at((left + right) / 2, (upper + lower) / 2)

    def say(self, text: str) -> None:
        """Nod with a yes and with a movement that begins; shake the head with a no and with a refusal."""
        if self._robot is None:
            return
        if _NODS.match(text):
            self._robot.nod()
        elif _SHAKES.match(text):
            self._robot.shake()

    def go_on(self) -> None:
        """Go on for one control period, 0.1 s."""
        if self._robot is not None:
            self._robot.express()
