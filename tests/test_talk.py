# SPDX-License-Identifier: Apache-2.0
"""Tests of the page to talk to the robot: a visitor's world, who waits, and what is shown."""

import asyncio
import io
import json
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from lerobot_owlxt5.backbones.appearance import Appearance
from lerobot_owlxt5.backbones.taught import TaughtThings
from lerobot_owlxt5.object_point import ObjectPoint
from lerobot_owlxt5.trained import find_policy
from nico_tabletop.nico_sim import NicoSim
from owlxt5_talk import show
from owlxt5_talk.policies import policy_maker
from owlxt5_talk.texts import ENGLISH, GERMAN, TEXTS, language_of
from owlxt5_talk.visitor import Visitor
from owlxt5_talk.visitors import Visitors
from owlxt5_talk.world import HEIGHT, WIDTH, Seen, Table, View, World
from talk_helpers import EchoConversation

BALL = Seen("ball", (0.4, 0.4, 0.6, 0.6))


def wait_until(true: Callable[[], Any], seconds: float = 60) -> None:
    """A busy machine is slow, not wrong."""
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.02)


class PlainWorld:
    """A world without pictures."""

    def __init__(self, table: Table) -> None:
        self.closed = False
        self.lay(table)

    def lay(self, table: Table) -> None:
        self.table, self.conversation = table, EchoConversation(robot=None)  # type: ignore[arg-type]
        self.hear, self.stop = self.conversation.hear, self.conversation.stop

    def tick(self) -> None:
        pass

    def draw_bystander(self) -> None:
        pass

    def view(self) -> View:
        lines = tuple((line.speaker, line.text) for line in self.conversation.lines)
        return View(lines=lines, busy=self.conversation.busy, table=self.table)

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def worlds() -> list[PlainWorld]:
    return []


@pytest.fixture
def visitor(worlds: list[PlainWorld]) -> Iterator[Visitor]:
    def make(table: Table) -> World:
        worlds.append(PlainWorld(table))
        return worlds[-1]  # type: ignore[return-value]

    somebody = Visitor(make, Table())
    yield somebody
    somebody.leave()
    somebody.join()


def test_a_visitor_talks_to_a_robot_in_a_world_of_their_own() -> None:
    visitor = Visitor(lambda table: World(EchoConversation, table, seed=1), Table())
    wait_until(lambda: visitor.view.bystander)
    before = visitor.view
    image = Image.open(io.BytesIO(before.eyes))
    assert image.size == (WIDTH, HEIGHT) and len(image.getcolors(WIDTH * HEIGHT) or ()) > 100
    assert len(before.things) == 3 and not before.busy
    visitor.say("hello")
    wait_until(lambda: visitor.view.lines and not visitor.view.busy)
    after = visitor.view
    assert after.lines == (("person", "hello"), ("robot", "I heard: hello"))
    assert after.eyes != before.eyes  # an arm has moved
    wait_until(lambda: visitor.view.bystander != before.bystander)
    time.sleep(0.3)
    still = visitor.view
    time.sleep(0.3)
    assert visitor.view is still  # nothing moves, so nothing is drawn
    visitor.lay(Table("clant", "free"))
    wait_until(lambda: visitor.view.table == Table("clant", "free"))
    assert visitor.view.lines == () and "cube" not in {thing.name for thing in before.things}
    visitor.leave()
    visitor.join()


def robot_of(world: World) -> NicoSim:
    assert isinstance(world.conversation, EchoConversation)
    assert isinstance(world.conversation.robot, NicoSim)
    return world.conversation.robot


def test_the_bystanders_picture_shows_a_head_that_moves() -> None:
    world = World(EchoConversation, Table(), seed=1)
    robot = robot_of(world)
    world.draw_bystander()
    before = world.view()
    robot.shake()
    views = []
    for _ in range(13):
        robot.express()
        world.draw_bystander()
        views.append(world.view())
    world.close()
    assert {view.eyes for view in views} == {before.eyes}
    assert len({view.bystander for view in views}) == 3  # left, right and in the middle
    assert views[-1].bystander == before.bystander


@pytest.mark.slow
def test_somebody_shows_a_movement() -> None:
    world = World(EchoConversation, Table(), seed=2)
    robot = robot_of(world)
    before = robot.simulation.object_positions()
    world.show()
    heard: list[str] = []
    for _ in range(100):
        world.tick()
        heard = [line.text for line in world.conversation.lines if line.speaker == "person"]
        if heard[-1:] == ["done"]:
            break
    after = robot.simulation.object_positions()
    world.close()
    assert heard == ["watch me", "done"]
    moved = np.abs(after - before).max(axis=1) > 0.03
    assert moved.sum() == 1


def test_stop_also_stops_what_was_about_to_be_shown() -> None:
    world = World(EchoConversation, Table(), seed=2)
    for interrupt in (world.stop, world.home, lambda: world.hear("hello")):
        world.show()
        interrupt()
        for _ in range(40):
            world.tick()
    world.close()
    assert "watch me" not in [line.text for line in world.conversation.lines]


def test_pointing_is_told_in_shares_of_the_picture() -> None:
    visitor = Visitor(lambda table: World(EchoConversation, table, seed=1), Table())
    for place in ("", "left", "0.1", "0.25 7", "0.1 0.2 0.3"):
        visitor.point(place)
    wait_until(lambda: visitor.view.lines)
    assert visitor.view.lines == (("robot", "You point at 0.25 1.00"),)
    visitor.leave()
    visitor.join()


def test_stop_comes_before_all_that_waits(visitor: Visitor, worlds: list[PlainWorld]) -> None:
    wait_until(lambda: worlds)
    visitor.say("go")
    wait_until(lambda: visitor.view.busy)
    for _ in range(3):
        visitor.say("go on")
    visitor.stop()
    wait_until(lambda: not visitor.view.busy)
    time.sleep(0.3)
    assert not visitor.view.busy and len(visitor.view.lines) < 8


def test_what_is_sent_is_bounded(visitor: Visitor) -> None:
    visitor.say("x" * 100_000)
    visitor.say("   ")
    wait_until(lambda: visitor.view.lines)
    assert len(visitor.view.lines[0][1]) == 501  # one more than the robot reads: it says so
    for number in range(1000):
        visitor.say(str(number))
    time.sleep(0.3)
    assert len(visitor.view.lines) < 200


def test_what_breaks_is_said_without_a_trace_and_a_new_word_mends_it(
    visitor: Visitor, worlds: list[PlainWorld]
) -> None:
    visitor.say("break")
    wait_until(lambda: visitor.view.failed)
    assert worlds[0].closed
    shown = show.status(visitor.view, TEXTS[ENGLISH])
    assert "new scene" in shown and "secret" not in shown
    visitor.lay(Table("household"))
    wait_until(lambda: visitor.view.table.objects == "household")
    assert not visitor.view.failed and len(worlds) == 2


def test_of_many_scenes_only_the_last_is_laid(visitor: Visitor, worlds: list[PlainWorld]) -> None:
    wait_until(lambda: worlds)
    laid: list[Table] = []
    lay = worlds[0].lay
    worlds[0].lay = lambda table: (laid.append(table), time.sleep(0.2), lay(table))  # type: ignore[method-assign]
    for _ in range(30):
        visitor.lay(Table("clant"))
    visitor.lay(Table("household", "free"))
    wait_until(lambda: visitor.view.table == Table("household", "free"))
    assert len(laid) < 4


def test_who_leaves_frees_the_world(visitor: Visitor, worlds: list[PlainWorld]) -> None:
    wait_until(lambda: worlds)
    visitor.leave()
    visitor.join()
    assert worlds[0].closed


def test_the_others_wait_until_somebody_leaves(worlds: list[PlainWorld]) -> None:
    visitors = Visitors(lambda: Visitor(PlainWorld, Table()), most=2)  # type: ignore[arg-type]
    first = visitors.enter("a")
    assert first and visitors.enter("a") is first
    assert visitors.enter("b") and visitors.enter("c") is None
    assert visitors.find("c") is None and visitors.find(None) is None
    visitors.leave("c")
    visitors.leave("a")
    first.join()
    assert visitors.enter("c") and visitors.find("a") is None
    for session in "bc":
        visitors.leave(session)


def test_who_is_away_for_long_makes_room(monkeypatch: pytest.MonkeyPatch) -> None:
    visitors = Visitors(lambda: Visitor(PlainWorld, Table()), most=1)  # type: ignore[arg-type]
    away = visitors.enter("a")
    assert away and visitors.enter("b") is None
    monkeypatch.setattr("owlxt5_talk.visitors.PATIENCE_SECONDS", 0.1)
    time.sleep(0.2)
    assert visitors.enter("b") and visitors.find("a") is None
    away.join()
    visitors.leave("b")


@pytest.mark.parametrize("table", [("/etc/passwd", "slots"), ("clant", "../free"), ("", "slots")])
def test_a_browser_chooses_nothing_but_what_is_there(table: tuple[str, str]) -> None:
    with pytest.raises(ValueError, match="none of"):
        Table(*table)


def test_names_are_escaped() -> None:
    evil = Seen('"><script>alert(1)</script>', (-1.0, 0.1, 0.5, 2.0))
    view = View(eyes=b"x", things=(evil,), looking_at=None)
    for shown in (show.things(view), show.status(replace(view, busy=True, looking_at=evil), TEXTS[ENGLISH])):
        assert "<script" not in shown and "&lt;script" in shown
    assert "left:0.0%;top:10.0%;width:50.0%;height:90.0%" in show.things(view)


def test_what_is_looked_at_has_a_frame_and_stands_there_once() -> None:
    cup = Seen("cup", (0.1, 0.4, 0.2, 0.6))
    shown = show.things(View(things=(cup, BALL), looking_at=replace(BALL, name="orange ball")))
    assert shown.count("<button") == 2 and "orange ball" in shown and 'data-thing="ball"' not in shown
    assert show.status(View(eyes=b"x", busy=True, looking_at=BALL), TEXTS[GERMAN]).count("ball") == 1


@pytest.mark.parametrize(
    ("header", "language"),
    [("de-DE,de;q=0.9,en;q=0.8", GERMAN), ("fr,de;q=0.5", GERMAN), ("en-US", ENGLISH), ("", ENGLISH)],
)
def test_the_page_speaks_a_browsers_language(header: str, language: str) -> None:
    assert language_of(header) == language


def test_browsers_are_told_to_load_nothing_from_elsewhere() -> None:
    starlette = pytest.importorskip("starlette.responses", reason="needs the extra `talk`")
    from owlxt5_talk.own_host import OwnHostOnly

    sent: list[Any] = []

    async def send(message: Any) -> None:
        sent.append(message)

    scope = {"type": "http", "method": "GET", "headers": []}
    asyncio.run(OwnHostOnly(starlette.PlainTextResponse("hello"))(scope, None, send))  # type: ignore[arg-type]
    headers = dict(sent[0]["headers"])
    assert headers[b"content-security-policy"].startswith(b"default-src 'self'")
    assert b"http" not in headers[b"content-security-policy"] and sent[1]["body"] == b"hello"


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--port=70000", "--port must lie between 1 and 65535; got 70000"),
        ("--port=null", "--port needs a value, not null"),
        ("--visitors=0", "--visitors must be above 0; got 0"),
        ("--objects=/etc/passwd", "'/etc/passwd' is none of clant, claeo, household"),
        ("--policy.path=nowhere/at/all", "--policy.path=nowhere/at/all is no folder with a policy"),
    ],
)
def test_a_mistake_ends_in_one_sentence(option: str, message: str, monkeypatch: pytest.MonkeyPatch) -> None:
    cli = pytest.importorskip("owlxt5_talk.cli", reason="needs the extra `talk`", exc_type=ImportError)
    monkeypatch.setattr(sys, "argv", ["owlxt5-talk", option])
    with pytest.raises(SystemExit) as end:
        cli.main()
    assert str(end.value).startswith(f"owlxt5-talk: {message}")


@pytest.mark.parametrize("planned", [False, True])
def test_who_gets_what_people_say_is_said(
    planned: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cli = pytest.importorskip("owlxt5_talk.cli", reason="needs the extra `talk`", exc_type=ImportError)
    pages: list[Any] = []

    def taken(page: Any, *_: Any) -> str:
        pages.append(page)
        raise OSError

    monkeypatch.setattr(cli, "open_page", taken)
    monkeypatch.setattr(cli, "make_visitors", lambda *_: Visitors(lambda: None, 1))  # type: ignore[arg-type]
    monkeypatch.setattr(sys, "argv", ["owlxt5-talk"])
    monkeypatch.setenv("OWLXT5_PLANNER_URL", "http://127.0.0.1:1/v1" if planned else "")
    monkeypatch.setenv("OWLXT5_PLANNER_MODEL", "small")
    monkeypatch.setenv("OWLXT5_PLANNER_KEY", "secret")
    with pytest.raises(SystemExit, match="choose another port"):
        cli.main()
    line = "The model small at 127.0.0.1:1 plans: what people say goes there too.\n"
    assert capsys.readouterr().out == (line if planned else "")
    heading = str(pages[0].config["components"])
    assert (TEXTS[ENGLISH].sends_words in heading) == planned


def test_a_wrong_planner_ends_in_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    cli = pytest.importorskip("owlxt5_talk.cli", reason="needs the extra `talk`", exc_type=ImportError)
    monkeypatch.setattr(sys, "argv", ["owlxt5-talk"])
    monkeypatch.setenv("OWLXT5_PLANNER_URL", "file:///etc/passwd")
    monkeypatch.setenv("OWLXT5_PLANNER_MODEL", "small")
    with pytest.raises(SystemExit, match="owlxt5-talk: the planner's address must be one such as"):
        cli.main()


def test_a_broken_file_of_taught_things_ends_in_one_sentence(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    cli = pytest.importorskip("owlxt5_talk.cli", reason="needs the extra `talk`", exc_type=ImportError)
    (tmp_path / "things").write_text("no tensors")
    monkeypatch.setattr(sys, "argv", ["owlxt5-talk", f"--taught={tmp_path / 'things'}"])
    with pytest.raises(SystemExit, match=r"^owlxt5-talk: \S*things is no file of taught things[^\n]*$"):
        cli.main()
    assert (tmp_path / "things").read_text() == "no tensors"


def test_who_comes_later_knows_what_others_have_taught(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(sys, "argv", ["owlxt5-talk"])
    make = policy_maker(tmp_path / "things")

    def taught() -> TaughtThings:
        visual = make()[0].visual
        assert isinstance(visual, ObjectPoint) and visual.detector.taught is not None
        return visual.detector.taught

    early = taught()
    early.add("trophy", Appearance(torch.ones(4), torch.ones(3)))
    assert [*early] == [*taught()] == ["trophy"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"detector": "ground_truth"}, "sees the simulator's boxes, which this robot has not"),
        ({"input_features": {}}, "sees no image, and this robot has observation.images.eyes alone"),
    ],
)
def test_a_policy_that_cannot_see_what_the_robot_sees_is_refused(
    change: dict[str, Any], message: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    config = json.loads((find_policy() / "config.json").read_text())
    (tmp_path / "config.json").write_text(json.dumps(config | change))
    monkeypatch.setattr(sys, "argv", ["owlxt5-talk", f"--policy.path={tmp_path}"])
    with pytest.raises(ValueError, match=message):
        policy_maker()


def test_the_motion_library_takes_no_option_that_would_be_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["talk", "--policy.path=motion_library", "--policy.device=cuda"])
    with pytest.raises(ValueError, match="takes no --device=cuda here"):
        policy_maker()


def test_each_visitor_has_a_policy_of_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["owlxt5-talk"])
    make = policy_maker()
    (one, processors), (two, others) = make(), make()
    assert one is not two and processors is not others
    assert one.rest_pose is two.rest_pose  # the weights are there once
    one.responses = ["I will push the ball."]
    assert two.responses == []
