# SPDX-License-Identifier: Apache-2.0
"""CLANT's four verbs, three slots, twelve actions and 120 arrangements."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import permutations

SLOTS: tuple[str, ...] = ("left", "middle", "right")
"""The places in front of the robot, from the robot's left to its right."""

EPISODE_STEPS = 90
"""Steps of an episode: CLANT's longest action has 85, then the objects have half a second to come to rest."""


@dataclass(frozen=True)
class Verb:
    """What can be done to an object: all that the world knows about a verb.

    Attributes:
        name: CLANT's canonical word, such as `slide-to-left`.
        synonym: CLANT's other word for it.
        direction: Unit vector (x, y) in which the object shall move: x forward, y to the robot's left.
        action_name: CLANT's name of its actions, with `{slot}` in place of the slot's letter.
    """

    name: str
    synonym: str
    direction: tuple[int, int]
    action_name: str


VERBS: tuple[Verb, ...] = (
    Verb("push", "move-up", (1, 0), "PUSH-{slot}"),
    Verb("pull", "move-down", (-1, 0), "PULL-{slot}"),
    Verb("slide-to-left", "move-sideways-to-left", (0, 1), "SLIDE-{slot}-L"),
    Verb("slide-to-right", "move-sideways-to-right", (0, -1), "SLIDE-{slot}-R"),
)
"""The verbs in CLANT's order. A new one needs a grip in `clant_claeo.expert.GRIPS`."""


@dataclass(frozen=True)
class Action:
    """A verb applied to the object on one slot.

    Attributes:
        slot: Index into `SLOTS` of the object to move.
        verb: What to do with it.
    """

    slot: int
    verb: Verb

    @property
    def name(self) -> str:
        """CLANT's name, such as `PUSH-L` or `SLIDE-M-R` (slot, then direction)."""
        return self.verb.action_name.format(slot=SLOTS[self.slot][0].upper())


ACTIONS: tuple[Action, ...] = tuple(Action(slot, verb) for slot in range(len(SLOTS)) for verb in VERBS)
"""The actions in CLANT's order; the position is the task id of the LeRobot environments."""


def find_action(name: str) -> Action:
    """The action with CLANT's name `name`.

    Raises:
        ValueError: If there is none, with the names that exist.
    """
    for action in ACTIONS:
        if action.name == name.strip().upper():
            return action
    raise ValueError(f"no action is called {name!r}; the twelve are {', '.join(a.name for a in ACTIONS)}")


def find_task(task: str, names: Mapping[str, str]) -> tuple[Verb, str]:
    """The verb and the object of a command in CLANT's words, such as `push red`.

    Args:
        task: A verb's name or synonym, and an object's name or synonym.
        names: Name of the object by name or synonym.

    Raises:
        ValueError: If it is no such command, with the words that exist.
    """
    word, _, name = task.partition(" ")
    for verb in VERBS:
        if word in (verb.name, verb.synonym) and name in names:
            return verb, names[name]
    raise ValueError(
        f"no task is called {task!r}; a task is one of {', '.join(verb.name for verb in VERBS)} and one of "
        f"{', '.join(dict.fromkeys(names.values()))}, such as 'push {next(iter(names))}'"
    )


def arrangements(names: tuple[str, ...]) -> list[tuple[str, str, str]]:
    """All ordered triples of distinct objects on the left, middle and right slot: 120 for six objects."""
    return list(permutations(names, 3))  # type: ignore[arg-type]  # permutations of length 3 are triples
