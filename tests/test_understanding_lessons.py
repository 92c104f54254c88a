# SPDX-License-Identifier: Apache-2.0
"""The lessons in understanding, and the sentences that are held out of them."""

from itertools import chain, islice
from pathlib import Path

import numpy as np
import pytest
import torch
from transformers import AutoTokenizer

from lerobot_owlxt5.backbones.answer_constraint import AnswerConstraint
from lerobot_owlxt5.backbones.pretrained import EMBEDDED, find_backbone
from lerobot_owlxt5.commands.answer import Hold, Question, Request, format_answer, parse_answer
from owlxt5_backbones.language_model import UNDERSTANDING_KINDS, Examples
from owlxt5_backbones.understanding_lessons import (
    HELD_OUT,
    draw_lesson,
    draw_understood,
    frame_book,
    held_out,
    normalised,
)


def _lets_out(constraint: AnswerConstraint, tokens: list[int]) -> bool:
    return all(token in constraint(0, torch.tensor([0, *tokens[:end]])) for end, token in enumerate(tokens))


def test_each_answer_has_the_form_and_copies_only_what_was_said() -> None:
    tokenizer = AutoTokenizer.from_pretrained(find_backbone(EMBEDDED, "language_model", None)[0])
    rng = np.random.default_rng(1)
    for _ in range(300):
        sentence, answer = draw_understood(rng)
        text = format_answer(answer)
        assert parse_answer(text) == answer, sentence
        tokens = tokenizer(text)["input_ids"]
        assert _lets_out(AnswerConstraint(tokenizer, [sentence]), tokens), (sentence, text)


def test_lessons_are_the_same_for_the_same_dice() -> None:
    first, again = (np.random.default_rng(5) for _ in range(2))
    assert [draw_lesson(first) for _ in range(200)] == [draw_lesson(again) for _ in range(200)]


def test_lessons_are_whole_and_of_all_kinds() -> None:
    rng = np.random.default_rng(0)
    drawn = [draw_understood(rng) for _ in range(3000)]
    assert len({sentence for sentence, _ in drawn}) > 2700
    for sentence, _ in drawn:
        assert sentence
        assert not {*"{}_|"} & {*sentence}
        assert "  " not in sentence
    answers = [answer for _, answer in drawn]
    assert {answer.reason for answer in answers if isinstance(answer, Hold)} == {
        *("forbidden", "conditional", "not_now", "not_an_action", "beyond")
    }
    assert {answer.kind for answer in answers if isinstance(answer, Question)} == {
        *("ability", "scene", "robot")
    }
    requests = [answer for answer in answers if isinstance(answer, Request)]
    assert {len(request.actions) for request in requests} == {1, 2, 3}
    assert {request.clear for request in requests} == {True, False}


def test_no_held_out_sentence_is_a_lesson() -> None:
    assert len(held_out()) >= 260
    rng = np.random.default_rng(2)
    assert not {normalised(draw_understood(rng)[0]) for _ in range(3000)} & held_out()


def test_no_frame_is_a_held_out_sentence() -> None:
    texts = {
        normalised(frame.text)
        for files in frame_book().frames.values()
        for pair in chain.from_iterable(files)
        for frame in pair
    }
    assert len(texts) > 1000
    assert not texts & held_out()


@pytest.mark.parametrize("language", ["en", "de"])
def test_contrasts_differ_in_what_is_right(language: str) -> None:
    for pair in chain.from_iterable(frame_book().frames["contrast", language]):
        assert len({frame.kind for frame in pair}) == len(pair) == 2


@pytest.mark.parametrize("name", HELD_OUT)
def test_held_out_answers_can_be_given(name: str) -> None:
    path = Path(__file__).parents[1] / "dataset_builders" / "owlxt5_backbones" / name
    tokenizer = AutoTokenizer.from_pretrained(find_backbone(EMBEDDED, "language_model", None)[0])
    with open(path, encoding="utf-8") as file:
        rows = [line.rstrip("\n").split("\t") for line in file if not line.startswith("#")]
    for _, _, sentence, answers in islice(rows, 0, None, 3):
        for answer in answers.split(" / "):
            assert format_answer(parse_answer(answer)) == answer
            assert _lets_out(AnswerConstraint(tokenizer, [sentence]), tokenizer(answer)["input_ids"]), (
                sentence
            )


def test_a_resumed_training_goes_on_with_the_next_example() -> None:
    whole = [*islice(Examples(UNDERSTANDING_KINDS, 3, batch_size=2), 40)]
    assert [*islice(Examples(UNDERSTANDING_KINDS, 3, batch_size=2, first=18), 22)] == whole[18:]
