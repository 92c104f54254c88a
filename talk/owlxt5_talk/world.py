# SPDX-License-Identifier: Apache-2.0
"""One simulated robot with somebody to talk to it, and what a page shows of both."""

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from lerobot.robots import Robot
from PIL import Image

from lerobot_owlxt5.conversation import Line
from lerobot_owlxt5.scene import Thing
from nico_tabletop.config_nico_sim import NicoSimConfig
from nico_tabletop.nico_sim import NicoSim
from nico_tabletop.objects import SHIPPED
from nico_tabletop.placement import PLACEMENTS
from nico_tabletop.robot import EYES
from nico_tabletop.scene import SPECTATOR

from .guided import draw_movement

HEIGHT, WIDTH = 360, 480
"""Of both pictures: the robot itself sees less, and a person more."""
SHOWN_LINES = 100
"""So many lines of a conversation are shown, the last ones."""

WATCH, DONE = "watch me", "done"
"""What somebody says who shows a movement."""

_JPEG_QUALITY = 85
_STILL = 1e-3  # radians, metres or degrees of the head: what moved less is a pixel away at most


@dataclass(frozen=True)
class Table:
    """What a visitor has chosen to stand on the table.

    Attributes:
        objects: One of `SHIPPED`.
        placement: One of `PLACEMENTS`.
    """

    objects: str = "claeo"
    placement: str = "slots"

    def __post_init__(self) -> None:
        """Check what may come from anybody's browser.

        Raises:
            ValueError: If there is no such set or placement; a file's name is none.
        """
        for chosen, known in ((self.objects, SHIPPED), (self.placement, tuple(PLACEMENTS))):
            if chosen not in known:
                raise ValueError(f"{chosen[:50]!r} is none of {', '.join(known)}")


class TalkingRobot(Protocol):
    """What a page needs of `lerobot_owlxt5.conversation.Conversation`."""

    lines: list[Line]
    looking_at: Thing | None

    @property
    def busy(self) -> bool:
        """Whether a movement is going on, or is about to begin."""

    @property
    def watching(self) -> bool:
        """Whether it watches how its arms are moved."""

    @property
    def things(self) -> list[Thing]:
        """What was seen at the last look."""

    def hear(self, words: str) -> None:
        """Take a sentence in."""

    def point(self, x: float, y: float) -> None:
        """Look where somebody points."""

    def tick(self) -> None:
        """Do what is to be done in one control period."""

    def stop(self) -> None:
        """Hold still at once."""

    def home(self) -> None:
        """Move the arms back."""


Converse = Callable[[Robot], TalkingRobot]
"""Makes a conversation with a connected robot."""


@dataclass(frozen=True)
class Seen:
    """A thing in the eyes' picture.

    Attributes:
        name: What it is called.
        box: Left, upper, right and lower edge, as shares of the picture.
    """

    name: str
    box: tuple[float, float, float, float]

    def covers(self, other: "Seen") -> bool:
        """Whether the other's middle lies in this one's box: both are of one thing."""
        left, upper, right, lower = other.box
        x, y = (left + right) / 2, (upper + lower) / 2
        return self.box[0] <= x <= self.box[2] and self.box[1] <= y <= self.box[3]


@dataclass(frozen=True)
class View:
    """What a page shows of a world; it never changes.

    Attributes:
        eyes: JPEG, what is between NICO's eyes; empty before the first.
        bystander: JPEG, the same from outside, one or two control periods ago; empty before the first.
        lines: Who said what, (speaker, text), the last `SHOWN_LINES`.
        things: What the robot sees.
        looking_at: What it is about to move, or moves.
        busy: Whether it moves, or is moved.
        table: What stands there.
        failed: Whether something broke that nobody at the page can mend, but by a new scene.
    """

    eyes: bytes = b""
    bystander: bytes = b""
    lines: tuple[tuple[str, str], ...] = ()
    things: tuple[Seen, ...] = ()
    looking_at: Seen | None = None
    busy: bool = False
    table: Table = field(default_factory=Table)
    failed: bool = False


class World:
    """A table, a robot and a conversation with it.

    Args:
        converse: Makes the conversation.
        table: What stands on the table at first.
        seed: Of the scenes that are drawn.
    """

    def __init__(self, converse: Converse, table: Table, seed: int) -> None:
        self._converse, self._random = converse, np.random.default_rng(seed)
        self._robot: NicoSim | None = None
        self.table = table
        self.lay(table)

    def lay(self, table: Table) -> None:
        """Lay the table anew and begin a conversation; what was spoken of stands there no more."""
        if self._robot is None or table != self.table:
            self.close()
            seed = int(self._random.integers(2**31))
            self._robot = NicoSim(NicoSimConfig(objects=table.objects, placement=table.placement, seed=seed))
            self._robot.connect()
        else:
            self._robot.reset()
        self.table = table
        self.conversation = self._converse(self._robot)
        self._pictures = {camera: (b"", np.empty(0)) for camera in (EYES, SPECTATOR)}
        self._draws_bystander = True
        self._things: tuple[Seen, ...] = ()
        self._shows, self._guided = False, list[np.ndarray]()

    def hear(self, words: str) -> None:
        """Hear what somebody says; a movement that was to be shown is shown no more."""
        self._shows = False
        self.conversation.hear(words)

    def stop(self) -> None:
        """Hold still at once, also where somebody was about to show a movement."""
        self._shows = False
        self.conversation.stop()

    def home(self) -> None:
        """Move the arms where movements begin, and no more."""
        self._shows = False
        self.conversation.home()

    def show(self) -> None:
        """Let somebody move the arms, and the robot watch, as soon as the arms are home."""
        self.conversation.home()
        self._shows = True

    def tick(self) -> None:
        """Go on for one control period."""
        assert self._robot is not None
        conversation = self.conversation
        if self._shows and not conversation.busy:
            self._shows = False
            conversation.hear(WATCH)
            self._guided = draw_movement(self._robot, self._random)
        if not conversation.watching:
            self._guided = []
        is_moved = bool(self._guided)
        if is_moved:
            pose = self._guided.pop(0).tolist()
            self._robot.send_action(dict(zip(self._robot.action_features, pose, strict=True)))
        conversation.tick()
        if is_moved and not self._guided and conversation.watching:
            conversation.hear(DONE)

    def view(self) -> View:
        """What is to be seen now; what NICO sees is drawn if something has moved."""
        self._draw(EYES)
        conversation = self.conversation
        if not conversation.busy:  # a detector's look at all there is would hold a movement up
            self._things = tuple(map(_seen, conversation.things))
        target = _seen(conversation.looking_at) if conversation.looking_at else None
        if target and not conversation.busy:  # it may have been moved since
            target = next(filter(target.covers, self._things), None)
        (eyes, _), (bystander, _) = self._pictures.values()
        return View(
            eyes,
            bystander,
            lines=tuple((line.speaker, line.text) for line in conversation.lines[-SHOWN_LINES:]),
            things=self._things,
            looking_at=target,
            busy=conversation.busy or bool(self._guided),
            table=self.table,
        )

    def draw_bystander(self) -> None:
        """Draw what the next view shows from outside, every other time, if something has moved.

        It comes after a view: then NICO's pictures, of which there are twice as many, come evenly.
        """
        if self._draws_bystander:
            self._draw(SPECTATOR)
        self._draws_bystander = not self._draws_bystander

    def _draw(self, camera: str) -> None:
        assert self._robot is not None
        simulation = self._robot.simulation
        now = simulation.data.qpos
        if camera != EYES:  # they do not see the head
            now = np.concatenate([now, simulation.head_deg])
        _, drawn = self._pictures[camera]
        if len(drawn) and np.abs(now - drawn).max() <= _STILL:
            return
        file = io.BytesIO()
        image = simulation.render(camera, HEIGHT, WIDTH)
        Image.fromarray(image).save(file, "JPEG", quality=_JPEG_QUALITY)
        self._pictures[camera] = file.getvalue(), now.copy()

    def close(self) -> None:
        """Free the world and what draws it."""
        if self._robot is not None:
            self._robot.disconnect()
            self._robot = None


def _seen(thing: Thing) -> Seen:
    left, upper, right, lower = (float(edge) for edge in thing.box)
    return Seen(thing.name, (left, upper, right, lower))
