# SPDX-License-Identifier: Apache-2.0
"""Evaluates a language model on examples that it was not trained on: is it right to the letter?"""

from dataclasses import dataclass
from itertools import islice

import numpy as np
import torch

from lerobot_owlxt5.backbones.language_model import SplitT5
from lerobot_owlxt5.commands import prompts
from lerobot_owlxt5.commands.pseudo_names import draw_name

from .language_model import KINDS, UNDERSTANDING_KINDS, Example, Examples, Kinds

_MOST_TOKENS = 96
_AT_ONCE = 50


def _translate_invented(rng: np.random.Generator) -> Example:
    name = draw_name(rng)
    return prompts.translate_prompt(f"Push the {name} to the left"), f"Schiebe das {name} nach links"


def _repeat_invented(rng: np.random.Generator) -> Example:
    name = draw_name(rng)
    return prompts.repeat_language_prompt(f"pull {name}"), f"pull {name}"


TRAINED: dict[str, Kinds] = {"language_model": KINDS, "understanding": UNDERSTANDING_KINDS}
"""What each part learns."""
_ASKED: dict[str, Kinds] = {
    "language_model": {
        **{kind: drawn for kind, drawn in KINDS.items() if kind != "repeat action"},
        "translate, invented name": (_translate_invented, 0.0),
        "repeat language, invented name": (_repeat_invented, 0.0),
    },
    "understanding": UNDERSTANDING_KINDS,
}


@dataclass(frozen=True)
class AnswerMetrics:
    """How often a language model is right in one kind of examples.

    Attributes:
        kind: What was asked.
        examples: How many.
        exact_match: Share of them that were answered without any mistake.
        mistakes: Some of the others: prompt, answer expected, answer given.
    """

    kind: str
    examples: int
    exact_match: float
    mistakes: list[tuple[str, str, str]]


def evaluate_language_model(
    name: str,
    examples: int,
    part: str = "language_model",
    *,
    trained: int,
    training_seed: int,
    seed: int = 10_000,
) -> list[AnswerMetrics]:
    """Ask for examples of each kind: is the answer right to the letter, without any constraint?

    Args:
        name: Folder or Hub id of a T5, or `embedded`.
        examples: How many of each kind: of those that it learns, and for the language model of invented names
            alone.
        part: One of `TRAINED`.
        trained: How many examples it was trained on; none of them is asked for.
        training_seed: And the seed of these.
        seed: Of the examples of this evaluation.
    """
    known = {prompt for prompt, _ in islice(Examples(TRAINED[part], training_seed), trained)}
    language = SplitT5(name)
    results = []
    for kind, (draw, _) in _ASKED[part].items():
        rng, chosen = np.random.default_rng(seed), dict[str, str]()
        while len(chosen) < examples:
            prompt, answer = draw(rng)
            if prompt not in known:
                chosen[prompt] = answer
        given = _answers(language, [*chosen])
        wrong = [
            (prompt, expected, got)
            for (prompt, expected), got in zip(chosen.items(), given, strict=True)
            if got != expected
        ]
        results.append(AnswerMetrics(kind, examples, 1 - len(wrong) / examples, wrong[:5]))
    return results


def _answers(language: SplitT5, prompts: list[str]) -> list[str]:
    device, given = torch.device("cpu"), []
    for start in range(0, len(prompts), _AT_ONCE):
        encoding, mask = language.encode(prompts[start : start + _AT_ONCE], device)
        given += language.generate(encoding, mask, _MOST_TOKENS)
    return given
