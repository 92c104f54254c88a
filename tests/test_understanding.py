# SPDX-License-Identifier: Apache-2.0
"""What the embedded model makes of words, and what a policy does about it."""

import time
from copy import deepcopy
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lerobot_owlxt5.backbones.pretrained import find_backbone
from lerobot_owlxt5.backbones.understanding import NOT_UNDERSTOOD, Understanding
from lerobot_owlxt5.commands.answer import Action, Hold, Question, Request, Target, said_words
from lerobot_owlxt5.commands.instruction import TaskReader
from lerobot_owlxt5.commands.replies import NOTHING_ASKED, TOO_LONG
from owlxt5_backbones import understanding_caution
from policy_helpers import make_policy, observe


@pytest.fixture(scope="module")
def understand() -> Understanding:
    return Understanding("embedded")


@pytest.mark.parametrize(
    ("sentence", "verb", "target"),
    [
        ("push the ball", "push", Target("ball")),
        ("Pull the ball!", "pull", Target("ball")),
        ("please push the red cube", "push", Target("cube", "red")),
        ("could you slide the can to the left?", "slide-to-left", Target("can")),
        ("the mug should be closer to you", "pull", Target("mug")),
        ("schieb den Becher nach links", "slide-to-left", Target("becher")),
    ],
)
def test_wishes(understand: Understanding, sentence: str, verb: str, target: Target) -> None:
    understood = understand(sentence)
    assert understood.answer == Request((Action(verb, target),))
    assert understood.sure
    assert 0 < understood.confidence <= 1


def test_what_is_no_wish(understand: Understanding) -> None:
    assert understand("don't push the ball").answer == Hold("forbidden")
    assert understand("if it rains, push the ball").answer == Hold("conditional")
    assert understand("what can you do?").answer == Question("ability")


def test_the_threshold_lets_most_lessons_pass(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(understanding_caution, "_LESSONS", 6)
    folder, _ = find_backbone("embedded", "understanding", None)
    threshold = understanding_caution.find_understanding_threshold(folder, seed=5)
    assert 0.3 < threshold <= 1.0


def test_a_word_that_wishes_do_not_have_is_asked_about(understand: Understanding) -> None:
    understood = understand("Tom, push the ball")
    assert not understood.sure
    assert understood.unknown == ("tom",)
    # It knows what this word means.
    assert understand("push the ball tonight").answer == Hold("not_now")
    reply = READER.read_answer(BALL, sure=False, before=None, unknown=("tonight",)).reply
    assert reply == "I do not know what 'tonight' means here. Did you mean: push the ball?"


@pytest.mark.parametrize(
    ("background", "sure"),
    [("brought his theodolite along", True), ("and his quokka and his theodolite and his sextant", False)],
)
def test_a_long_sentence_may_have_a_word_that_wishes_do_not_have(
    understand: Understanding, background: str, sure: bool
) -> None:
    understood = understand(f"my uncle {background} and there is no room left, so please push the ball away")
    assert understood.answer == BALL
    assert "theodolite" in understood.unknown
    assert understood.sure == sure


def test_wish_words_are_no_names(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(understanding_caution, "_WISHES", 2000)
    words = understanding_caution.find_wish_words(seed=1)
    assert {"please", "push", "the", "bitte", "zieh"} <= {*words}
    assert not {"mug", "tonight", "cube", "sister"} & {*words}


def test_names_in_english(understand: Understanding) -> None:
    names = {"ball": "ball", "mug": "mug", "becher": "mug", "roten würfel": "red cube"}
    assert {name: understand.in_english(name) for name in names} == names
    assert deepcopy(understand).in_english("ball") == "ball"


@given(st.text(max_size=60))
@settings(max_examples=25, deadline=None)
def test_whatever_is_said_the_answer_has_its_form(text: str) -> None:
    """Control characters, right-to-left and non-Latin text: names are words that were said, or nothing is."""
    understood = _UNDERSTAND(text)
    if isinstance(understood.answer, Request):
        for action in understood.answer.actions:
            assert {*action.target.name.split()} <= {*said_words(text)}
    assert 0 <= understood.confidence <= 1


_UNDERSTAND = Understanding("embedded")


@pytest.mark.parametrize(
    "text", ["\u202epush the ball", "推球", "ادفع الكرة", "push\x00 \x1b[31m", "🤖🤖🤖", "a " * 249]
)
def test_a_text_that_nobody_can_read_moves_nothing(t5: Path, text: str) -> None:
    policy = make_policy(t5)
    batch = observe(["push the ball", text])
    began = time.monotonic()
    plan = policy.predict_action_chunk(batch)
    assert time.monotonic() - began < 10
    held = (plan == batch["observation.state"][:, None]).all(dim=(1, 2)).tolist()
    assert held[1] or policy.responses[1] == "I will push the ball."
    assert held[0] is False
    assert len(policy.responses[1]) < 700


READER = TaskReader(("push red", "pull red"), names_objects=True)
BALL = Request((Action("push", Target("ball")),))


def test_replies() -> None:
    assert READER.read_answer(BALL, sure=False, before=None).reply == (
        "I am not sure what you mean. Did you mean: push the ball?"
    )
    assert READER.read_answer(NOT_UNDERSTOOD, sure=True, before=None).reply.startswith(
        "Should I push it, pull it"
    )
    unclear = Request((Action("pull", Target()),))
    assert READER.read_answer(unclear, sure=True, before=None).reply == "What should I pull?"
    assert READER.read_answer(Hold("forbidden"), sure=True, before=None).reply == "I hold still."
    assert "push or pull one thing" in READER.read_answer(Question("ability"), sure=True, before=None).reply
    assert READER.read_answer(Question("scene"), sure=True, before=None).wants_report


def test_it_is_what_was_spoken_of_before() -> None:
    it = Request((Action("pull", Target(reference="it")),))
    assert READER.read_answer(it, sure=True, before=None).reply == (
        "What do you mean by it? Name what I should pull."
    )
    instruction = READER.read_answer(it, sure=True, before=Target("mug"))
    assert (instruction.target, instruction.prompt) == (Target("mug"), "execute: pull red")


def test_of_several_wishes_the_first_is_carried_out_first_and_the_others_are_named() -> None:
    request = Request((BALL.actions[0], Action("slide-to-left", Target("", "red", side="left"))))
    instruction = READER.read_answer(request, sure=True, before=None)
    assert instruction.target == Target("ball")
    assert instruction.intention("ball") == (
        "I will push the ball, and then slide the left red one to the left."
    )


def test_tasks_that_nobody_has_to_understand() -> None:
    assert READER.read_task("push " + 500 * "a").reply == TOO_LONG
    assert READER.read_task(" ?").reply == NOTHING_ASKED
    assert READER.read_task("push the blue one") is None
    assert READER.read_task("pull mug").prompt == "execute: pull red"
    assert READER.read_task("push red").target == Target("cube", "red")


def test_without_understanding_words_go_where_the_paper_sends_them(t5: Path) -> None:
    policy = make_policy(t5, understanding="none", tasks=["push red"])
    policy.predict_action_chunk(observe(["push the ball", "dance wildly"]))
    assert policy.responses == [
        "I will push the ball.",
        "I cannot see a dance wildly. I see a red cube, a ball and a mug.",
    ]
    assert "understanding" not in policy.config.backbones
