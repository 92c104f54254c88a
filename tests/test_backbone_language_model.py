# SPDX-License-Identifier: Apache-2.0
"""The grammar that the small language model is trained on, and that it learns."""

from pathlib import Path

import numpy as np
import pytest
import torch

from lerobot_owlxt5.backbones.small_t5 import SmallT5Config, make_small_t5
from lerobot_owlxt5.commands.verbs import VERBS
from owlxt5_backbones import card
from owlxt5_backbones.evaluate_language_model import evaluate_language_model
from owlxt5_backbones.grammar import (
    ADJECTIVES,
    TRANSLATED_VERBS,
    Case,
    Noun,
    Thing,
    compound,
    draw_translation,
    nouns,
)
from owlxt5_backbones.language_model import KINDS, draw_example, load_language_model
from owlxt5_backbones.train import BackbonesConfig, train_language_model

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
        for verb in TRANSLATED_VERBS
    }
    assert said["push the red cube to the left"] == "Schiebe den roten Würfel nach links"
    assert {verb.imperative.format("the red cube") for verb in VERBS.values()} <= {*said}
    assert said["pull the red cube"] == "Ziehe den roten Würfel heran"
    assert said["slide the red cube to the right"] == "Schiebe den roten Würfel nach rechts"


def test_sentences_are_whole_and_varied() -> None:
    rng = np.random.default_rng(0)
    drawn = [draw_translation(rng) for _ in range(2000)]
    for english, german in drawn:
        assert "{" not in english + german
        assert "  " not in english + german
        assert german[0].isupper()
        assert english.endswith("?") == german.endswith("?")
    assert len({english for english, _ in drawn}) > 1900
    words = {word for english, _ in drawn for word in english.split()}
    assert words >= {"red", "push", "where", "cannot", "table."}
    assert all(any(adjective in english for english, _ in drawn) for adjective in ADJECTIVES)


def test_examples_copy_names_that_no_list_has() -> None:
    rng = np.random.default_rng(0)
    known = {word for noun in nouns() for word in noun.english.split()}
    described = [
        (prompt.removeprefix("describe: "), answer)
        for prompt, answer in (draw_example(rng, KINDS) for _ in range(2000))
        if prompt.startswith("describe: ")
    ]
    assert all(prompt == answer for prompt, answer in described)
    unknown = [answer for _, answer in described if not known & {*answer.split()}]
    assert len(unknown) > 20


def test_a_miniature_model_learns_and_gets_a_card(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = BackbonesConfig("language_model", tmp_path, steps=300, batch_size=16, learning_rate=1e-2)
    sizes = {"vocab_size": 600, "d_model": 32, "d_kv": 8, "d_ff": 64, "num_layers": 1}
    _, losses = train_language_model(config, SmallT5Config(tmp_path / "model", **sizes))
    assert np.mean(losses[-5:]) < 0.8 * np.mean(losses[:5])
    monkeypatch.setattr(card, "_EXAMPLES", 3)
    facts = {"command": config.command, "size": "a few"}
    table = card.write_language_model_card(config.model_dir, "language_model", 0, 300 * 16, **facts)
    assert "| translate, invented name |" in table
    assert "none of which was in training." in table
    written = (tmp_path / "model" / "README.md").read_text(encoding="utf-8")
    assert table in written
    assert "--part=language_model --steps=300 --batch_size=16 --learning_rate=0.01" in written
    more = card.write_language_model_card(
        config.model_dir, "language_model", 0, 300 * 16, went_on=True, **facts
    )
    assert "none of which was in the last command's training." in more


def test_more_layers_change_nothing_at_first(tmp_path: Path) -> None:
    sizes = SmallT5Config(tmp_path / "small", vocab_size=300, d_model=16, d_kv=8, d_ff=32, num_layers=1)
    make_small_t5(sizes, ["push the cube", "pull the ball"])
    same, more = (
        load_language_model(str(sizes.output_dir), tmp_path / "more", layers).eval() for layers in (None, 3)
    )
    tokens = torch.tensor([[7, 20, 9, 1]])
    encodings = [model.encoder(tokens).last_hidden_state for model in (same, more)]
    torch.testing.assert_close(*encodings)
    assert (len(same.encoder.block), len(more.encoder.block)) == (1, 3)
    assert more.config.num_layers == 3


def test_the_embedded_model_answers_examples_that_it_was_not_trained_on() -> None:
    metrics = evaluate_language_model("embedded", 30, trained=1000, training_seed=0)
    results = {each.kind: each for each in metrics}
    assert results["execute"].exact_match > 0.8
    assert results["translate"].exact_match > 0.7
    assert results["repeat language, invented name"].exact_match > 0.7
    for each in metrics:
        assert len(each.mistakes) == min(5, round((1 - each.exact_match) * each.examples))
