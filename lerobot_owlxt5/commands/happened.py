# SPDX-License-Identifier: Apache-2.0
"""What a robot saw happen after a movement, and how it says so: it claims no success that it did not see."""

from dataclasses import dataclass

from .parser import object_name, parse_command
from .replies import NOTHING_KNOWN, NOTHING_MOVED, listed, verb_phrase
from .verbs import VERBS


@dataclass(frozen=True)
class Change:
    """What is different after a movement.

    Attributes:
        way: Where the thing went that was meant, one of `WAYS`; empty if it stands where it stood; None if
            it is not seen any more.
        fell: Whether it lies now and stood before.
        others: Names of other things that are elsewhere now.
    """

    way: str | None
    fell: bool = False
    others: tuple[str, ...] = ()

    def report(self, verb: str, name: str) -> str:
        """Say what happened, in the past tense.

        Args:
            verb: What was to be done, one of `VERBS`.
            name: What the thing is called.
        """
        the_thing = f"the {object_name(name)}"
        if self.way == VERBS[verb].way:
            said = f"I {VERBS[verb].past.format(the_thing)}"
        else:
            what = {None: "I cannot see it any more", "": "it did not move"}.get(
                self.way, f"it moved {self.way}"
            )
            said = f"I tried to {verb_phrase(verb, the_thing)}, but {what}"
        also = [f"the {object_name(other)}" for other in self.others]
        more = ["and it fell over"] if self.fell else []
        more += [f"and {listed(also, 'and')} moved too"] if also else []
        return ", ".join([said, *more]) + "."


def retell(description: str) -> str:
    """Say what somebody else did, of what `describe` answered: "push mug" is "You pushed the mug."."""
    if description == NOTHING_MOVED:
        return "You moved nothing, as far as I saw."
    command = parse_command(description)
    if description == NOTHING_KNOWN or command.verb not in VERBS or not command.object:
        return "I cannot tell what you moved."
    return f"You {VERBS[command.verb].past.format(f'the {object_name(command.object)}')}."
