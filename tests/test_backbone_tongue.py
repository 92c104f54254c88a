# SPDX-License-Identifier: Apache-2.0
"""The grammar that the small tongue learns from, and that it learns."""

from pathlib import Path

import numpy as np
import pytest

from lerobot_owlxt5.backbones.small_t5 import SmallT5Config
from owlxt5_backbones import card, exam_tongue
from owlxt5_backbones.grammar import ADJECTIVES, VERBS, Case, Noun, Thing, compound, draw_translation, nouns
from owlxt5_backbones.tongue import draw_lesson
from owlxt5_backbones.train import BackbonesConfig, train_tongue

pytestmark = pytest.mark.slow  # trains

CUBE, CUP, BOOK = Noun("cube", "Würfel", "m"), Noun("cup", "Tasse", "f"), Noun("book", "Buch", "n")


@pytest.mark.parametrize(
    ("noun", "case", "german"),
    [
        (CUBE, "nominative", "der rote Würfel"),
        (CUBE, "accusative", "den roten Würfel"),
        (CUBE, "dative", "dem roten Würfel"),
        (CUP, "nominative", "die rote Tasse"),
        (CUP, "accusative", "die rote Tasse"),
        (CUP, "dative", "der roten Tasse"),
        (BOOK, "nominative", "das rote Buch"),
        (BOOK, "accusative", "das rote Buch"),
        (BOOK, "dative", "dem roten Buch"),
    ],
)
def test_article_and_adjective_agree_with_the_noun(noun: Noun, case: Case, german: str) -> None:
    assert Thing(noun, "red").german(case) == german


@pytest.mark.parametrize(
    ("noun", "a", "no"),
    [
        (CUBE, "ein roter Würfel", "keinen roten Würfel"),
        (CUP, "eine rote Tasse", "keine rote Tasse"),
        (BOOK, "ein rotes Buch", "kein rotes Buch"),
    ],
)
def test_indefinite_articles(noun: Noun, a: str, no: str) -> None:
    assert Thing(noun, "red").german("nominative", definite=False) == a
    assert Thing(noun, "red").german("accusative", none=True) == no


def test_compounds_are_one_word() -> None:
    assert compound("toy", Noun("car", "Auto", "n")) == Noun("toy car", "Spielzeugauto", "n")


def test_nouns_are_unique_and_have_a_gender() -> None:
    english, german, genders = zip(*nouns(), strict=True)
    assert len(set(english)) == len(set(german)) == len(english)
    assert {*genders} == {"m", "f", "n"}
    assert len(english) > 400


def test_the_action_language_in_german() -> None:
    red_cube = Thing(CUBE, "red")
    said = {
        verb.english.format(f"the {red_cube.english}"): (
            f"{verb.imperative} {red_cube.german('accusative')} {verb.rest}".strip()
        )
        for verb in VERBS
    }
    assert said["push the red cube to the left"] == "Schiebe den roten Würfel nach links"
    assert said["pull the red cube"] == "Ziehe den roten Würfel heran"
    assert said["slide the red cube to the right"] == "Schiebe den roten Würfel nach rechts"


def test_sentences_are_whole_and_varied() -> None:
    random = np.random.default_rng(0)
    drawn = [draw_translation(random) for _ in range(2000)]
    for english, german in drawn:
        assert "{" not in english + german
        assert "  " not in english + german
        assert german[0].isupper()
        assert english.endswith("?") == german.endswith("?")
    assert len({english for english, _ in drawn}) > 1900
    words = {word for english, _ in drawn for word in english.split()}
    assert words >= {"red", "push", "where", "cannot", "table."}
    assert all(any(adjective in english for english, _ in drawn) for adjective in ADJECTIVES)


def test_lessons_copy_names_that_no_list_has() -> None:
    random = np.random.default_rng(0)
    known = {word for noun in nouns() for word in noun.english.split()}
    described = [
        (prompt.removeprefix("describe: "), answer)
        for prompt, answer in (draw_lesson(random) for _ in range(2000))
        if prompt.startswith("describe: ")
    ]
    assert all(prompt == answer for prompt, answer in described)
    unknown = [answer for _, answer in described if not known & {*answer.split()}]
    assert len(unknown) > 20


def test_a_miniature_tongue_learns_and_gets_a_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = BackbonesConfig("tongue", tmp_path, steps=300, batch_size=16, learning_rate=1e-2)
    sizes = {"vocab_size": 600, "d_model": 32, "d_kv": 8, "d_ff": 64, "num_layers": 1}
    _, losses = train_tongue(config, SmallT5Config(tmp_path / "model", **sizes))
    assert np.mean(losses[-5:]) < 0.75 * np.mean(losses[:5])
    monkeypatch.setattr(card, "_LESSONS", 3)
    table = card.write_tongue_card(config.model_dir, 0, 300 * 16, command=config.command, size="a few")
    assert "| translate, made-up name |" in table
    written = (tmp_path / "model" / "README.md").read_text(encoding="utf-8")
    assert table in written
    assert "owlxt5-backbones --part=tongue --steps=300 --batch_size=16 --learning_rate=0.01" in written


def test_the_embedded_tongue_answers_lessons_that_it_never_had() -> None:
    grades = {
        grade.kind: grade for grade in exam_tongue.examine("embedded", 30, trained=1000, training_seed=0)
    }
    assert grades["execute"].right > 0.8
    assert grades["translate"].right > 0.7
    assert grades["repeat language, made-up name"].right > 0.7
    for grade in grades.values():
        assert len(grade.mistakes) == min(5, round((1 - grade.right) * grade.lessons))
