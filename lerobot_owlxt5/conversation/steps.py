# SPDX-License-Identifier: Apache-2.0
"""What a robot can do next in a conversation, and what a planner knows when it decides that."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from ..backbones.understanding import Understood
from ..commands.answer import Action, Request, Target
from .lines import Line
from .questions import Question


@dataclass(frozen=True)
class Say:
    """Answer at once, and hold still.

    Attributes:
        text: The answer.
        asks: What is done if the answer is a question that gets an answer; None if it is no question.
    """

    text: str
    asks: "Open | None" = None


@dataclass(frozen=True)
class Ask:
    """Answer a question from what is seen, or from memory. A movement goes on."""

    question: Question


@dataclass(frozen=True)
class Do:
    """Move.

    Attributes:
        request: What is asked for.
        task: Its words, if the policy understands them as they are; "" where a person has agreed to it.
    """

    request: Request
    task: str = ""


@dataclass(frozen=True)
class Stop:
    """Hold still where the arms are."""


@dataclass(frozen=True)
class GoHome:
    """Move the arms where movements begin."""


@dataclass(frozen=True)
class Watch:
    """Watch how somebody moves the arms; hold still meanwhile."""


@dataclass(frozen=True)
class Describe:
    """Say what was shown."""


@dataclass(frozen=True)
class Imitate:
    """Do again what was shown."""


@dataclass(frozen=True)
class Teach:
    """Remember what a thing looks like.

    Attributes:
        name: What it is called from now on.
        subject: Which one it is; None: "this".
    """

    name: str
    subject: Target | None = None


@dataclass(frozen=True)
class Forget:
    """Forget a thing that was taught, by its name."""

    name: str


@dataclass(frozen=True)
class Translate:
    """Say a sentence in German."""

    sentence: str


@dataclass(frozen=True)
class Remark:
    """Say something, and go on with another step.

    Attributes:
        text: What to say.
        then: What to do; None: a movement goes on, and a question of the robot's waits on.
    """

    text: str
    then: "Step | None" = None


Step = Say | Ask | Do | Stop | GoHome | Watch | Describe | Imitate | Teach | Forget | Translate | Remark


@dataclass(frozen=True)
class Open:
    """What waits for an answer: a question of the robot's, or a movement that was stopped.

    Attributes:
        kind: "whether" to do it, "which" thing or "what" is meant, "how" to move it, or whether to carry it
            on once it was "stopped".
        request: What was asked for; its first action is the one that is not clear.
    """

    kind: str
    request: Request

    @property
    def action(self) -> Action:
        """The action that is not clear."""
        return self.request.actions[0]

    def completed(self, action: Action) -> Request:
        """The request with this action in place of the one that was not clear."""
        return Request((action, *self.request.actions[1:]))


@dataclass(frozen=True)
class Situation:
    """What a planner knows.

    Attributes:
        understand: What a sentence asks for.
        open: The robot's own question, if it waits for an answer.
        last: What was asked for last and understood; None before.
        seen: What the things are called that were seen at the last look, from left to right.
        before: What was said last, the oldest first, without the words to decide about.
        watching: Whether the robot watches how its arms are moved.
        taught: Names that somebody has taught it.
        respelt: What is seen and has nearly the name of a target that is not seen; None if nothing has.
    """

    understand: Callable[[str], Understood]
    open: Open | None = None
    last: Request | None = None
    seen: tuple[str, ...] = ()
    before: tuple[Line, ...] = ()
    watching: bool = False
    taught: tuple[str, ...] = ()
    respelt: Callable[[Target], Target | None] = lambda target: None


class Planner(Protocol):
    """Decides what a robot does when something is said."""

    def __call__(self, words: str, situation: Situation) -> Step:
        """What to do about some words."""
