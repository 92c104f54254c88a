# SPDX-License-Identifier: Apache-2.0
"""Examines a tongue on lessons that it never had: does it say, letter by letter, what it should?"""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

import numpy as np
import torch

from lerobot_owlxt5.backbones.language_model import SplitT5
from lerobot_owlxt5.commands import prompts
from lerobot_owlxt5.commands.pseudo_names import draw_name

from .tongue import KINDS, Lesson, Lessons

_MOST_TOKENS = 64
_AT_ONCE = 50


@dataclass(frozen=True)
class Grade:
    """What came out for one kind of lesson.

    Attributes:
        kind: What was asked.
        lessons: How many.
        right: Share of them that were answered without any mistake.
        mistakes: Some of the others: prompt, answer expected, answer given.
    """

    kind: str
    lessons: int
    right: float
    mistakes: list[tuple[str, str, str]]


def examine(
    tongue: str, lessons: int, *, trained: int, training_seed: int, seed: int = 10_000
) -> list[Grade]:
    """Ask for lessons of each kind, and for made-up names alone: one to three words of random letters.

    Args:
        tongue: Folder of a T5, or `embedded`.
        lessons: How many of each kind.
        trained: How many lessons it was trained on; none of them is asked for.
        training_seed: And the seed of these.
        seed: Of the lessons of this exam.
    """
    known = {prompt for prompt, _ in islice(Lessons(training_seed), trained)}
    language = SplitT5(tongue)
    grades = []
    for kind, draw in _QUESTIONS.items():
        random, chosen = np.random.default_rng(seed), dict[str, str]()
        while len(chosen) < lessons:
            prompt, answer = draw(random)
            if prompt not in known:
                chosen[prompt] = answer
        given = _answers(language, [*chosen])
        wrong = [
            (prompt, expected, got)
            for (prompt, expected), got in zip(chosen.items(), given, strict=True)
            if got != expected
        ]
        grades.append(Grade(kind, lessons, 1 - len(wrong) / lessons, wrong[:5]))
    return grades


def _translate_made_up(random: np.random.Generator) -> Lesson:
    name = draw_name(random)
    return prompts.translate_prompt(f"Push the {name} to the left"), f"Schiebe das {name} nach links"


def _repeat_made_up(random: np.random.Generator) -> Lesson:
    name = draw_name(random)
    return prompts.repeat_language_prompt(f"pull {name}"), f"pull {name}"


_QUESTIONS: dict[str, Callable[[np.random.Generator], Lesson]] = {
    **{kind: draw for kind, (draw, _) in KINDS.items() if kind != "repeat action"},
    "translate, made-up name": _translate_made_up,
    "repeat language, made-up name": _repeat_made_up,
}


def _answers(language: SplitT5, prompts: list[str]) -> list[str]:
    device, given = torch.device("cpu"), []
    for start in range(0, len(prompts), _AT_ONCE):
        encoding, mask = language.encode(prompts[start : start + _AT_ONCE], device)
        given += language.generate(encoding, mask, _MOST_TOKENS)
    return given
