# SPDX-License-Identifier: Apache-2.0
"""What a policy says in place of a movement."""

from collections.abc import Sequence

from .answer import RELATIONS, Action, Target
from .parser import object_name
from .prompts import MAX_CHARACTERS
from .verbs import VERBS

TOO_LONG = f"I hold still, because a command may have at most {MAX_CHARACTERS} characters: say it in fewer."
TOO_FAR = "I hold still, because my arms are too far from where I learnt to begin: move them back there."
NO_OBJECTS_SEEN = "I hold still, because I see whole images and no objects: I know neither places nor names."
GOING_HOME = "I move my arms back first."
AT_HOME = "My arms are where movements begin."
MOVEMENT_OVER = "I am done, but I cannot tell what has moved."
NOTHING_ASKED = "What should I do?"

NOTHING_MOVED = "nothing moved"
"""What `describe` answers when there is nothing to describe."""
NOTHING_KNOWN = "I know none of the objects that I see."
"""What `describe` answers when none of the labels was in view."""

ABILITIES = "I can push or pull one thing, or slide it to the left or to the right."
HOLDS = {
    "forbidden": "I hold still.",
    "conditional": "I hold still, because I cannot wait for something to happen: ask me when it is time.",
    "not_now": "I hold still until you ask me again.",
    "not_an_action": "I hold still, because I heard nothing that I should do.",
    "beyond": f"I hold still, because I cannot do that. {ABILITIES}",
}
"""What is said where there is nothing to do, by its reason."""
REPLIES = {
    "ability": ABILITIES,
    "robot": "I look at the table, say what I see, and move one thing when you ask me to.",
}
"""Answers to questions that need no look."""

SIDES_IN_WORDS = {"left": "on the left", "right": "on the right", "middle": "in the middle"}
"""Where a thing is alone, as `referring.side_of` says it."""
RELATIONS_IN_WORDS = {kind: kind for kind in RELATIONS} | {"before": "in front of"}


def ask_back(action: Action) -> str:
    """Ask back for what was not said."""
    name = _name(action.target) if action.target != Target() else "it"
    if action.verb is None:
        first, *more = VERBS
        options = [verb_phrase(first, name), *(verb_phrase(verb, "it") for verb in more)]
        return f"Should I {listed(options, 'or')}?"
    return f"What should I {verb_phrase(action.verb, '')}?"


def listed(words: Sequence[str], conjunction: str) -> str:
    """Words in a row: "a cube, a ball and a can"; at least one."""
    *first, last = words
    return f"{', '.join(first)} {conjunction} {last}" if first else last


def ask_whether(action: Action, unknown: tuple[str, ...]) -> str:
    """Ask whether an action is what was meant.

    Args:
        action: What was probably meant.
        unknown: Words that nobody knows.
    """
    doubt = f"I do not know what {unknown[0]!r} means here." if unknown else "I am not sure what you mean."
    return f"{doubt} {did_you_mean(action)}"


def did_you_mean(action: Action) -> str:
    """Ask whether an action is what was meant, and nothing else."""
    return f"Did you mean: {in_words(action)}?"


def in_words(action: Action) -> str:
    """An action as somebody would ask for it: "push the left red cube"."""
    name = _name(action.target)
    return verb_phrase(action.verb, name) if action.verb else f"move {name}"


def verb_phrase(verb: str, name: str) -> str:
    """A verb of `VERBS` with a thing: "slide the ball to the left"."""
    return " ".join(VERBS[verb].imperative.format(name).split())


def _name(target: Target) -> str:
    if target.reference == "it":
        return "it"
    marks = [*([target.side] if target.side else []), *([target.order[0]] if target.order else [])]
    other = ["other"] if target.reference == "other" else []
    words = [*other, *marks, target.colour, target.name or "one"]
    return f"the {object_name(' '.join(word for word in words if word))}"
