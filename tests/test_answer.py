# SPDX-License-Identifier: Apache-2.0
"""Formal answers: their text, and the constraint that lets nothing else out of a language model."""

import re

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st
from transformers import AutoTokenizer, PreTrainedTokenizerBase, T5Config, T5ForConditionalGeneration

from lerobot_owlxt5.backbones.answer_constraint import LONGEST_WORD, MOST_SKIPPED, AnswerConstraint
from lerobot_owlxt5.backbones.pretrained import EMBEDDED, find_backbone
from lerobot_owlxt5.commands import answer as form
from lerobot_owlxt5.commands.answer import (
    Action,
    Answer,
    Hold,
    Landmark,
    Question,
    Relation,
    Request,
    Target,
    format_answer,
    heard,
    parse_answer,
    said_words,
)
from lerobot_owlxt5.commands.verbs import VERBS

# Words of the form are names, too: "push the push pin", "the left shoe", "the it girl".
_WORDS = st.sampled_from(
    [
        *("red", "cube", "left", "of", "it", "in", "other", "and", "between", "second", "from", "to"),
        *("hold", "dad's", "würfel", "7", "ж"),
    ]
)


def _said(fewest: int, most: int) -> st.SearchStrategy[str]:
    return st.lists(_WORDS, min_size=fewest, max_size=most).map(" ".join)


_NAMES, _COLOURS = _said(0, form.MOST_NAME_WORDS), _said(0, form.MOST_COLOUR_WORDS)
_LANDMARKS = st.builds(Landmark, _NAMES, _COLOURS).filter(lambda landmark: landmark != Landmark())
_RELATIONS = st.one_of(
    st.builds(Relation, st.sampled_from([*{*form.RELATIONS} - {"between"}]), st.tuples(_LANDMARKS)),
    st.builds(Relation, st.just("between"), st.tuples(_LANDMARKS, _LANDMARKS)),
)
_TARGETS = st.builds(
    Target,
    _NAMES,
    _COLOURS,
    st.sampled_from(["", *form.REFERENCES]),
    st.sampled_from(["", *form.SIDES]),
    st.none() | st.tuples(st.sampled_from(form.RANKS), st.sampled_from(form.COUNTED_FROM)),
    st.none() | _RELATIONS,
)
_ACTIONS = st.builds(Action, st.none() | st.sampled_from([*VERBS]), _TARGETS)
_ANSWERS = st.one_of(
    st.lists(_ACTIONS, min_size=1, max_size=form.MOST_ACTIONS).map(lambda actions: Request((*actions,))),
    st.builds(Question, st.sampled_from(form.QUESTIONS)),
    st.builds(Hold, st.sampled_from(form.REASONS)),
)


@pytest.fixture(scope="module")
def tokenizer() -> PreTrainedTokenizerBase:
    return AutoTokenizer.from_pretrained(find_backbone(EMBEDDED, "language_model", None)[0])


@given(_ANSWERS)
def test_the_text_of_an_answer_is_that_answer(answer: Answer) -> None:
    assert parse_answer(format_answer(answer)) == answer


@pytest.mark.parametrize(
    "text",
    [
        *("", "pushed cube", "hold", "hold still", "question", "question weather", "push cube,"),
        *("push  cube", "push Cube", "push [cube]", "push cube; ", "push; push; push; push", "push, second"),
        *("push cube, left, in red", "push, behind", "push, between can", "push, behind can, and mug"),
        "push a b c d e f",
    ],
)
def test_other_texts_are_no_answers(text: str) -> None:
    with pytest.raises(ValueError, match=r"is no action|more than|its landmarks"):
        parse_answer(text)


def test_what_was_said_is_heard_in_plain_words() -> None:
    assert heard("  Move-Up\tthe \u202emug\x00, don\u2019t\n") == "move up the mug , don't"
    assert said_words("'Push' the dog's u\u0308ber-cube_2!") == ("push", "the", "dog's", "über", "cube", "2")


def _stands_in(name: str, sentence: str) -> bool:
    """Whether the words stand in the sentence in this order, with few others between them."""
    said, gap = said_words(sentence), rf"(?:\S+ ){{0,{MOST_SKIPPED}}}"
    return bool(
        re.search(" " + gap.join(f"{re.escape(word)} " for word in name.split()), f" {' '.join(said)} ")
    )


def _copied(answer: Answer) -> list[str]:
    if not isinstance(answer, Request):
        return []
    targets = [action.target for action in answer.actions]
    marks = [mark for target in targets if target.relation for mark in target.relation.landmarks]
    return [name for thing in (*targets, *marks) for name in (thing.name, thing.colour) if name]


_SENTENCES = (
    "Push the big RED cube behind dad's can, please!",
    "schieb den grünen Würfel nach links",
    "?! ...",
    "拿 кубик 🤖 push",
    f"pull the {'x' * (LONGEST_WORD + 1)}",
)


def _dice_model(tokenizer: PreTrainedTokenizerBase, seed: int) -> T5ForConditionalGeneration:
    """A tiny model whose answers are chance."""
    torch.manual_seed(seed)
    sizes = {"d_model": 8, "d_kv": 4, "d_ff": 8, "num_layers": 1, "num_heads": 2, "initializer_factor": 5.0}
    ends = {"eos_token_id": tokenizer.eos_token_id, "pad_token_id": tokenizer.pad_token_id}
    start = {"decoder_start_token_id": tokenizer.pad_token_id}
    return T5ForConditionalGeneration(T5Config(vocab_size=len(tokenizer), **sizes, **ends, **start)).eval()


@pytest.mark.parametrize(("seed", "beams"), [(0, 1), (1, 1), (2, 1), (3, 2)])
def test_whatever_a_model_prefers_an_answer_comes_out(
    tokenizer: PreTrainedTokenizerBase, seed: int, beams: int
) -> None:
    inputs = tokenizer(list(_SENTENCES), padding=True, return_tensors="pt")
    generated = _dice_model(tokenizer, seed).generate(
        input_ids=inputs["input_ids"],
        attention_mask=inputs["attention_mask"],
        prefix_allowed_tokens_fn=AnswerConstraint(tokenizer, _SENTENCES),
        do_sample=beams == 1,
        num_beams=beams,
        max_new_tokens=600,
    )
    for sentence, text in zip(
        _SENTENCES, tokenizer.batch_decode(generated, skip_special_tokens=True), strict=True
    ):
        answer = parse_answer(text.strip())
        assert all(_stands_in(name, sentence) for name in _copied(answer)), (sentence, text)


@settings(deadline=None, max_examples=25)
@given(_ANSWERS)
@example(Request((Action("push", Target("push pin", side="left")),)))
def test_the_constraint_lets_every_answer_out(tokenizer: PreTrainedTokenizerBase, answer: Answer) -> None:
    sentence, text = ". ".join([*_copied(answer), "so"]), format_answer(answer)
    constraint, tokens = AnswerConstraint(tokenizer, [sentence]), tokenizer(text)["input_ids"]
    for end, token in enumerate(tokens):
        assert token in constraint(0, torch.tensor([0, *tokens[:end]])), tokenizer.decode(tokens[:end])


@pytest.mark.parametrize(
    ("sentence", "text"),
    [
        ("push no wine bottle", "push nine"),
        ("push the cup and pull the can", "push cup the pull the can"),
        ("push the can behind the big wine glass", "push can wine"),
        ("push the cup", "push cup, left of"),
    ],
)
def test_a_name_is_only_what_was_said(tokenizer: PreTrainedTokenizerBase, sentence: str, text: str) -> None:
    constraint, tokens = AnswerConstraint(tokenizer, [sentence]), tokenizer(text)["input_ids"]
    assert any(
        token not in constraint(0, torch.tensor([0, *tokens[:end]])) for end, token in enumerate(tokens)
    )
