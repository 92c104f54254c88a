# SPDX-License-Identifier: Apache-2.0
"""The scripted source's sentences to translate: about the objects on the table, from our own grammar."""

from collections.abc import Sequence

import numpy as np

from owlxt5_backbones.grammar import (
    ADJECTIVES,
    COMPOUNDS,
    Noun,
    Thing,
    capital,
    compound,
    draw_translation,
    nouns,
)


def named_thing(name: str) -> Thing:
    """What the grammar knows by an object's name: a colour alone is a cube's.

    A name that it does not know is the same in German, and neuter.
    """
    known = {noun.english: noun for noun in nouns()}
    if name in ADJECTIVES:
        return Thing(known["cube"], name)
    if name in known:
        return Thing(known[name])
    first, _, rest = name.partition(" ")
    if rest in known and first in ADJECTIVES:
        return Thing(known[rest], first)
    if rest in known and first in COMPOUNDS:
        return Thing(compound(first, known[rest]))
    return Thing(Noun(name, name, "n"))


def sentence_about(names: Sequence[str], rng: np.random.Generator) -> tuple[str, str]:
    """Draw an English sentence about objects, and the same in German.

    Args:
        names: At least two objects.
        rng: Draws the sentence, and which of the objects it is about.
    """
    things = iter(rng.permutation(len(names)))
    english, german = draw_translation(rng, lambda _: named_thing(names[next(things)]))
    return capital(english), german
