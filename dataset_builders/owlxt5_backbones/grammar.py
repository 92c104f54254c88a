# SPDX-License-Identifier: Apache-2.0
"""English sentences about things on a table, and the same in German: our own words, our own grammar."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Literal, NamedTuple

import numpy as np

from lerobot_owlxt5.commands.pseudo_names import draw_name
from lerobot_owlxt5.commands.verbs import VERBS

from .rng import choice

Gender = Literal["m", "f", "n"]
Case = Literal["nominative", "accusative", "dative"]

DEFINITE: dict[Case, dict[Gender, tuple[str, str]]] = {
    "nominative": {"m": ("der", "e"), "f": ("die", "e"), "n": ("das", "e")},
    "accusative": {"m": ("den", "en"), "f": ("die", "e"), "n": ("das", "e")},
    "dative": {"m": ("dem", "en"), "f": ("der", "en"), "n": ("dem", "en")},
}
"""German article and ending of the adjective."""
INDEFINITE: dict[Case, dict[Gender, tuple[str, str]]] = {
    "nominative": {"m": ("ein", "er"), "f": ("eine", "e"), "n": ("ein", "es")},
    "accusative": {"m": ("einen", "en"), "f": ("eine", "e"), "n": ("ein", "es")},
    "dative": {"m": ("einem", "en"), "f": ("einer", "en"), "n": ("einem", "en")},
}

ADJECTIVES = {
    "red": "rot",
    "scarlet": "scharlachrot",
    "green": "grün",
    "harlequin": "hellgrün",
    "blue": "blau",
    "azure": "himmelblau",
    "cyan": "türkisfarben",
    "greenish blue": "blaugrün",
    "yellow": "gelb",
    "blonde": "blond",
    "violet": "violett",
    "purple": "purpurrot",
    "orange": "orangefarben",
    "pink": "rosafarben",
    "brown": "braun",
    "white": "weiß",
    "black": "schwarz",
    "grey": "grau",
    "silver": "silbern",
    "golden": "golden",
    "small": "klein",
    "big": "groß",
    "tiny": "winzig",
    "huge": "riesig",
    "heavy": "schwer",
    "light": "leicht",
    "round": "rund",
    "square": "eckig",
    "flat": "flach",
    "thick": "dick",
    "thin": "dünn",
    "soft": "weich",
    "hard": "hart",
    "shiny": "glänzend",
    "old": "alt",
    "new": "neu",
    "empty": "leer",
    "full": "voll",
    "clean": "sauber",
    "dirty": "schmutzig",
    "wet": "nass",
    "cold": "kalt",
    "warm": "warm",
    "striped": "gestreift",
    "beautiful": "schön",
    "strange": "seltsam",
    "broken": "kaputt",
    "wooden": "hölzern",
    "long": "lang",
}
"""English adjective and its German stem."""

COMPOUNDS = {
    "toy": "Spielzeug",
    "plastic": "Plastik",
    "paper": "Papier",
    "metal": "Metall",
    "rubber": "Gummi",
    "glass": "Glas",
    "stone": "Stein",
    "steel": "Stahl",
    "kitchen": "Küchen",
    "garden": "Garten",
    "office": "Büro",
    "travel": "Reise",
    "mini": "Mini",
    "model": "Modell",
}
"""First part of a compound noun in both languages."""

_SHARE_OF_COMPOUNDS, _SHARE_WITH_ADJECTIVE, _SHARE_INVENTED = 0.3, 0.45, 0.3


class Noun(NamedTuple):
    """A noun in both languages; an invented one is the same in both, and neuter."""

    english: str
    german: str
    gender: Gender


@cache
def nouns() -> tuple[Noun, ...]:
    """The nouns of nouns.txt."""
    text = files(__package__).joinpath("nouns.txt").read_text(encoding="utf-8")
    lines = [line.split("|") for line in text.splitlines() if line and not line.startswith("#")]
    return tuple(Noun(english, german, gender) for english, german, gender in lines)  # type: ignore[arg-type]


def compound(first: str, noun: Noun) -> Noun:
    """A noun such as `toy car`, in German one word."""
    return Noun(
        f"{first} {noun.english}", COMPOUNDS[first] + noun.german[0].lower() + noun.german[1:], noun.gender
    )


@dataclass(frozen=True)
class Thing:
    """What a sentence is about: a noun, with an adjective or without."""

    noun: Noun
    adjective: str | None = None

    @property
    def english(self) -> str:
        """Adjective and noun."""
        return f"{self.adjective} {self.noun.english}" if self.adjective else self.noun.english

    @property
    def english_a(self) -> str:
        """The same with the indefinite article."""
        return f"{'an' if self.english[0] in 'aeiou' else 'a'} {self.english}"

    def german(self, case: Case, *, definite: bool = True, none: bool = False) -> str:
        """Article, adjective and noun in a case; with `none` it is one that is not there (`kein`)."""
        article, ending = (DEFINITE if definite and not none else INDEFINITE)[case][self.noun.gender]
        words = [f"k{article}" if none else article]
        if self.adjective:
            words.append(ADJECTIVES[self.adjective] + ending)
        return " ".join([*words, self.noun.german])


class Verb(NamedTuple):
    """Something to do with a thing.

    Attributes:
        english: Command, and the same as past tense, with a place for the thing.
        past: See there.
        imperative: German verb that begins the command.
        rest: What the command ends with.
        infinitive: German verb after `Kannst du …`.
        participle: German verb after `Ich habe …`.
    """

    english: str
    past: str
    imperative: str
    rest: str
    infinitive: str
    participle: str


SIDES = {"to the left": "nach links", "to the right": "nach rechts", "forward": "nach vorn", "back": "zurück"}
"""Where things go."""

TRANSLATED_VERBS = (
    Verb(VERBS["push"].imperative, "pushed {}", "Schiebe", "weg", "wegschieben", "weggeschoben"),
    Verb("push {} away", "pushed {} away", "Schiebe", "weg", "wegschieben", "weggeschoben"),
    Verb(VERBS["pull"].imperative, "pulled {}", "Ziehe", "heran", "heranziehen", "herangezogen"),
    Verb("pull {} closer", "pulled {} closer", "Ziehe", "näher", "näher ziehen", "näher gezogen"),
    *(
        Verb(f"{verb} {{}} {side}", f"{past} {{}} {side}", german, dort, f"{dort} {does}", f"{dort} {did}")
        for verb, past, german, does, did in (
            ("slide", "slid", "Schiebe", "schieben", "geschoben"),
            ("push", "pushed", "Schiebe", "schieben", "geschoben"),
            ("move", "moved", "Bewege", "bewegen", "bewegt"),
        )
        for side, dort in SIDES.items()
    ),
    Verb("lift {}", "lifted {}", "Hebe", "hoch", "hochheben", "hochgehoben"),
    Verb("turn {} around", "turned {} around", "Drehe", "um", "umdrehen", "umgedreht"),
    Verb("put {} down", "put {} down", "Stelle", "ab", "abstellen", "abgestellt"),
    Verb("hold {}", "held {}", "Halte", "fest", "festhalten", "festgehalten"),
    Verb("touch {}", "touched {}", "Berühre", "", "berühren", "berührt"),
    Verb("find {}", "found {}", "Finde", "", "finden", "gefunden"),
    Verb("take {}", "took {}", "Nimm", "", "nehmen", "genommen"),
    Verb("describe {}", "described {}", "Beschreibe", "", "beschreiben", "beschrieben"),
    Verb("look at {}", "looked at {}", "Sieh", "an", "ansehen", "angesehen"),
    Verb("show me {}", "showed you {}", "Zeige mir", "", "mir zeigen", "dir gezeigt"),
    Verb("bring me {}", "brought you {}", "Bring mir", "", "mir bringen", "dir gebracht"),
)

PLACES = (
    ("next to", "neben"),
    ("behind", "hinter"),
    ("in front of", "vor"),
    ("to the left of", "links neben"),
    ("to the right of", "rechts neben"),
    ("under", "unter"),
    ("on", "auf"),
)
"""Prepositions; in German with the dative."""


def draw_thing(rng: np.random.Generator) -> Thing:
    """Draw a thing: often with an adjective, sometimes with an invented name."""
    if rng.random() < _SHARE_INVENTED:
        name = draw_name(rng)
        return Thing(Noun(name, name, "n"))
    noun = choice(rng, nouns())
    if rng.random() < _SHARE_OF_COMPOUNDS:
        noun = compound(choice(rng, tuple(COMPOUNDS)), noun)
    return Thing(noun, choice(rng, tuple(ADJECTIVES)) if rng.random() < _SHARE_WITH_ADJECTIVE else None)


type Draw = Callable[[np.random.Generator], Thing]


def draw_translation(rng: np.random.Generator, draw: Draw = draw_thing) -> tuple[str, str]:
    """Draw an English sentence and its German translation.

    Args:
        rng: Draws everything.
        draw: Draws each of the things, at most two, that the sentence is about.
    """
    return choice(rng, _SENTENCES)(rng, draw)


def _joined(*words: str) -> str:
    return " ".join(word for word in words if word)


def capital(text: str) -> str:
    """The text with a capital letter."""
    return text[0].upper() + text[1:]


def _command(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing, verb = draw(rng), choice(rng, TRANSLATED_VERBS)
    return (
        verb.english.format(f"the {thing.english}"),
        _joined(verb.imperative, thing.german("accusative"), verb.rest),
    )


def _polite_command(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing, verb = draw(rng), choice(rng, TRANSLATED_VERBS)
    command = verb.english.format(f"the {thing.english}")
    english = f"please {command}" if rng.random() < 0.5 else f"{command}, please"
    return english, _joined(verb.imperative, "bitte", thing.german("accusative"), verb.rest)


def _request(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing, verb = draw(rng), choice(rng, TRANSLATED_VERBS)
    asks = (("can you", "Kannst du"), ("could you", "Könntest du"), ("will you", "Wirst du"))
    english, german = choice(rng, asks)
    return (
        f"{english} {verb.english.format(f'the {thing.english}')}?",
        f"{german} {thing.german('accusative')} {verb.infinitive}?",
    )


def _report(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing, verb = draw(rng), choice(rng, TRANSLATED_VERBS)
    return (
        f"I {verb.past.format(f'the {thing.english}')}.",
        f"Ich habe {thing.german('accusative')} {verb.participle}.",
    )


def _unseen(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing = draw(rng)
    return f"I cannot see {thing.english_a}.", f"Ich kann {thing.german('accusative', none=True)} sehen."


def _where(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing = draw(rng)
    return f"where is the {thing.english}?", f"Wo ist {thing.german('nominative')}?"


def _property(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing, adjective = draw(rng), choice(rng, tuple(ADJECTIVES))
    german, property_ = thing.german("nominative"), ADJECTIVES[adjective]
    if rng.random() < 0.3:
        return f"is the {thing.english} {adjective}?", f"Ist {german} {property_}?"
    return f"the {thing.english} is {adjective}.", f"{capital(german)} ist {property_}."


def _place(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing, other = draw(rng), draw(rng)
    english, german = choice(rng, PLACES)
    subject = thing.german("nominative")
    return (
        f"the {thing.english} is {english} the {other.english}.",
        f"{capital(subject)} ist {german} {other.german('dative')}.",
    )


def _existence(rng: np.random.Generator, draw: Draw) -> tuple[str, str]:
    thing = draw(rng)
    return (
        f"there is {thing.english_a} on the table.",
        f"Auf dem Tisch ist {thing.german('nominative', definite=False)}.",
    )


_SENTENCES = (
    _command,
    _command,
    _command,
    _polite_command,
    _request,
    _report,
    _unseen,
    _where,
    _property,
    _place,
    _existence,
)
