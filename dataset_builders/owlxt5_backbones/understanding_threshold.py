# SPDX-License-Identifier: Apache-2.0
"""The confidence from which on a robot may act on what its language model understood."""

import numpy as np

from lerobot_owlxt5.backbones.understanding import Understanding
from lerobot_owlxt5.commands.answer import Request

from .understanding_lessons import draw_understood

_LESSONS = 500
_ASKED_BACK = 0.03


def find_understanding_threshold(name: str, seed: int) -> float:
    """The confidence that all but `_ASKED_BACK` of the clear wishes reach that are understood rightly.

    Args:
        name: Folder of a T5 that has learnt to understand.
        seed: Of the lessons; training draws others.
    """
    understand, rng = Understanding(name), np.random.default_rng((seed, _LESSONS))
    confidences: list[float] = []
    while len(confidences) < _LESSONS:
        sentence, answer = draw_understood(rng)
        if isinstance(answer, Request) and answer.clear:
            understood = understand(sentence)
            if understood.answer == answer:
                confidences.append(understood.confidence)
    return round(float(np.quantile(confidences, _ASKED_BACK)), 3)
