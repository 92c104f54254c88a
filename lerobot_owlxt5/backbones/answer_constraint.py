# SPDX-License-Identifier: Apache-2.0
"""The form of a formal answer as a constraint on what a language model may generate.

Nothing but an answer can come out, and its names can only be words that were said. The form is a grammar of
words; each word is written in the tokens that the tokenizer makes of it, so any tokenizer will do.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from torch import Tensor
from transformers import PreTrainedTokenizerBase

from ..commands.answer import (
    ANY_VERB,
    COUNTED_FROM,
    MOST_ACTIONS,
    MOST_COLOUR_WORDS,
    MOST_NAME_WORDS,
    QUESTIONS,
    RANKS,
    REASONS,
    REFERENCES,
    RELATIONS,
    SIDES,
    VERB_TEXTS,
    said_words,
)

# A name's words follow each other in the sentence; "the big red cube" has one of a colour between them.
MOST_SKIPPED = MOST_COLOUR_WORDS
# No name has longer words, and a generated answer should end.
LONGEST_WORD = 30


@dataclass(frozen=True)
class _Copied:
    """Words of the sentence, in its order.

    Attributes:
        fewest: At least so many.
        most: At most so many.
        last: Where in the sentence the word before stands, if there is one.
    """

    fewest: int
    most: int
    last: int | None = None


# A word or mark, words to copy, or alternatives; a sequence of these is a phrase.
_Element = str | _Copied | frozenset[Any]
_Phrase = tuple[_Element, ...]


def _one_of(*phrases: str | _Phrase) -> _Element:
    return frozenset(tuple(phrase.split()) if isinstance(phrase, str) else phrase for phrase in phrases)


def _optional(*phrase: _Element) -> _Element:
    return frozenset(((), phrase))


@cache
def _grammar(words_to_copy: bool) -> _Phrase:
    fixed = [
        *(f"hold {reason.replace('_', ' ')}" for reason in REASONS),
        *(f"question {q}" for q in QUESTIONS),
    ]
    if not words_to_copy:
        return (_one_of(*fixed, ANY_VERB),)
    in_colour: _Phrase = (",", "in", _Copied(1, MOST_COLOUR_WORDS))
    landmark = _one_of((_Copied(1, MOST_NAME_WORDS), _optional(*in_colour)), in_colour)
    single = _one_of(*(kind for kind in RELATIONS if kind != "between"))
    action: _Phrase = (
        _one_of(*VERB_TEXTS),
        _Copied(0, MOST_NAME_WORDS),
        _optional(*in_colour),
        _optional(",", _one_of(*REFERENCES)),
        _optional(",", _one_of(*SIDES)),
        _optional(",", _one_of(*RANKS), "from", _one_of(*COUNTED_FROM)),
        _optional(",", _one_of((single, landmark), ("between", landmark, ",", "and", landmark))),
    )
    actions = action
    for _ in range(MOST_ACTIONS - 1):
        actions = (*action, _optional(";", *actions))
    return (_one_of(*fixed, actions),)


class AnswerConstraint:
    """`prefix_allowed_tokens_fn` of transformers' `generate`.

    Args:
        tokenizer: The language model's.
        sentences: What was said, one a sample of the batch.
    """

    def __init__(self, tokenizer: PreTrainedTokenizerBase, sentences: Sequence[str]) -> None:
        self._end = int(tokenizer.eos_token_id)  # type: ignore[arg-type]
        self._samples = [_Sample(tokenizer, sentence, self._end) for sentence in sentences]

    def __call__(self, sample: int, generated: Tensor) -> list[int]:
        """The tokens that may follow; after the answer, its end again.

        Args:
            sample: Place in the batch.
            generated: (tokens,) with the token that starts the decoder.
        """
        return self._samples[sample].following(tuple(generated[1:].tolist())) or [self._end]


# Tokens still to come of a word, and the phrase after it.
_State = tuple[tuple[int, ...], _Phrase]


class _Sample:
    """The constraint for one sentence."""

    def __init__(self, tokenizer: PreTrainedTokenizerBase, sentence: str, end: int) -> None:
        self._tokenizer, self._end = tokenizer, end
        self._tokens: dict[str, tuple[int, ...]] = {}
        words = (word for word in said_words(sentence) if len(word) <= LONGEST_WORD)
        # What the tokenizer cannot spell cannot be copied.
        self._said = [word for word in words if str(tokenizer.decode([*self._spell(word)])).strip() == word]
        start = (*_grammar(bool(self._said)), "")
        self._states: dict[tuple[int, ...], frozenset[_State]] = {(): frozenset(self._expand(start))}

    def following(self, prefix: tuple[int, ...]) -> list[int]:
        """The tokens that may follow a prefix; none if it has another form, or has ended."""
        return sorted({tokens[0] for tokens, _ in self._after(prefix) if tokens})

    def _after(self, prefix: tuple[int, ...]) -> frozenset[_State]:
        if prefix not in self._states:
            states: set[_State] = set()
            for tokens, phrase in self._after(prefix[:-1]):
                if tokens[:1] == prefix[-1:]:
                    states |= {(tokens[1:], phrase)} if tokens[1:] else {*self._expand(phrase)}
            self._states[prefix] = frozenset(states)
        return self._states[prefix]

    def _expand(self, phrase: _Phrase) -> Iterator[_State]:
        """Each word that a phrase can begin with, and what follows then."""
        if not phrase:
            return
        first, rest = phrase[0], phrase[1:]
        if isinstance(first, str):
            yield self._spell(first), rest
        elif isinstance(first, _Copied):
            if first.fewest <= 0:
                yield from self._expand(rest)
            if first.most:
                start = 0 if first.last is None else first.last + 1
                stop = None if first.last is None else start + MOST_SKIPPED + 1
                for place, word in enumerate(self._said[start:stop], start):
                    more = _Copied(first.fewest - 1, first.most - 1, place)
                    yield self._spell(word), (more, *rest)
        else:
            for alternative in first:
                yield from self._expand((*alternative, *rest))

    def _spell(self, word: str) -> tuple[int, ...]:
        """Tokens of a word, with the space before it; of a mark, without; of "", the end."""
        if word not in self._tokens:
            if word in ("", ",", ";"):
                token = self._tokenizer.convert_tokens_to_ids(word) if word else self._end
                self._tokens[word] = (int(token),)  # type: ignore[arg-type]
            else:
                self._tokens[word] = tuple(self._tokenizer(word, add_special_tokens=False)["input_ids"])
        return self._tokens[word]
