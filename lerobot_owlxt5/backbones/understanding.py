# SPDX-License-Identifier: Apache-2.0
"""A language model that understands: from a sentence to a formal answer."""

import torch

from ..commands.answer import Action, Answer, Request, Target, parse_answer
from ..commands.prompts import understand_prompt
from .answer_constraint import AnswerConstraint
from .language_model import SplitT5

# Three actions with names and landmarks; a longer text has lost its way.
MOST_TOKENS = 96
NOT_UNDERSTOOD = Request((Action(None, Target()),))
"""Everything has to be asked back."""


class Understanding:
    """Understands sentences with a T5 that has learnt `understand: …`.

    Args:
        name: Hub id, folder, or `embedded`.
    """

    def __init__(self, name: str) -> None:
        self._language = SplitT5(name)

    def __call__(self, sentence: str) -> Answer:
        """What a sentence asks for; `NOT_UNDERSTOOD` if the answer does not come to an end."""
        encoding, mask = self._language.encode([understand_prompt(sentence)], torch.device("cpu"))
        constraint = AnswerConstraint(self._language.tokenizer, [sentence])
        [text] = self._language.generate(encoding, mask, MOST_TOKENS, constraint)
        try:
            return parse_answer(text)
        except ValueError:
            return NOT_UNDERSTOOD
