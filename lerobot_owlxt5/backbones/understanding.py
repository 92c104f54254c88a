# SPDX-License-Identifier: Apache-2.0
"""A language model that understands: from a sentence to a formal answer."""

from typing import NamedTuple

import torch

from ..commands.answer import Action, Answer, Request, Target, left_over, parse_answer, said_words
from ..commands.prompts import name_in_english_prompt, understand_prompt
from .answer_constraint import AnswerConstraint
from .language_model import SplitT5

# Three actions with names and landmarks; a longer text has lost its way.
MOST_TOKENS = 96
MOST_NAME_TOKENS = 24
# Names that somebody speaks of come up again and again.
_REMEMBERED_NAMES = 256
# One word in so many may be unknown: in a long sentence it is a reason or a story. In a short one it may turn
# what is asked for: "push the ball tonight".
_WORDS_TO_AN_UNKNOWN_ONE = 8
NOT_UNDERSTOOD = Request((Action(None, Target()),))
"""Everything has to be asked back."""


class Understood(NamedTuple):
    """What was made of a sentence.

    Attributes:
        answer: What it asks for.
        confidence: Mean probability of the answer's tokens, in [0, 1]. Long names make the whole one small.
        sure: Whether that is enough to act on.
        unknown: Words that are neither in the answer nor in what wishes have. With one in a short sentence,
            or with several, nothing is sure.
    """

    answer: Answer
    confidence: float
    sure: bool
    unknown: tuple[str, ...] = ()


class Understanding:
    """Understands sentences with a T5 that has learnt `understand: …`.

    Args:
        name: Hub id, folder, or `embedded`.
        revision: Hub revision, or the digest of an embedded one; or None.

    Attributes:
        threshold: From this confidence on it is sure: the `understanding_threshold` in the model's
            config.json, or 0.
        words: What wishes have beside names: the `wish_words` in its config.json. None: any word.
        revision: The Hub's commit, or the digest of embedded weights; None for a folder.
    """

    def __init__(self, name: str, revision: str | None = None) -> None:
        self._language = SplitT5(name, revision, part="understanding")
        config = self._language.model.config
        self.threshold = float(getattr(config, "understanding_threshold", 0.0))
        # Out of the config: transformers copies all of it several times for each text that is generated.
        words = vars(config).pop("wish_words", None)
        self.words: frozenset[str] | None = None if words is None else frozenset(words)
        self.revision = self._language.revision
        self._english: dict[str, str] = {}

    def __call__(self, sentence: str) -> Understood:
        """What a sentence asks for; `NOT_UNDERSTOOD` if the answer does not come to an end."""
        constraint = AnswerConstraint(self._language.tokenizer, [sentence])
        encoding, mask = self._encode(understand_prompt(sentence))
        [text] = self._language.generate(encoding, mask, MOST_TOKENS, constraint)
        try:
            answer = parse_answer(text)
        except ValueError:
            return Understood(NOT_UNDERSTOOD, 0.0, False)
        # Without the constraint: where the model would have said something else, it is not sure.
        confidence = float(self._language.confidence(encoding, mask, [text]))
        words = said_words(sentence)
        unknown = tuple(
            word for word in left_over(words, answer) if self.words is not None and word not in self.words
        )
        known = len(unknown) <= len(words) // _WORDS_TO_AN_UNKNOWN_ONE
        return Understood(answer, confidence, known and confidence >= self.threshold, unknown)

    def in_english(self, name: str) -> str:
        """What a thing is called in English, or the name itself if it has no German name's form."""
        if name not in self._english:
            if len(self._english) >= _REMEMBERED_NAMES:
                self._english.clear()
            encoding, mask = self._encode(name_in_english_prompt(name))
            [english] = self._language.generate(encoding, mask, MOST_NAME_TOKENS)
            self._english[name] = english or name
        return self._english[name]

    def _encode(self, prompt: str) -> tuple[torch.Tensor, torch.Tensor]:
        return self._language.encode([prompt], torch.device("cpu"))
