# SPDX-License-Identifier: Apache-2.0
"""The formal answer: what a sentence asks for, as data and as a short text that a small T5 can write.

    push cube, in red, left; pull, it               do this, then that
    slide to left object, second from right         which of several is meant
    push ball, behind can, in blue                  a relation to a landmark
    move ball                                       which verb was not said clearly: to be asked back
    question scene
    hold forbidden

Names and colours are words of the sentence, in lower case. All other words belong to the form.
"""

import re
import unicodedata
from dataclasses import dataclass

from .parser import spoken
from .verbs import VERBS

SIDES = ("left", "right", "middle", "near", "far")
"""Where the target is among those that fit, as the robot sees them."""
REFERENCES = ("it", "other")
"""What was spoken of before, or another than that."""
RELATIONS = ("left of", "right of", "behind", "before", "next to", "between")
"""How the target stands to a landmark, as the robot sees them: `before` is nearer to the robot."""
RANKS = ("second", "third", "fourth")
"""Places in a row, counted from a side; the first is a side."""
COUNTED_FROM = ("left", "right")
REASONS = ("forbidden", "conditional", "not_now", "not_an_action", "beyond")
"""Why to hold still: it must not, only if, later, nothing was asked for, or it cannot do that."""
QUESTIONS = ("ability", "scene", "robot")
"""What a question is about."""

MOST_ACTIONS, MOST_NAME_WORDS, MOST_COLOUR_WORDS = 3, 5, 2
ANY_VERB = "move"
"""Stands for a verb that was not said clearly."""
VERB_TEXTS = {spoken(verb): verb for verb in VERBS} | {ANY_VERB: None}


def _phrase(colour: str, name: str) -> str:
    return f"{colour} {name}".strip()


@dataclass(frozen=True)
class Landmark:
    """A thing beside which the target stands.

    Attributes:
        name: As said, or empty.
        colour: As said, or empty. One of the two is there.
    """

    name: str = ""
    colour: str = ""

    @property
    def phrase(self) -> str:
        """Colour and name, as said."""
        return _phrase(self.colour, self.name)


@dataclass(frozen=True)
class Relation:
    """How the target stands to other things.

    Attributes:
        kind: One of `RELATIONS`.
        landmarks: Two for `between`, else one.
    """

    kind: str
    landmarks: tuple[Landmark, ...]


@dataclass(frozen=True)
class Target:
    """What tells a thing from others.

    Attributes:
        name: As said, or empty.
        colour: As said, or empty.
        reference: One of `REFERENCES`, or empty.
        side: One of `SIDES`, or empty.
        order: One of `RANKS` and one of `COUNTED_FROM`, or None.
        relation: To landmarks, or None.
    """

    name: str = ""
    colour: str = ""
    reference: str = ""
    side: str = ""
    order: tuple[str, str] | None = None
    relation: Relation | None = None

    @property
    def phrase(self) -> str:
        """Colour and name, as said."""
        return _phrase(self.colour, self.name)


@dataclass(frozen=True)
class Action:
    """One thing to do.

    Attributes:
        verb: One of `VERBS`, or None if it was not said clearly.
        target: What to do it to; `Target()` if it was not said clearly.
    """

    verb: str | None
    target: Target

    @property
    def clear(self) -> bool:
        """Whether verb and target were said; else the robot asks back."""
        return self.verb is not None and self.target != Target()


@dataclass(frozen=True)
class Request:
    """What to do, in this order."""

    actions: tuple[Action, ...]

    @property
    def clear(self) -> bool:
        """Whether nothing has to be asked back."""
        return all(action.clear for action in self.actions)


@dataclass(frozen=True)
class Question:
    """A question about one of `QUESTIONS`."""

    kind: str


@dataclass(frozen=True)
class Hold:
    """Nothing to do, for one of `REASONS`."""

    reason: str


Answer = Request | Question | Hold


def heard(sentence: str) -> str:
    """A sentence as the language model hears it: lower case, without hyphens and control characters."""
    text = unicodedata.normalize("NFC", sentence).lower().replace("\u2019", "'")
    return spoken("".join(letter if letter.isprintable() else " " for letter in text))


def said_words(sentence: str) -> tuple[str, ...]:
    """The words of a sentence, without punctuation: all that a name may consist of."""
    return tuple(re.findall(_WORD, heard(sentence)))


def left_over(words: tuple[str, ...], answer: Answer) -> tuple[str, ...]:
    """The words of a sentence that its answer does not have."""
    own = {*said_words(format_answer(answer))}
    return tuple(word for word in words if word not in own)


def format_answer(answer: Answer) -> str:
    """Write an answer as text; the inverse of `parse_answer`."""
    match answer:
        case Hold(reason):
            return f"hold {reason.replace('_', ' ')}"
        case Question(kind):
            return f"question {kind}"
        case Request(actions):
            return "; ".join(_format_action(action) for action in actions)


def parse_answer(text: str) -> Answer:
    """Read an answer.

    Raises:
        ValueError: If the text has another form.
    """
    first, _, kind = text.partition(" ")
    kind = kind.replace(" ", "_")
    if first == "hold" and kind in REASONS:
        return Hold(kind)
    if first == "question" and kind in QUESTIONS:
        return Question(kind)
    actions = text.split("; ")
    if len(actions) > MOST_ACTIONS:
        raise ValueError(f"{text!r} has more than {MOST_ACTIONS} actions.")
    return Request(tuple(_parse_action(action) for action in actions))


def _format_action(action: Action) -> str:
    verb, target = ANY_VERB if action.verb is None else spoken(action.verb), action.target
    parts = [f"{verb} {target.name}".strip()]
    if target.colour:
        parts.append(f"in {target.colour}")
    parts += [part for part in (target.reference, target.side) if part]
    if target.order:
        parts.append(" from ".join(target.order))
    if target.relation:
        first, *more = target.relation.landmarks
        parts += _landmark_parts(target.relation.kind, first)
        parts += [part for landmark in more for part in _landmark_parts("and", landmark)]
    return ", ".join(parts)


def _landmark_parts(how: str, landmark: Landmark) -> list[str]:
    named = f"{how} {landmark.name}".strip()
    return [named, f"in {landmark.colour}"] if landmark.colour else [named]


# A letter or digit, and what follows it up to the word's end.
_WORD = r"[^\W_]+(?:'[^\W_]+)*"


def _words(group: str, fewest: int, most: int) -> str:
    return rf"(?P<{group}>(?: {_WORD}){{{fewest},{most}}})"


def _colour(group: str) -> str:
    return rf"(?:, in{_words(group, 1, MOST_COLOUR_WORDS)})?"


_ACTION = re.compile(
    rf"(?P<verb>{'|'.join(VERB_TEXTS)}){_words('name', 0, MOST_NAME_WORDS)}{_colour('colour')}"
    rf"(?:, (?P<reference>{'|'.join(REFERENCES)}))?"
    rf"(?:, (?P<side>{'|'.join(SIDES)}))?"
    rf"(?:, (?P<rank>{'|'.join(RANKS)}) from (?P<counted>{'|'.join(COUNTED_FROM)}))?"
    rf"(?:, (?P<relation>{'|'.join(RELATIONS)}){_words('name1', 0, MOST_NAME_WORDS)}{_colour('colour1')}"
    rf"(?P<second>, and{_words('name2', 0, MOST_NAME_WORDS)}{_colour('colour2')})?)?"
)


def _parse_action(text: str) -> Action:
    found = _ACTION.fullmatch(text)
    if not found or text != text.lower():
        raise ValueError(f"{text!r} is no action.")
    group = {name: (value or "").strip() for name, value in found.groupdict().items()}
    relation = None
    if group["relation"]:
        landmarks = [Landmark(group["name1"], group["colour1"])]
        if group["second"]:
            landmarks.append(Landmark(group["name2"], group["colour2"]))
        if Landmark() in landmarks or (len(landmarks) == 2) != (group["relation"] == "between"):
            raise ValueError(f"{text!r} does not name its landmarks.")
        relation = Relation(group["relation"], tuple(landmarks))
    order = (group["rank"], group["counted"]) if group["rank"] else None
    target = Target(group["name"], group["colour"], group["reference"], group["side"], order, relation)
    return Action(VERB_TEXTS[group["verb"]], target)
