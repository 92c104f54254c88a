# SPDX-License-Identifier: Apache-2.0
"""What is said to the robot in an episode, and what is right to do then (protocol CLAEO-Plus)."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from .frames import PARAPHRASES, PLAIN, PUNCTUATION, SYNONYMS
from .objects import TabletopObject
from .tasks import SLOTS, Action

CANONICAL, COUNTERFACTUAL, ABSENT = "canonical", "counterfactual", "absent"

WORDS: dict[str, str] = {
    CANONICAL: "CLANT's words",
    "synonyms": "another verb and the object's second name",
    **{kind: "a paraphrase" for kind in PARAPHRASES},
    "typos": "a typing error in a plain command",
    "punctuation": "a plain command in other letters and signs",
    COUNTERFACTUAL: "CLANT's words, which name another object of the same scene",
    ABSENT: "CLANT's words, which name an object that is not on the table",
}
"""Kinds of words, and what each is."""

# Without a letter, a shorter word leaves nothing to recognise.
_SHORTEST = 4


@dataclass(frozen=True)
class Command:
    """What is said, and what it asks for.

    Attributes:
        text: The sentence.
        action: What is right to do; None: nothing, since the named object is not there.
    """

    text: str
    action: Action | None


def check_words(kind: str, objects: int, on_table: int) -> None:
    """Check that there are such words for a set of objects.

    Args:
        kind: One of `WORDS`.
        objects: How many the set has.
        on_table: How many of them stand on the table.

    Raises:
        ValueError: If there is no such kind, or no object is left to be absent.
    """
    if kind not in WORDS:
        raise ValueError(f"words must be one of {', '.join(WORDS)}; got {kind!r}")
    if kind == ABSENT and objects <= on_table:
        raise ValueError(
            f"words=absent names an object that is not on the table, but all {objects} objects of the set "
            "stand on it: choose a larger set or fewer distractors"
        )


def canonical(action: Action, name: str) -> Command:
    """The command in CLANT's words, such as `push red`."""
    return Command(f"{action.verb.name} {name}", action)


def draw_command(
    kind: str,
    action: Action,
    objects: Mapping[str, TabletopObject],
    arrangement: Sequence[str],
    distractors: Sequence[str],
    random: np.random.Generator,
) -> Command:
    """Draw a command about a scene.

    Args:
        kind: One of `WORDS`, see `check_words`.
        action: What is asked for; `counterfactual` has its verb, and asks for another object.
        objects: The set, by name.
        arrangement: What stands on the left, in the middle and on the right.
        distractors: What else is on the table.
        random: Draws sentence and object; the same state draws the same command.
    """
    item = objects[arrangement[action.slot]]
    if kind == CANONICAL:
        return canonical(action, item.name)
    if kind == COUNTERFACTUAL:
        slot = int(random.choice([slot for slot in range(len(SLOTS)) if slot != action.slot]))
        return canonical(Action(slot, action.verb), arrangement[slot])
    if kind == ABSENT:
        missing = [name for name in objects if name not in (*arrangement, *distractors)]
        return Command(canonical(action, str(random.choice(missing))).text, None)
    verb = action.verb.name
    if kind == "typos":
        return Command(misspell(PLAIN[verb].format(item.phrase()), random), action)
    if kind == "punctuation":
        return Command(punctuate(PLAIN[verb].format(item.phrase()), random), action)
    if kind == "synonyms":
        phrase = item.phrase(str(random.choice(item.synonyms)))
        return Command(str(random.choice(SYNONYMS[verb])).format(phrase), action)
    return Command(str(random.choice(PARAPHRASES[kind][verb])).format(item.phrase()), action)


def punctuate(text: str, random: np.random.Generator) -> str:
    """Write a plain command in other letters, or with other signs and spaces around it."""
    written = str(random.choice(PUNCTUATION))
    return written.format(plain=text, upper=text.upper(), capital=text.capitalize(), title=text.title())


def misspell(text: str, random: np.random.Generator) -> str:
    """Make one typing error: a letter is missing, is doubled, or has changed places with the next.

    It is in a word of four letters or more, or of three where it leaves none out. "the" and the first letter
    of a word stay right, so that hardly any error makes another word of it (our decision).
    """
    places = [found for found in re.finditer(r"\w{3,}", text) if found.group() != "the"]
    place = places[random.integers(len(places))]
    return text[: place.start()] + str(random.choice(_errors(place.group()))) + text[place.end() :]


def _errors(word: str) -> list[str]:
    """All words that one typing error makes of this one."""
    letters = range(1, len(word))
    doubled = [word[:at] + word[at] + word[at:] for at in letters]
    swapped = [word[:at] + word[at + 1] + word[at] + word[at + 2 :] for at in letters[:-1]]
    dropped = [word[:at] + word[at + 1 :] for at in letters if len(word) >= _SHORTEST]
    return [error for error in dict.fromkeys([*doubled, *swapped, *dropped]) if error != word]
