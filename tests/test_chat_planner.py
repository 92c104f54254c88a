# SPDX-License-Identifier: Apache-2.0
"""The planner that asks a language model on a server: what it answers is never trusted."""

import logging
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from chat_stand_in import GARBAGE, ChatStandIn, completion
from lerobot_owlxt5.backbones.understanding import Understood
from lerobot_owlxt5.commands.answer import Action, Hold, Question, Request, Target
from lerobot_owlxt5.commands.replies import HOLDS
from lerobot_owlxt5.conversation import Line
from lerobot_owlxt5.conversation import questions as asked
from lerobot_owlxt5.conversation.chat_planner import NOT_REACHED, WHETHER_HOME, ChatPlanner, planner_of
from lerobot_owlxt5.conversation.chat_server import ChatServer
from lerobot_owlxt5.conversation.rules import plan_by_rules
from lerobot_owlxt5.conversation.steps import Ask, Do, Open, Remark, Say, Situation, Step, Stop
from lerobot_owlxt5.conversation.tools import TOOLS, UNUSABLE
from stage import Scene, Turn, make_stage

KEY = "aKeyThatNobodyMaySee"
MUG = Action("push", Target("mug"))


def sure_of(*verbs: str | None, thing: str = "whatever") -> Understood:
    return Understood(Request(tuple(Action(verb, Target(thing)) for verb in verbs)), 1.0, True)


SURE = Understood(Request((MUG,)), 1.0, True)


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[ChatStandIn]:
    monkeypatch.setenv("no_proxy", "127.0.0.1")
    stand_in = ChatStandIn()
    yield stand_in
    stand_in.close()


@pytest.fixture
def planner(server: ChatStandIn) -> ChatPlanner:
    return ChatPlanner(ChatServer(server.url, "small", KEY, timeout=5))


def situation(understood: Understood = SURE, *before: Line) -> Situation:
    return Situation(lambda _: understood, seen=("can", "mug", "red cube"), before=before)


def test_a_call_moves_a_thing_and_the_server_gets_what_it_needs(
    server: ChatStandIn, planner: ChatPlanner
) -> None:
    server.answer = completion(("move", {"verb": "pull", "object": "the mug", "colour": None}))
    before = Line("robot", "I pushed the can.")
    step = planner("the mug should come nearer", situation(sure_of("pull"), before))
    assert step == Do(Request((Action("pull", Target("mug")),)))
    [(path, key, content)] = server.requests
    assert path == "/v1/chat/completions" and key == f"Bearer {KEY}"
    assert content["model"] == "small" and content["tools"] == TOOLS
    system, user = (message["content"] for message in content["messages"])
    assert "a can, a mug and a red cube" in system
    assert user == "robot: I pushed the can.\nperson: the mug should come nearer"


@pytest.mark.parametrize(
    ("calls", "step"),
    [
        (
            [
                ("move", {"verb": "push", "object": "mug"}),
                ("move", {"verb": "slide-to-left", "object": "can"}),
            ],
            Do(Request((MUG, Action("slide-to-left", Target("can"))))),
        ),
        (
            [("move", {"verb": "push", "object": "red cube"})],
            Do(Request((Action("push", Target("cube", "red")),))),
        ),
        (
            [("move", {"verb": "push", "object": "cube", "colour": "red", "side": "left"})],
            Do(Request((Action("push", Target("cube", "red", side="left")),))),
        ),
        ([("move", {"verb": "push", "object": "ball"})], Do(Request((Action("push", Target("ball")),)))),
        ([("stop", {})], Stop()),
        ([("move", {"verb": "push", "object": "mug"}), ("stop", {})], Stop()),
        ([("home", "")], Say(WHETHER_HOME)),
        ([("answer", {"kind": "where", "object": "mug"})], Ask(asked.Question("where", "mug"))),
        ([("answer", {"kind": "did"})], Ask(asked.Question("did"))),
        ([("say", {"text": "Which  one?"})], Say("My planner says: Which one?")),
    ],
)
def test_each_tool_is_a_step(
    server: ChatStandIn, planner: ChatPlanner, calls: list[tuple[str, Any]], step: Step
) -> None:
    server.answer = completion(*calls)
    verbs = [action.verb for action in step.request.actions] if isinstance(step, Do) else ["push"]
    assert planner("put the left balls and the mug somewhere else", situation(sure_of(*verbs))) == step


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"object": "vase"}, "I neither see nor heard of a vase. What should I push?"),
        ({"object": "mug can"}, "I neither see nor heard of a mug can."),
        ({"object": "and"}, "I neither see nor heard of"),
        ({"object": "push"}, "I neither see nor heard of a push."),
        ({"object": "mug", "colour": "blue"}, "I neither see nor heard of something blue."),
        ({"object": "red cube", "colour": "green"}, "I neither see nor heard of a green red cube."),
        ({"object": "cube", "side": "right"}, "You did not say which one. What should I push?"),
        ({"object": "thing"}, "What should I push?"),
        ({}, "What should I push?"),
    ],
)
def test_what_was_neither_said_nor_seen_is_asked(
    server: ChatStandIn, planner: ChatPlanner, arguments: dict[str, str], says: str
) -> None:
    server.answer = completion(("move", {"verb": "push"} | arguments))
    step = planner("push and push the green one", situation())
    assert isinstance(step, Say) and step.text.startswith(says)
    assert step.asks == Open("what", Request((Action("push", Target()),)))


def test_what_the_person_said_before_was_said_and_what_the_robot_said_was_not(
    server: ChatStandIn, planner: ChatPlanner
) -> None:
    server.answer = completion(("move", {"verb": "push", "object": "ball"}))
    it = SURE._replace(answer=Request((Action("push", Target(reference="it")),)))
    assert isinstance(planner("now push it", situation(it, Line("person", "where is the ball?"))), Do)
    assert isinstance(planner("now push it", situation(it, Line("robot", "I see a ball."))), Say)


@pytest.mark.parametrize("answer", GARBAGE, ids=range(len(GARBAGE)))
def test_garbage_moves_nothing(server: ChatStandIn, planner: ChatPlanner, answer: bytes) -> None:
    server.answer = answer
    step = planner("push the mug", situation())
    assert isinstance(step, Say) and step.asks is None and step.text.startswith("I hold still, because")
    assert step.text == UNUSABLE or "at most 3" in step.text


def test_a_huge_answer_is_not_read_to_its_end(server: ChatStandIn, planner: ChatPlanner) -> None:
    server.answer = b"{" * 50_000_000
    assert planner("push the mug", situation()) == Say(UNUSABLE)


@pytest.mark.parametrize("status", [302, 307, 401, 500])
def test_an_error_is_said_and_the_rules_take_over(
    server: ChatStandIn, planner: ChatPlanner, status: int, caplog: pytest.LogCaptureFixture
) -> None:
    server.answer, server.status = completion(("move", {"verb": "pull", "object": "can"})), status
    with caplog.at_level(logging.WARNING):
        step = planner("push the mug", situation())
    assert step == Remark(NOT_REACHED, Do(Request((MUG,)), "push the mug"))
    assert len(server.requests) == 1  # no redirect gets the key
    assert str(status) in caplog.text and KEY not in caplog.text and "push" not in caplog.text


@pytest.mark.parametrize("drips", [0.05, 5.0])
def test_who_is_slow_is_not_waited_for(server: ChatStandIn, planner: ChatPlanner, drips: float) -> None:
    server.answer, server.drips = completion(("move", {"verb": "pull", "object": "can"})), drips
    slow = ChatPlanner(replace(planner.server, timeout=0.3))
    begun = time.monotonic()
    step = slow("push the mug", situation())
    assert step == Remark(NOT_REACHED, Do(Request((MUG,)), "push the mug"))
    assert 0.2 < time.monotonic() - begun < 4


def test_who_is_not_there_is_not_needed(server: ChatStandIn, planner: ChatPlanner) -> None:
    server.close()
    assert planner("push the mug", situation()) == Remark(NOT_REACHED, Do(Request((MUG,)), "push the mug"))
    held = Understood(Hold("beyond"), 1.0, True)
    assert planner("sing", situation(held)) == Remark(NOT_REACHED, Say(HOLDS["beyond"]))


@pytest.mark.parametrize("reason", ["forbidden", "conditional", "not_now"])
def test_what_must_not_be_done_is_not_even_asked_about(
    server: ChatStandIn, planner: ChatPlanner, reason: str
) -> None:
    server.answer = completion(("move", {"verb": "push", "object": "mug"}))
    held = Understood(Hold(reason), 0.1, False)
    assert planner("do not push the mug", situation(held)) == Say(HOLDS[reason])
    assert server.requests == []


@pytest.mark.parametrize(
    "understood",
    [
        sure_of("push", "pull")._replace(sure=False),
        sure_of("push"),
        sure_of("pull", "push"),
        sure_of("push", None),
        sure_of("push", "pull", thing="can"),
        sure_of("push", "pull", thing="cube"),
        Understood(Request((Action("push", Target(side="left")), Action("pull", Target("can")))), 1.0, True),
        Understood(Hold("beyond"), 1.0, True),
        Understood(Hold("not_an_action"), 1.0, True),
        Understood(Question("scene"), 1.0, True),
    ],
)
def test_where_the_understanding_is_not_sure_the_person_says_whether(
    server: ChatStandIn, planner: ChatPlanner, understood: Understood
) -> None:
    calls = [("move", {"verb": "push", "object": "mug"}), ("move", {"verb": "pull", "object": "can"})]
    server.answer = completion(*calls)
    step = planner("make room", situation(understood))
    request = Request((MUG, Action("pull", Target("can"))))
    assert isinstance(step, Say) and step.asks == Open("whether", request)
    assert step.text.endswith("Did you mean: push the mug, and then pull the can?")
    assert planner("yes", replace(situation(understood), open=step.asks)) == Do(request)


@pytest.mark.parametrize(
    "words", ["stop", "home", "again", "no, the mug", "", "!", "x" * 501, "translate: a"]
)
def test_what_the_rules_know_by_heart_needs_no_server(
    server: ChatStandIn, planner: ChatPlanner, words: str
) -> None:
    known = replace(situation(), last=Request((Action("pull", Target("can")),)))
    assert planner(words, known) == plan_by_rules(words, known)
    assert server.requests == []


def test_without_an_address_there_is_no_planner() -> None:
    named = {"OWLXT5_PLANNER_MODEL": "small", "OWLXT5_PLANNER_KEY": KEY}
    assert planner_of({}) is None and planner_of(named) is None
    planner = planner_of(named | {"OWLXT5_PLANNER_URL": "https://example.org/v1"})
    assert planner and planner.server == ChatServer("https://example.org/v1", "small", KEY)
    assert KEY not in repr(planner.server) and planner.server.host == "example.org"


@pytest.mark.parametrize(
    ("url", "model", "key", "message"),
    [
        ("http://127.0.0.1:8080/v1", "", "", "OWLXT5_PLANNER_MODEL is not"),
        ("file:///etc/passwd", "small", "", "address"),
        ("127.0.0.1:8080", "small", "", "address"),
        ("http://[::1", "small", "", "address"),
        ("http://somebody:secret@example.org", "small", "", "address"),
        ("https://example.org/v1", "small", "secret\nHost: other", "key"),
    ],
)
def test_a_wrong_setting_is_one_sentence(url: str, model: str, key: str, message: str) -> None:
    names = ("OWLXT5_PLANNER_URL", "OWLXT5_PLANNER_MODEL", "OWLXT5_PLANNER_KEY")
    with pytest.raises(ValueError, match=message) as error:
        planner_of(dict(zip(names, (url, model, key), strict=True)))
    assert "secret" not in str(error.value) and "\n" not in str(error.value)


def test_a_conversation_takes_it(server: ChatStandIn, planner: ChatPlanner) -> None:
    stage = make_stage()
    robot = stage.set(Scene("claeo", ["mug", "ball", "can"]), planner)
    stage.conversation.look()
    assert [thing.name for thing in stage.conversation.things] == ["mug", "ball", "can"]
    assert stage.conversation.lines == [] and robot.looks == 1
    server.answer = completion(("answer", {"kind": "where", "object": "ball"}))
    assert stage.say(Turn("and that round one?")) == (
        ["The ball is in the middle, farther from me than all else."],
        "nothing",
    )
    server.answer = completion(("move", {"verb": "push", "object": "vase"}))
    assert stage.say(Turn("and now?")) == (
        ["I neither see nor heard of a vase. What should I push?"],
        "nothing",
    )
    server.status = 500
    assert stage.say(Turn("what do you see?"))[0] == [NOT_REACHED, "I see a mug, a ball and a can."]
    assert robot.actions == 0
    robot.disconnect()


@pytest.mark.slow
def test_what_it_plans_is_done_once_the_person_agrees(server: ChatStandIn, planner: ChatPlanner) -> None:
    stage = make_stage()
    robot = stage.set(Scene("claeo", ["mug", "ball", "can"]), planner)
    stage.conversation.look()
    calls = [
        ("move", {"verb": "push", "object": "mug"}),
        ("move", {"verb": "slide-to-right", "object": "can"}),
    ]
    server.answer = completion(*calls)
    asks = "I am not sure what you mean. Did you mean: push the mug, and then slide the can to the right?"
    assert stage.say(Turn("make some more room for the ball, it is your choice how")) == ([asks], "nothing")
    answers, moved = stage.say(Turn("yes"))
    assert answers[0] == "I will push the mug, and then slide the can to the right."
    assert moved == "mug away, can right"
    assert len(server.requests) == 1
    robot.disconnect()
