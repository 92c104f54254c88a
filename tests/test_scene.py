# SPDX-License-Identifier: Apache-2.0
"""Words find things, or the robot says why not."""

from collections.abc import Mapping, Sequence
from typing import Any, cast

import pytest
import torch

from lerobot_owlxt5.backbones.detections import Candidates, Detector
from lerobot_owlxt5.backbones.taught import TaughtThings
from lerobot_owlxt5.commands.answer import Landmark, Relation, Target
from lerobot_owlxt5.commands.colours import basic_colour, split_colour
from lerobot_owlxt5.scene import Scene, Search, Thing

X = {"left": 0.2, "middle": 0.5, "right": 0.8}


class Table(Detector):
    """A detector whose scores are known: what is called so scores 0.9, cubes of other colours a little."""

    threshold = 0.3
    revision = None

    def __init__(self, things: dict[str, str]) -> None:
        self._things = things

    def can_read(self, names: Sequence[str]) -> bool:
        return len(" ".join(names)) < 60

    def propose(self, observation: Mapping[str, Any], names: Sequence[Sequence[str]]) -> Candidates:
        boxes = torch.tensor([[X[side] - 0.05, 0.4, X[side] + 0.05, 0.5] for side in self._things])
        scores = [[self._score(name, thing) for name in names[0]] for thing in self._things.values()]
        return Candidates(boxes.view(1, -1, 4), torch.tensor(scores).view(1, -1, len(names[0])))

    def _score(self, name: str, thing: str) -> float:
        colour, kind = split_colour(thing)
        asked, asked_kind = split_colour(name)
        if asked_kind != kind:
            return 0.1
        return 0.85 if not asked else 0.9 if asked == colour or not colour else 0.4


CUBES = {"left": "red cube", "middle": "green cube", "right": "blue cube"}
MIXED = {"left": "ball", "middle": "can", "right": "ball"}


def find(things: dict[str, str], target: Target, before: Target | None = None) -> tuple[str, str]:
    """Side of the thing that is meant, or "", and what is said."""
    german = {"roten würfel": "red cube", "dose": "can", "roten": "red"}
    scene = Scene(Table(things), {}, ["red", "green", "blue"], lambda name: german.get(name, name))
    found = scene.find(Search(target, before))
    side = "" if found.thing is None else min(X, key=lambda side: abs(X[side] - found.thing.place.x))
    return side, found.problem


@pytest.mark.parametrize(
    ("things", "target", "side"),
    [
        (CUBES, Target("cube", "red"), "left"),
        (CUBES, Target("cube", "crimson"), "left"),
        (CUBES, Target("crimson cube"), "left"),
        (CUBES, Target("", "blue"), "right"),
        (CUBES, Target("cube", side="middle"), "middle"),
        (CUBES, Target("", side="right"), "right"),
        (CUBES, Target("thing", order=("second", "left")), "middle"),
        (CUBES, Target("cube", relation=Relation("left of", (Landmark("", "green"),))), "left"),
        (MIXED, Target("can"), "middle"),
        (MIXED, Target("ball", relation=Relation("right of", (Landmark("can"),))), "right"),
        (MIXED, Target("object", relation=Relation("left of", (Landmark("can"),))), "left"),
        # German, where the model knows it.
        (CUBES, Target("würfel", "roten"), "left"),
        (CUBES, Target("", "roten"), "left"),
        (MIXED, Target("dose"), "middle"),
    ],
)
def test_what_is_meant(things: dict[str, str], target: Target, side: str) -> None:
    assert find(things, target) == (side, "")


SEES_CUBES = "I see a red cube, a green cube and a blue cube."


@pytest.mark.parametrize(
    ("things", "target", "sentence"),
    [
        (CUBES, Target("mug"), f"I cannot see a mug. {SEES_CUBES}"),
        # A green cube scores 0.4 as a cyan one, above the threshold, but more as a green one.
        (CUBES, Target("cube", "cyan"), f"I cannot see a cyan cube. {SEES_CUBES}"),
        (CUBES, Target("cyan cube"), f"I cannot see a cyan cube. {SEES_CUBES}"),
        (CUBES, Target("cube", "blurple"), f"I do not know the colour blurple. {SEES_CUBES}"),
        (
            CUBES,
            Target("cube"),
            "Which cube do you mean: the red cube, the green cube or the blue cube?",
        ),
        (MIXED, Target("ball"), "Which ball do you mean: the left one or the right one?"),
        (
            MIXED,
            Target("can", side="left"),
            "I see one can, and it is in the middle, not on the left: say it again without a side.",
        ),
        (
            MIXED,
            Target("can", relation=Relation("left of", (Landmark("mug"),))),
            "I cannot see a mug. I see a ball, a can and a ball.",
        ),
        (
            MIXED,
            Target("can", relation=Relation("left of", (Landmark("ball"),))),
            "Which ball do you mean: the left one or the right one?",
        ),
        (
            {"left": "can", "right": "ball"},
            Target("can", relation=Relation("right of", (Landmark("ball"),))),
            "I see a can, but none right of the ball.",
        ),
        (
            MIXED,
            Target("ball", order=("third", "left")),
            "I see only 2 of these, so none is the third from the left.",
        ),
        ({}, Target("mug"), "I cannot see a mug. I see nothing that I know."),
        (
            CUBES,
            Target("mug " * 20),
            f"I cannot look for a name as long as {'mug ' * 19 + 'mug'!r}: use fewer words.",
        ),
    ],
)
def test_what_is_said_where_it_is_not_clear(things: dict[str, str], target: Target, sentence: str) -> None:
    assert find(things, target) == ("", sentence)


def test_the_other_one() -> None:
    other = Target(reference="other")
    assert find({"left": "ball", "right": "can"}, other, Target("ball")) == ("right", "")
    assert find({"left": "ball"}, other, Target("ball")) == ("", "I see only one ball, and no other one.")
    assert find(MIXED, Target("ball", reference="other"), Target("ball", side="left")) == ("right", "")
    assert find(CUBES, other)[1].startswith("Which one do you mean")


def test_training_takes_the_best_and_a_report_needs_no_target() -> None:
    scene = Scene(Table(CUBES), {}, ["red", "green", "blue"], lambda name: name)
    assert scene.find(Search(Target("cube"), takes_best=True)).thing is not None
    assert scene.find(Search(None, wants_report=True)).problem == SEES_CUBES
    assert (scene.find(Search(None)).thing, scene.find(Search(None)).problem) == (None, "")


def test_what_the_robot_has_moved_keeps_its_name() -> None:
    there = Thing("mug", torch.tensor([0.155, 0.4, 0.255, 0.505]))
    for things, side, seen in (
        # It looks like a can from there.
        ({"left": "can", "right": "ball"}, "left", ["mug", "ball"]),
        # Somebody has taken it away.
        ({"middle": "can", "right": "ball"}, None, ["can", "ball"]),
    ):
        scene = Scene(Table(things), {}, [], lambda name: {"becher": "mug"}.get(name, name))
        scene.moved = (Thing("book", torch.zeros(4)), there)
        assert [thing.name for thing in scene.things] == seen
        for said in ("mug", "becher"):
            found = scene.find(Search(Target(said))).thing
            assert (found and found.place.x) == (side and pytest.approx(X[side]))
        assert scene.find(Search(Target("ball"))).thing is not None


def test_words_for_colours() -> None:
    assert basic_colour("dark red") == "red"
    assert basic_colour("greenish-blue") == "cyan"
    assert basic_colour("blurple") is None
    assert split_colour("light green jam jar") == ("light green", "jam jar")
    assert split_colour("greenish blue cube") == ("greenish blue", "cube")
    assert split_colour("mug") == ("", "mug")


class TaughtTable(Table):
    """One that was taught a trophy: a vase looks a little like it, and a can less."""

    taught = cast(TaughtThings, {"trophy": ()})

    def _score(self, name: str, thing: str) -> float:
        return {"vase": 0.5, "can": 0.4}[thing] if name == "trophy" else super()._score(name, thing)


def test_what_looks_most_like_a_taught_thing_is_listed_under_its_name() -> None:
    scene = Scene(TaughtTable({"left": "can", "right": "vase"}), {}, ["can", "vase"], str)
    assert [thing.name for thing in scene.things] == ["can", "trophy"]
    assert scene.report() == "I see a can and a trophy."
