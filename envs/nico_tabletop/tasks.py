# SPDX-License-Identifier: Apache-2.0
"""CLANT's twelve actions, three slots and 120 arrangements."""

from dataclasses import dataclass
from itertools import permutations

SLOTS: tuple[str, ...] = ("left", "middle", "right")
"""The places in front of the robot, from the robot's left to its right."""

_SYNONYMS = {
    "push": "move-up",
    "pull": "move-down",
    "slide-to-left": "move-sideways-to-left",
    "slide-to-right": "move-sideways-to-right",
}
_DIRECTIONS = {"push": (1, 0), "pull": (-1, 0), "slide-to-left": (0, 1), "slide-to-right": (0, -1)}


@dataclass(frozen=True)
class Action:
    """One of CLANT's twelve actions.

    Attributes:
        name: CLANT's name, such as `PUSH-L` or `SLIDE-M-R` (slot, then direction).
        slot: Index into `SLOTS` of the object to move.
        verb: CLANT's canonical verb: `push`, `pull`, `slide-to-left`, `slide-to-right`.
    """

    name: str
    slot: int
    verb: str

    @property
    def verbs(self) -> tuple[str, str]:
        """The canonical verb and CLANT's synonym for it."""
        return self.verb, _SYNONYMS[self.verb]

    @property
    def direction(self) -> tuple[int, int]:
        """Unit vector (x, y) in which the object shall move: x forward, y to the robot's left."""
        return _DIRECTIONS[self.verb]


def _action(name: str) -> Action:
    kind, slot, *side = name.split("-")
    verb = f"slide-to-{'left' if side == ['L'] else 'right'}" if kind == "SLIDE" else kind.lower()
    return Action(name, "LMR".index(slot), verb)


ACTIONS: tuple[Action, ...] = tuple(
    _action(f"{kind}-{slot}{side}")
    for slot in "LMR"
    for kind, side in (("PUSH", ""), ("PULL", ""), ("SLIDE", "-L"), ("SLIDE", "-R"))
)
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


def arrangements(names: tuple[str, ...]) -> list[tuple[str, str, str]]:
    """All ordered triples of distinct objects on the left, middle and right slot: 120 for six objects."""
    return list(permutations(names, 3))  # type: ignore[arg-type]  # permutations of length 3 are triples
