# SPDX-License-Identifier: Apache-2.0
"""Conversations as plays (tests/plays), on the simulated robot, with a policy that needs no training."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch
from lerobot.lerobot_types import RobotAction

from lerobot_owlxt5.backbones.understanding import Understood
from lerobot_owlxt5.commands.answer import REASONS, Action, Hold, Request, Target
from lerobot_owlxt5.commands.replies import HOLDS
from lerobot_owlxt5.conversation.conversation import ONCE_MORE
from lerobot_owlxt5.conversation.expressions import Expressions
from lerobot_owlxt5.conversation.lines import MOST_LINES
from lerobot_owlxt5.conversation.phrases import added, corrected
from lerobot_owlxt5.conversation.questions import Question, read_question
from lerobot_owlxt5.conversation.rules import plan_by_rules
from lerobot_owlxt5.conversation.showing import WATCHING
from lerobot_owlxt5.conversation.steps import Do, GoHome, Open, Remark, Say, Situation, Stop
from lerobot_owlxt5.scene import Thing
from nico_tabletop.config_nico_sim import NicoSimConfig
from stage import Play, Scene, Stage, Turn, Watched, make_stage, read_play

PLAYS = [read_play(path) for path in sorted((Path(__file__).parent / "plays").glob("*.txt"))]
THREE = Scene("claeo", ["mug", "ball", "can"])


@pytest.fixture(scope="module")
def stage() -> Stage:
    return make_stage()


@pytest.fixture
def three(stage: Stage) -> Iterator[Stage]:
    robot = stage.set(THREE)
    yield stage
    robot.disconnect()


@pytest.mark.slow
@pytest.mark.parametrize("play", [pytest.param(play, id=play.name) for play in PLAYS])
def test_a_play_goes_as_it_is_written(stage: Stage, play: Play) -> None:
    for scene in play.scenes:
        robot = stage.set(scene)
        for turn in scene.turns:
            assert (turn.says, *stage.say(turn)) == (turn.says, turn.answers, turn.moved)
        # An image takes longer than all else: it is drawn for a look alone.
        assert robot.looks <= 4 * len(scene.turns)
        # Who looks and finds nothing sends the arms where they are, once.
        assert play.moves or robot.actions <= len(scene.turns) / 2
        robot.disconnect()


def test_the_documented_transcript_is_a_play() -> None:
    root = Path(__file__).parents[1]
    talk = (root / "docs" / "talk.md").read_text("utf-8")
    said = [line[7:] for line in talk.splitlines() if line.startswith(("you:   ", "robot: "))]
    play = next(play for play in PLAYS if play.name == "talk")
    turns = [turn for scene in play.scenes for turn in scene.turns]
    assert said == [text for turn in turns for text in (turn.says, *turn.answers)]
    assert len(turns) >= 20


def test_the_plays_are_long_enough() -> None:
    assert sum(play.turns for play in PLAYS) >= 60
    assert sum(len(play.scenes) for play in PLAYS) >= 5


@pytest.mark.slow
def test_what_did_not_move_is_tried_once_more(three: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    def slack(action: RobotAction) -> RobotAction:
        return action

    monkeypatch.setattr(three.robot, "send_action", slack)
    answers, moved = three.say(Turn("push the mug"))
    tried = "I tried to push the mug, but it did not move."
    assert answers == ["I will push the mug.", tried, ONCE_MORE, "I will push the mug.", tried]
    assert moved == "nothing"
    assert three.say(Turn("did it work?"))[0] == [f"No. {tried}"]


@pytest.mark.slow
def test_stop_holds_at_once_where_the_arms_are(three: Stage) -> None:
    three.say(Turn("push the mug", wait=25))
    talk = three.conversation
    assert talk.busy and talk.looking_at is not None and talk.looking_at.name == "mug"
    before = three.simulation.joint_positions_deg
    talk.stop()
    assert not talk.busy
    actions = three.robot.actions
    for _ in range(20):
        talk.tick()
    assert three.robot.actions == actions
    assert abs(three.simulation.joint_positions_deg - before).max() < 5


def test_a_question_says_what_it_speaks_of(three: Stage) -> None:
    talk = three.conversation
    assert (talk.things, talk.looking_at, talk.busy) == ([], None, False)
    talk.hear("where is the ball?")
    assert talk.looking_at is not None and talk.looking_at.name == "ball"
    assert [thing.name for thing in talk.things] == ["mug", "ball", "can"]
    assert three.robot.looks == 1 and three.robot.actions == 0


@pytest.mark.parametrize(
    ("words", "expressed"),
    [
        ("where is the mug?", ["look left"]),
        ("is there a can?", ["look right", "nod"]),
        ("fly to the moon", ["shake"]),
        ("push the mug", ["look left", "nod"]),
    ],
)
def test_the_head_says_it_too(three: Stage, words: str, expressed: list[str]) -> None:
    three.say(Turn(words, wait=1))
    assert three.robot.expressed == expressed
    for _ in range(20):
        three.conversation.tick()
    assert three.robot.expressed == expressed
    yaw, _ = three.simulation.head_deg  # to the left
    assert np.sign(yaw) == ("look left" in expressed) - ("look right" in expressed)


def test_who_spoke_of_a_thing_looks_ahead_again(three: Stage) -> None:
    for words in ("where is the mug?", "what do you see?"):
        three.conversation.hear(words)
    assert three.robot.expressed == ["look left", "look ahead"]


@pytest.mark.parametrize(
    ("text", "expressed"),
    [
        ("Yes. I pushed the mug.", ["nod"]),
        ("I will push the mug.", ["nod"]),
        ("I move my arms back first.", ["nod"]),
        (WATCHING, ["nod"]),
        ("No, I see no vase. I see a mug.", ["shake"]),
        ("I cannot see a vase. I see a mug.", ["shake"]),
        (HOLDS["beyond"], ["shake"]),
        (HOLDS["forbidden"], []),  # it does as it was told
        (HOLDS["not_now"], []),
        ("I pushed the mug.", []),
        ("Nothing moved.", []),
        ("Should I push the mug?", []),
    ],
)
def test_what_is_said_makes_it_nod_or_shake_its_head(text: str, expressed: list[str]) -> None:
    robot = Watched(NicoSimConfig())
    Expressions(robot).say(text)
    assert robot.expressed == expressed


def test_a_robot_that_expresses_nothing_is_used_as_before() -> None:
    expressions = Expressions(object())  # type: ignore[arg-type]
    expressions.look_at(Thing("mug", torch.tensor([0.1, 0.1, 0.2, 0.2])))
    expressions.say("Yes.")
    expressions.go_on()


def test_only_the_last_lines_are_kept(three: Stage) -> None:
    talk = three.conversation
    for _ in range(MOST_LINES):
        talk.hear("stop")
    assert len(talk.lines) == MOST_LINES and talk.lines[0].speaker == "person"
    talk.hear("x" * 10_000)
    assert len(talk.lines[-2].text) == 500 and "characters" in talk.lines[-1].text


CUBE, MUG = Action("push", Target("cube")), Action("push", Target("mug"))
OPEN = {
    "whether": Open("whether", Request((MUG,))),
    "which": Open("which", Request((CUBE,))),
    "how": Open("how", Request((Action(None, Target("mug")),))),
    "what": Open("what", Request((Action("pull", Target()),))),
    "stopped": Open("stopped", Request((MUG,))),
}


TEMPTING = (
    *(
        "the left one",
        "the red one",
        "no, the mug",
        "i meant the mug",
        "mug",
        "pull it",
        "pull",
        "to the left",
    ),
    *("pull", "not the mug", "no mug", "no, no mug", "yes but not now", "again and again", "do not stop"),
)


@pytest.mark.parametrize("reason", [reason for reason in REASONS if reason != "not_an_action"])
@pytest.mark.parametrize("asked", [None, *OPEN])
def test_no_rule_moves_what_is_held_back(reason: str, asked: str | None) -> None:
    held = Understood(Hold(reason), 1.0, True)
    last, seen = Request((CUBE,)), ("mug", "red cube")
    situation = Situation(lambda _: held, OPEN[asked] if asked else None, last, seen)
    for words in TEMPTING:
        assert isinstance(plan_by_rules(words, situation), Say), words


@pytest.mark.parametrize(
    ("words", "asked", "step"),
    [
        ("Yes, please!", "whether", Do(Request((MUG,)))),
        ("nein", "whether", Say("I hold still.")),
        ("the red one", "which", Do(Request((Action("push", Target("cube", colour="red")),)))),
        ("den linken", "which", Do(Request((Action("push", Target("cube", side="left")),)))),
        ("the mug", "which", Do(Request((MUG,)))),
        ("pull it", "how", Do(Request((Action("pull", Target("mug")),)))),
        ("to the left, please", "how", Do(Request((Action("slide-to-left", Target("mug")),)))),
        ("no, the mug", None, Do(Request((MUG,)))),
        ("thanks", None, Remark("You are welcome.")),
        ("thanks, you're sweet", None, Say("You are welcome.")),
        ("okay, enough of that", None, Say("All right.")),
        ("OK, carry on", "stopped", Do(Request((MUG,)))),
        ("mach weiter, bitte", "stopped", Do(Request((MUG,)))),
        ("Nochmal bitte", None, Do(Request((CUBE,)))),
        ("and now undo that", None, Do(Request((Action("pull", Target(reference="it")),)))),
        ("Stopp!", None, Stop()),
        ("geh nach Hause", None, GoHome()),
    ],
)
def test_few_words_are_enough(words: str, asked: str | None, step: object) -> None:
    nothing = Understood(Hold("not_an_action"), 1.0, True)
    situation = Situation(
        lambda _: nothing, OPEN[asked] if asked else None, Request((CUBE,)), ("mug", "red cube")
    )
    assert plan_by_rules(words, situation) == step


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("hmm, not the bottle, the can", "the can"),
        ("nicht die Flasche, sondern die Dose", "die Dose"),
        ("not the bottle but the can", "the can"),
        ("no, the mug", "the mug"),
        ("not the bottle", ""),
        ("do not push the mug, please", ""),
        ("no mug", ""),
    ],
)
def test_what_is_meant_in_place_of_what_was_said(words: str, meant: str) -> None:
    assert corrected(words) == meant


@pytest.mark.parametrize(
    ("words", "question"),
    [
        ("Could you tell me where the wine bottle is, please?", Question("where", "wine bottle")),
        ("where are my cubes?", Question("where", "cubes")),
        ("How many wine bottles do you see?", Question("count", "wine bottle")),
        ("wie viele Sachen liegen auf dem Tisch?", Question("count")),
        ("which colour does the mug have?", Question("colour", "mug")),
        ("Ist die Tasse blau?", Question("is", "tasse", "blau")),
        ("what stands in front of the can?", Question("beside", "can", "before")),
        ("was liegt rechts?", Question("side", detail="right")),
        ("is the mug to the left of the can?", Question("related", "mug", "left of", "can")),
        ("Steht die Tasse neben der Dose?", Question("related", "tasse", "next to", "dose")),
        ("is the can on the left?", Question("is", "can", "left")),
        ("Steht die Tasse rechts?", Question("is", "tasse", "right")),
        ("are you sure that worked?", Question("worked")),
        ("is it red?", Question("is", "it", "red")),
        ("What have you got there?", Question("scene")),
    ],
)
def test_which_question_it_is(words: str, question: Question) -> None:
    assert read_question("scene", words) == question


@pytest.mark.parametrize(
    ("words", "rest"),
    [
        ("and the can too", "the can"),
        ("the left one as well.", "the left one"),
        ("auch den Ball", "den Ball"),
        ("do the same with the can", "the can"),
        # A question, or the rest of one.
        ("the can too?", ""),
        ("and the can", ""),
        # These say what to do themselves.
        ("push the can too", ""),
        ("don't push the can too", ""),
    ],
)
def test_what_is_to_be_done_with_another_thing_too(words: str, rest: str) -> None:
    assert added(words) == rest
