# SPDX-License-Identifier: Apache-2.0
"""Commands such as "push the red cube": which verb, which object.

A command is an opening ("could you"), a verb, the object with a direction before or behind it, and an ending
("please"). All but the object stand in the tables of `vocabulary.py`; what is left is the object's name.
What does not fit is refused with a sentence that says why: our decision is never to guess a movement.
"""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from itertools import pairwise

from .verbs import VERBS
from .vocabulary import (
    ARTICLES,
    BEGINNINGS,
    COLOURS,
    DIRECTIONS,
    ENDINGS,
    GERUNDS,
    IN_NO_NAME,
    LONGEST_PHRASE,
    NEGATIONS,
    OPENINGS,
    PRONOUNS,
    SLIPS,
    UNFINISHED,
    VERB_PHRASES,
    VERB_WORDS,
)


@dataclass(frozen=True)
class Command:
    """What a text asks for.

    Attributes:
        verb: One of `VERBS`, or None if the text asks for none of them, or not clearly for one.
        object: The object's name as the text has it; the whole text if there is no verb.
        refusal: A sentence that says why there is no verb, or asks back; empty if there is one.
    """

    verb: str | None
    object: str
    refusal: str = ""

    @property
    def canonical(self) -> str:
        """The command as CLANT writes it ("slide-to-left red"); the object alone if there is no verb."""
        colour = self.object.removesuffix(" cube")
        name = colour if object_name(colour) == self.object else self.object
        return f"{self.verb} {name}" if self.verb else name

    @property
    def intention(self) -> str:
        """A sentence that says what is going to be done."""
        if self.verb is None:
            return "I will do it."
        return f"I will {VERBS[self.verb].imperative.format(f'the {object_name(self.object)}')}."


def parse_command(text: str) -> Command:
    """Find verb and object in a command.

    "push red", "Could you push the red cube, please?", "move-sideways-to-left scarlet" and "slide the mug to
    your right" are all understood. A text of another kind is refused, and counts as one object phrase, so
    that the tasks of any dataset can be used.
    """
    verb, found = _parse(_words(text))
    return Command(verb, found) if verb else Command(None, plain(text), refusal=found)


def name_problem(name: str) -> str:
    """Why an object had better not be called this: the command that would not be understood; or ""."""
    for verb in VERBS.values():
        for text in (f"{verb.name} {name}", verb.imperative.format(f"the {name}")):
            command = parse_command(text)
            if (command.verb, command.object) != (verb.name, plain(name)):
                return (
                    f"the command {text!r} would not be understood ({command.refusal or command.intention})"
                )
    return ""


def named_objects(tasks: Iterable[str]) -> list[str]:
    """The objects that tasks name, each once, in the order of the tasks."""
    return list(dict.fromkeys(parse_command(task).object for task in tasks))


def _parse(words: list[str]) -> tuple[str | None, str]:
    """Verb and the object's name, or None and a refusal."""
    words = _cut_all(_cut_all(words, OPENINGS), ENDINGS, end=True)
    if not words:
        return None, "What should I do?"
    if any(word in NEGATIONS or word.endswith("n't") for word in words):
        return None, "I hold still."

    gerund, behind = _cut(words, GERUNDS)
    phrase, named = _cut([GERUNDS[gerund], *behind] if gerund else words, VERB_PHRASES)
    named, directions = _cut_directions(_cut_all(named, {","}))
    if not phrase or IN_NO_NAME & {*named} or any(_begins_another(*pair) for pair in pairwise([*named, ""])):
        return None, f"I do not know how to {' '.join(words).replace(' ,', ',')}."

    name = "" if {*named} <= PRONOUNS else plain(" ".join(named))
    possible = {*VERB_PHRASES[phrase]}
    meant = [verb for verb in possible if directions <= {verb}]
    if len(meant) != 1:
        return None, _ask_which(meant or possible | directions, name)
    if not name:
        return None, f"What should I {VERBS[meant[0]].imperative.replace(' {}', '')}?"
    return meant[0], name


def _cut(words: list[str], phrases: Collection[str], end: bool = False) -> tuple[str, list[str]]:
    """Cut the longest of the phrases off the beginning, or the end; "" and all words if there is none."""
    for count in range(min(len(words), LONGEST_PHRASE), 0, -1):
        edge, rest = (words[-count:], words[:-count]) if end else (words[:count], words[count:])
        phrase = " ".join(SLIPS.get(word, word) for word in edge)
        if phrase in phrases and not (end and UNFINISHED & {*rest[-1:]}):
            return phrase, rest
    return "", words


def _cut_all(words: list[str], phrases: Collection[str], end: bool = False) -> list[str]:
    while (shorter := _cut(words, phrases, end)[1]) != words:
        words = shorter
    return words


def _cut_directions(words: list[str]) -> tuple[list[str], set[str]]:
    """Cut off what directions say: one before the object, and all behind it."""
    directions = set()
    direction, rest = _cut(words, DIRECTIONS)
    # "push back the cover", but "push back cover": a name may begin with such a word.
    if direction and (ARTICLES & {*rest[:1]} or IN_NO_NAME & {*direction.split()}):
        directions.add(DIRECTIONS[direction])
        words = rest
    while True:
        direction, rest = _cut(words, DIRECTIONS, end=True)
        if not direction:
            return words, directions
        directions.add(DIRECTIONS[direction])
        words = _cut_all(rest, ENDINGS, end=True)


def _begins_another(word: str, following: str) -> bool:
    """Whether another command or object begins here: "and pull", ", the can", "pull the"."""
    if word in ("and", ","):
        return not following or following in BEGINNINGS
    return word in VERB_WORDS and following in ARTICLES


def _ask_which(verbs: Collection[str], name: str) -> str:
    asked = [verb.imperative for name, verb in VERBS.items() if name in verbs]
    first = asked[0].format(f"the {object_name(name)}" if name else "it")
    *more, last = [first, *(question.format("it") for question in asked[1:])]
    return f"Should I {', '.join(more)} or {last}?"


def _words(text: str) -> list[str]:
    """Lower-case words without hyphens; each mark between clauses is a comma."""
    words: list[str] = re.findall(r"[\w']+|[,.;:!?]", spoken(text).lower().replace("\u2019", "'"))
    return ["," if word in ".;:!?" else word for word in words]


def spoken(text: str) -> str:
    """Write a text as it is said: the hyphens of CLANT's phrases become spaces."""
    return " ".join(text.replace("-", " ").split())


def plain(text: str) -> str:
    """Reduce a phrase to what counts in a comparison: lower case, no hyphens, punctuation or articles."""
    return " ".join(word for word in _words(text) if word != "," and word not in ARTICLES)


def object_name(phrase: str) -> str:
    """Name an object in full: "red" is the red cube."""
    name = plain(phrase)
    return f"{name} cube" if name in COLOURS else name


def with_article(name: str) -> str:
    """Put "a" or "an" before a name."""
    return f"{'an' if name[:1] in tuple('aeiou') else 'a'} {name}"
