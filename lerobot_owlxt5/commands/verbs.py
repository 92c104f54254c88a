# SPDX-License-Identifier: Apache-2.0
"""The verbs that a policy carries out, one record each.

The parser and `owlxt5-evaluate --robustness` derive their words from here. The world has a record of its own
for each verb (`nico_tabletop.tasks`), because neither package knows the other. A test checks that they agree.
"""

from dataclasses import dataclass

WAYS = AWAY, CLOSER, LEFT, RIGHT = "away from me", "closer to me", "to the left", "to the right"
"""Where a thing may go, as the robot sees it."""


@dataclass(frozen=True)
class Verb:
    """A verb, and the words that people use for it.

    Attributes:
        name: CLANT's canonical verb.
        synonym: CLANT's other word for it.
        imperative: How it is asked about and announced, with a place for the object.
        past: The same when it is done.
        way: Where the object has gone then, one of `WAYS`.
        phrases: What may stand for it. A phrase that several verbs have leaves the choice to a direction.
        directions: What says the direction, before or behind the object.
        unseen: Phrases that no dataset has, with a place for the object, for `owlxt5-evaluate --robustness`.
    """

    name: str
    synonym: str
    imperative: str
    past: str
    way: str
    phrases: tuple[str, ...]
    directions: tuple[str, ...]
    unseen: tuple[str, ...]


_ANY = ("move", "shift", "nudge")
_SIDEWAYS = ("slide", "glide", "sweep", "move sideways", *_ANY)


def _slide(side: str) -> Verb:
    # "You" is the robot. It does not know where "I" am, so "to my left" is no direction.
    towards = ("", "to ", "to the ", "to your ", "towards the ", "towards your ")
    return Verb(
        name=f"slide-to-{side}",
        synonym=f"move-sideways-to-{side}",
        imperative=f"slide {{}} to the {side}",
        past=f"slid {{}} to the {side}",
        way={"left": LEFT, "right": RIGHT}[side],
        phrases=(f"slide to {side}", f"move sideways to {side}", *_SIDEWAYS),
        directions=(
            *(f"{words}{side}" for words in towards),
            *(f"{side}ward", f"{side}wards", f"to the {side} side", f"to your {side} side"),
            *(f"to the {side} hand side", f"to your {side} hand side"),
        ),
        unseen=(
            f"shift the {{}} to the {side}",
            f"nudge the {{}} {side}wards",
            f"glide the {{}} to the {side}",
        ),
    )


VERBS: dict[str, Verb] = {
    verb.name: verb
    for verb in (
        Verb(
            name="push",
            synonym="move-up",
            imperative="push {}",
            past="pushed {}",
            way=AWAY,
            phrases=("push", "shove", "thrust", "move up", "move forward", "move away", *_ANY),
            directions=(
                *("up", "upward", "upwards", "forward", "forwards", "ahead"),
                *("away", "away from you", "away from yourself"),
            ),
            unseen=("shove the {}", "thrust the {}", "nudge the {} forward"),
        ),
        Verb(
            name="pull",
            synonym="move-down",
            imperative="pull {}",
            past="pulled {}",
            way=CLOSER,
            phrases=("pull", "drag", "tug", "draw", "move down", *_ANY),
            directions=(
                *("down", "downward", "downwards", "back", "backward", "backwards", "closer", "nearer"),
                *("closer to you", "nearer to you", "to you", "back to you", "toward you", "towards you"),
                *("back towards you", "towards yourself"),
            ),
            unseen=("drag the {}", "tug the {}", "draw the {} closer"),
        ),
        _slide("left"),
        _slide("right"),
    )
}
"""By canonical name, in CLANT's order."""

_OPPOSITES = {AWAY: CLOSER, CLOSER: AWAY, LEFT: RIGHT, RIGHT: LEFT}


def opposite(verb: str) -> str:
    """The verb of `VERBS` that moves a thing back again."""
    way = _OPPOSITES[VERBS[verb].way]
    return next(name for name, other in VERBS.items() if other.way == way)
