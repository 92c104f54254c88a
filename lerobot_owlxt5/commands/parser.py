# SPDX-License-Identifier: Apache-2.0
"""Tasks of datasets, such as "push red" or "slide the mug to the right": which verb, which object.

A task is a verb and an object's name, with a direction before or behind the name. What a person says is not
read here: a language model understands that (`backbones/understanding.py`).
"""

import re
from collections.abc import Collection, Iterable
from dataclasses import dataclass

from .verbs import VERBS
from .vocabulary import (
    ARTICLES,
    CUBE_NAMES,
    DIRECTIONS,
    IN_NO_NAME,
    INFORMAL,
    LONGEST_PHRASE,
    NO_NAMES,
    UNFINISHED,
    VERB_PHRASES,
)


@dataclass(frozen=True)
class Command:
    """What a task asks for.

    Attributes:
        verb: One of `VERBS`, or None if the task has none of them, or not clearly one.
        object: The object's name as the task has it; the whole task if there is no verb.
    """

    verb: str | None
    object: str

    @property
    def canonical(self) -> str:
        """The command as CLANT writes it ("slide-to-left red"); the object alone if there is no verb."""
        colour = self.object.removesuffix(" cube")
        name = colour if object_name(colour) == self.object else self.object
        return f"{self.verb} {name}" if self.verb else name


def parse_command(text: str) -> Command:
    """Find verb and object in a task.

    "push red", "Push the red cube!", "move-sideways-to-left scarlet" and "slide the mug to your right" all
    have a verb. A text of another kind counts as one object phrase, so that any dataset's tasks can be used.
    """
    phrase, named = _cut(_words(text), VERB_PHRASES)
    if phrase and not IN_NO_NAME & {*_cut_directions(named)[0]}:
        named, directions = _cut_directions(named)
        name = plain(" ".join(named))
        meant = [verb for verb in VERB_PHRASES[phrase] if directions <= {verb}]
        if name and len(meant) == 1:
            return Command(meant[0], name)
    return Command(None, plain(text))


def formal_command(text: str) -> Command | None:
    """Read a command in CLANT's own form, such as "push red" or "slide-to-left ball"; None for other words.

    It is a verb of CLANT's and a bare name. "push mug later" and "push no mug" are more than that.
    """
    first, _, name = text.partition(" ")
    verb = next((verb.name for verb in VERBS.values() if first in (verb.name, verb.synonym)), None)
    words = name.split(" ")
    if (
        not verb
        or INFORMAL & {*words}
        or not all(re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", word) for word in words)
    ):
        return None
    return Command(verb, plain(name))


def name_problem(name: str) -> str:
    """Why an object had better not be called this: the command that would not be understood; or ""."""
    for verb in VERBS.values():
        for text in (f"{verb.name} {name}", verb.imperative.format(f"the {name}")):
            if parse_command(text) != Command(verb.name, plain(name)) or {*_words(name)} <= NO_NAMES:
                return f"the command {text!r} would not be understood"
    return ""


def named_objects(tasks: Iterable[str]) -> list[str]:
    """The objects that tasks name, each once, in the order of the tasks."""
    return list(dict.fromkeys(parse_command(task).object for task in tasks))


def _cut(words: list[str], phrases: Collection[str], end: bool = False) -> tuple[str, list[str]]:
    """Cut the longest of the phrases off the beginning, or the end; "" and all words if there is none."""
    for count in range(min(len(words), LONGEST_PHRASE), 0, -1):
        edge, rest = (words[-count:], words[:-count]) if end else (words[:count], words[count:])
        phrase = " ".join(edge)
        if phrase in phrases and not (end and UNFINISHED & {*rest[-1:]}):
            return phrase, rest
    return "", words


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
        words = rest


def _words(text: str) -> list[str]:
    """Lower-case words without hyphens and marks."""
    return re.findall(r"[\w']+", spoken(text).lower().replace("\u2019", "'"))


def spoken(text: str) -> str:
    """Write a text as it is said: the hyphens of CLANT's phrases become spaces."""
    return " ".join(text.replace("-", " ").split())


def plain(text: str) -> str:
    """Reduce a phrase to what counts in a comparison: lower case, no hyphens, punctuation or articles."""
    return " ".join(word for word in _words(text) if word not in ARTICLES)


def object_name(phrase: str) -> str:
    """Name an object in full: "red" is the red cube."""
    name = plain(phrase)
    return f"{name} cube" if name in CUBE_NAMES else name


def with_article(name: str) -> str:
    """Put "a" or "an" before a name, as it is spoken."""
    vowel = name[:1] in tuple("aeiou") and not name.startswith(("uni", "use", "eu", "one"))
    return f"{'an' if vowel or name.startswith('hour') else 'a'} {name}"
