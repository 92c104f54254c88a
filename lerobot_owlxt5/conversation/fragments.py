# SPDX-License-Identifier: Apache-2.0
"""Parts of a sentence that answer a question: "the left one", "to the right", "pull".

Each word must be known here. With one that is not, such as "not", the understanding says what is meant.
"""

from collections.abc import Sequence
from dataclasses import replace

from ..commands.answer import RANKS, Target, said_words
from ..commands.colours import basic_colour, split_colour
from ..commands.vocabulary import DIRECTIONS, VERB_PHRASES

_FILLERS = {"the", "a", "an", "one", "please", "bitte", "it", "on", "in", "at", "die", "der", "das", "den"}
_FILLERS |= {
    "i",
    "mean",
    "meant",
    "meine",
    "ich",
    "take",
    "nimm",
    "that",
    "this",
    "cube",
    "würfel",
    "es",
    "sie",
    "ihn",
}
SIDE_WORDS = {"left": "left", "leftmost": "left", "linke": "left", "linken": "left", "links": "left"}
SIDE_WORDS |= {
    "right": "right",
    "rightmost": "right",
    "rechte": "right",
    "rechten": "right",
    "rechts": "right",
}
SIDE_WORDS |= {
    "middle": "middle",
    "center": "middle",
    "centre": "middle",
    "mittlere": "middle",
    "mittleren": "middle",
}
SIDE_WORDS |= {"mitte": "middle", "near": "near", "nearest": "near", "closest": "near", "nächste": "near"}
SIDE_WORDS |= {"far": "far", "farthest": "far", "furthest": "far"}
_RANKS = {rank: rank for rank in RANKS} | {"zweite": "second", "zweiten": "second", "dritte": "third"}
_GERMAN = {
    "rot": "red",
    "grün": "green",
    "blau": "blue",
    "gelb": "yellow",
    "orange": "orange",
    "türkis": "cyan",
}
_GERMAN |= {
    "violett": "violet",
    "lila": "violet",
    "rosa": "pink",
    "braun": "brown",
    "weiß": "white",
    "schwarz": "black",
}
_GERMAN |= {"grau": "grey"}
_GERMAN_WAYS = {"nach links": "slide-to-left", "nach rechts": "slide-to-right", "weg": "push"}
_GERMAN_WAYS |= {"weg von dir": "push", "von dir weg": "push", "zu dir": "pull", "zu dir her": "pull"}
_COLOURS = {word + end: colour for word, colour in _GERMAN.items() for end in ("", "e", "en", "er", "es")}


def which(words: str, asked: Target, seen: Sequence[str]) -> Target | None:
    """The target that was asked about, with what was said of it now; None for words that say more.

    Args:
        words: The answer: marks such as "the left one", or the name of something that was seen.
        asked: What was asked for, and was not clear.
        seen: Names of what was seen.
    """
    said = said_words(words)
    if (name := " ".join(word for word in said if word not in _FILLERS)) in seen and name != asked.name:
        hue, kind = split_colour(name)
        return Target(name=kind or name, colour=hue if kind else "")
    target, marked = asked, False
    for word in said:
        if colour := colour_said(word):
            target, marked = replace(target, colour=colour), True
        elif word in SIDE_WORDS:
            target, marked = replace(target, side=SIDE_WORDS[word]), True
        elif word in _RANKS:
            target, marked = replace(target, order=(_RANKS[word], "left")), True
        elif word not in _FILLERS and word not in asked.name.split():
            return None
    return target if marked else None


def colour_said(word: str) -> str | None:
    """The one of `commands.colours.COLOURS` that an English or German word means; None for another word."""
    return basic_colour(word) or _COLOURS.get(word)


def how(words: str) -> str | None:
    """The verb that words stand for, such as "pull", "pull it" or "to the left"; None for others."""
    said = " ".join(word for word in said_words(words) if word not in ("it", "please", "them", "bitte"))
    verbs = VERB_PHRASES.get(said, ())
    if len(verbs) == 1:
        return verbs[0]
    verb, _, direction = said.partition(" ")
    if verb in VERB_PHRASES and DIRECTIONS.get(direction) in VERB_PHRASES[verb]:
        return DIRECTIONS[direction]
    return DIRECTIONS.get(said) or _GERMAN_WAYS.get(said)
