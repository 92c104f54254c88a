# SPDX-License-Identifier: Apache-2.0
"""When a robot may act on what its language model understood, and when it has to ask back."""

from collections import Counter
from collections.abc import Iterator
from itertools import islice

import numpy as np

from lerobot_owlxt5.backbones.understanding import Understanding
from lerobot_owlxt5.commands.answer import Request, left_over, said_words

from .understanding_lessons import draw_understood

_LESSONS = 1000
_ASKED_BACK = 0.015
_WISHES, _SEEN = 120_000, 3


def find_understanding_threshold(name: str, seed: int) -> float:
    """The confidence that all but `_ASKED_BACK` of the clear wishes reach that are understood rightly.

    Args:
        name: Folder of a T5 that has learnt to understand.
        seed: Of the lessons; training draws others.
    """
    understand, confidences = Understanding(name), list[float]()
    for sentence, answer in _clear_wishes(np.random.default_rng((seed, _LESSONS))):
        understood = understand(sentence)
        if understood.answer == answer:
            confidences.append(understood.confidence)
        if len(confidences) == _LESSONS:
            break
    return round(float(np.quantile(confidences, _ASKED_BACK)), 3)


def find_wish_words(seed: int) -> list[str]:
    """The words that clear wishes have beside names: those in at least `_SEEN` of `_WISHES` lessons.

    A sentence with another word may be more than a wish: "push the ball tonight", "let my sister push it".
    """
    counts = Counter[str]()
    for sentence, answer in islice(_clear_wishes(np.random.default_rng((seed, _WISHES))), _WISHES):
        counts.update({*left_over(said_words(sentence), answer)})
    return sorted(word for word, count in counts.items() if count >= _SEEN)


def _clear_wishes(rng: np.random.Generator) -> Iterator[tuple[str, Request]]:
    while True:
        sentence, answer = draw_understood(rng)
        if isinstance(answer, Request) and answer.clear:
            yield sentence, answer
