# SPDX-License-Identifier: Apache-2.0
"""What is said to the robot: sentences of each kind, and what is right to do then."""

import re
from collections import Counter

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from clant_claeo.wordings import wordings
from nico_tabletop.configuration import ClaeoEnvConfig
from nico_tabletop.frames import PARAPHRASES, PLAIN, PUNCTUATION, SYNONYMS
from nico_tabletop.objects import read_objects
from nico_tabletop.tasks import ACTIONS, VERBS
from nico_tabletop.words import ABSENT, COUNTERFACTUAL, WORDS, Command, check_words, draw_command, misspell

KINDS = {**PARAPHRASES, "synonyms": SYNONYMS, "plain": {verb: (text,) for verb, text in PLAIN.items()}}
FRAMES = [
    (kind, verb, frame) for kind, verbs in KINDS.items() for verb, frames in verbs.items() for frame in frames
]
CLAEO = {item.name: item for item in read_objects("claeo")}
SCENE = ("mug", "ball", "can")
SEEDS = st.integers(0, 2**63)


def draw(kind: str, seed: int, action: int = 0, distractors: tuple[str, ...] = ()) -> Command:
    return draw_command(kind, ACTIONS[action], CLAEO, SCENE, distractors, np.random.default_rng(seed))


def test_there_are_eight_kinds_of_paraphrases_with_six_sentences_for_each_verb() -> None:
    assert len(PARAPHRASES) >= 8
    for kind in (*PARAPHRASES, "synonyms"):
        assert KINDS[kind].keys() == {verb.name for verb in VERBS}
        assert all(len(frames) >= 6 for frames in KINDS[kind].values())
    assert len(PUNCTUATION) >= 6


def test_each_sentence_stands_once_and_has_one_place_for_the_object() -> None:
    assert max(Counter(frame.lower() for *_, frame in FRAMES).values()) == 1
    assert all(frame.count("{}") == 1 for *_, frame in FRAMES)
    assert all(re.search(r"\b(the|that) \{\}", frame.lower()) for *_, frame in FRAMES)


@pytest.mark.parametrize(("kind", "verb", "frame"), FRAMES)
def test_a_sentence_names_no_side_but_its_verbs(kind: str, verb: str, frame: str) -> None:
    sides = {side for side in ("left", "right") if re.search(rf"\b{side}", frame.lower())}
    assert sides == ({verb.rpartition("-")[2]} if verb.startswith("slide") else set())
    opposite = {"push": r"\b(to|towards) you\b|closer|near|back\b", "pull": r"away|forward|farther|off\b"}
    assert verb not in opposite or not re.search(opposite[verb], frame)


def test_no_sentence_is_one_that_policies_are_trained_on() -> None:
    trained = {
        re.sub(r"\W+", " ", wording).lower()
        for objects in ("clant", "claeo")
        for item in read_objects(objects)
        for action in ACTIONS
        for wording in wordings(action, item)
    }
    said = {
        re.sub(r"\W+", " ", frame.format(name)).strip().lower().replace(" the ", " ")
        for *_, frame in FRAMES
        for objects in ("clant", "claeo")
        for item in read_objects(objects)
        for name in (item.name, *item.synonyms, item.phrase())
    }
    assert "push mug" in trained and len(said) > 5000
    assert not trained & said


@given(SEEDS, st.sampled_from([*WORDS]), st.integers(0, len(ACTIONS) - 1))
def test_a_seed_draws_the_same_command_about_what_is_there(seed: int, kind: str, action: int) -> None:
    command = draw(kind, seed, action)
    assert command == draw(kind, seed, action)
    if kind not in (COUNTERFACTUAL, ABSENT):
        assert command.action == ACTIONS[action]
    if kind in PARAPHRASES:
        assert f" {SCENE[ACTIONS[action].slot]}" in command.text
    if kind == "synonyms":
        assert f"the {CLAEO[SCENE[ACTIONS[action].slot]].synonyms[0]}" in command.text
    if kind == "typos":
        plain = PLAIN[ACTIONS[action].verb.name].format(SCENE[ACTIONS[action].slot])
        wrong = [(a, b) for a, b in zip(plain.split(), command.text.split(), strict=True) if a != b]
        assert len(wrong) == 1 and wrong[0][0][0] == wrong[0][1][0]


@given(SEEDS, st.integers(0, len(ACTIONS) - 1))
def test_a_counterfactual_command_asks_for_another_object_of_the_scene(seed: int, number: int) -> None:
    command, action = draw(COUNTERFACTUAL, seed, number), ACTIONS[number]
    assert command.action is not None and command.action.slot != action.slot
    assert command.action.verb == action.verb
    assert command.text == f"{action.verb.name} {SCENE[command.action.slot]}"


@given(SEEDS)
def test_an_absent_object_is_of_the_set_and_not_on_the_table(seed: int) -> None:
    command = draw(ABSENT, seed, distractors=("mustard bottle",))
    assert command.action is None
    assert command.text in ("push white chess piece", "push empty wine bottle")


def test_many_seeds_say_many_things() -> None:
    for kind in WORDS:
        least = {"canonical": 1, COUNTERFACTUAL: 2, ABSENT: 3}.get(kind, 6)
        assert len({draw(kind, seed).text for seed in range(200)}) >= least


@pytest.mark.parametrize("word", ["mug", "push", "left"])
def test_a_typing_error_leaves_the_first_letter_and_most_of_the_rest(word: str) -> None:
    drawn = {misspell(f"the {word}", np.random.default_rng(seed)) for seed in range(100)}
    assert len(drawn) > 2 and f"the {word}" not in drawn
    for text in drawn:
        assert text.startswith(f"the {word[0]}") and abs(len(text) - len(f"the {word}")) <= 1


def test_colours_are_said_with_their_noun() -> None:
    cubes = {item.name: item for item in read_objects("clant")}
    scene = ("red", "green", "blue")
    said = [
        draw_command(kind, ACTIONS[0], cubes, scene, (), np.random.default_rng(0)).text
        for kind in ("canonical", "need", "synonyms")
    ]
    assert said[0] == "push red"
    assert " red cube" in said[1] and " scarlet cube" in said[2]


def test_unknown_words_and_sets_without_an_absent_object_are_refused() -> None:
    with pytest.raises(ValueError, match=r"words must be one of canonical, synonyms, .*; got 'rude'"):
        ClaeoEnvConfig(words="rude").create_envs(n_envs=1)
    with pytest.raises(
        ValueError, match="all 6 objects of the set stand on it: choose a larger set or fewer"
    ):
        ClaeoEnvConfig(words=ABSENT, distractors=3).create_envs(n_envs=1)
    check_words(ABSENT, objects=6, on_table=5)
