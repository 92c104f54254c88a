# SPDX-License-Identifier: Apache-2.0
"""What is shown and named is known again, and kept in a file."""

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from lerobot_owlxt5.backbones.appearance import ALIKE, Appearance, Patches, as_score, colours_in
from lerobot_owlxt5.backbones.taught import MOST_LOOKS, TaughtThings
from lerobot_owlxt5.backbones.understanding import Understood
from lerobot_owlxt5.commands.answer import Hold, Target
from lerobot_owlxt5.conversation.rules import plan_by_rules
from lerobot_owlxt5.conversation.steps import Forget, Say, Situation, Step, Teach
from lerobot_owlxt5.conversation.teaching import MOST_THINGS, NOT_WRITTEN, forget, teach
from lerobot_owlxt5.scene import Scene

LOOK = Appearance(torch.tensor([1.0, 0.0]), torch.tensor([0.0, 1.0]))


def image(*spots: tuple[float, tuple[float, float, float]]) -> torch.Tensor:
    """A grey table with a coloured square around each x."""
    pixels = torch.full((3, 60, 80), 0.5)
    for x, colour in spots:
        pixels[:, 24:36, round(x * 80) - 8 : round(x * 80) + 8] = torch.tensor(colour)[:, None, None]
    return pixels


def box(x: float) -> list[float]:
    return [x - 0.1, 0.4, x + 0.1, 0.6]


RED, BLUE = (0.9, 0.1, 0.1), (0.1, 0.1, 0.9)
BOXES = torch.tensor([box(0.2), box(0.8)])
SAME_KIND = torch.tensor([[1.0, 0.0], [1.0, 0.0]])


def test_of_two_things_of_a_kind_the_one_with_the_colours_is_known_again() -> None:
    shown = Patches(image((0.2, RED), (0.8, BLUE)), BOXES, SAME_KIND).appearance(torch.tensor(box(0.21)))
    found = Patches(image((0.2, BLUE), (0.8, RED)), BOXES, SAME_KIND).likeness([shown])
    assert found[1] == pytest.approx(2)
    assert found[0] < ALIKE < found[1]


def test_the_best_look_counts() -> None:
    looks = [Patches(image((0.2, colour)), BOXES, SAME_KIND).appearance(BOXES[0]) for colour in (RED, BLUE)]
    assert Patches(image((0.2, BLUE)), BOXES, SAME_KIND).likeness(looks)[0] == pytest.approx(2)


def test_a_box_outside_the_image_has_no_colours() -> None:
    assert not colours_in(image(), torch.tensor([1.2, 0.4, 1.4, 0.6])).any()


def test_a_score_rises_with_likeness_and_meets_the_threshold() -> None:
    found = torch.linspace(0, 2, 41)
    scores = as_score(found, 0.27)
    assert (scores.diff() > 0).all()
    assert scores[0] == 0
    assert scores[-1] == pytest.approx(1)
    torch.testing.assert_close(scores >= 0.27, found >= ALIKE)


def test_the_last_looks_are_kept_in_the_file(tmp_path: Path) -> None:
    file = tmp_path / "new" / "taught.safetensors"
    things = TaughtThings("eyes", file)
    for number in range(MOST_LOOKS + 2):
        things.add("padlock", LOOK._replace(embedding=torch.tensor([0.0, float(number)])))
    things.add("rubber duck", LOOK)
    again = TaughtThings("eyes", file)
    assert [*again] == ["padlock", "rubber duck"]
    assert [look.embedding[1].item() for look in again["padlock"]] == [2, 3, 4, 5, 6]
    again.remove("padlock")
    assert [*TaughtThings("eyes", file)] == ["rubber duck"]
    assert [path.name for path in file.parent.iterdir()] == [file.name]


def test_what_others_taught_or_forgot_meanwhile_counts(tmp_path: Path) -> None:
    file = tmp_path / "taught.safetensors"
    mine, theirs = TaughtThings("eyes", file), TaughtThings("eyes", file)
    mine.add("padlock", LOOK)
    theirs.add("trophy", LOOK)
    assert {*TaughtThings("eyes", file)} == {"padlock", "trophy"}
    theirs.remove("padlock")
    mine.add("teapot", LOOK)
    assert {*mine} == {*TaughtThings("eyes", file)} == {"trophy", "teapot"}


@pytest.mark.parametrize("content", [b"", b"not a file of tensors", None, "other detector"])
def test_a_file_that_cannot_be_used_is_said_and_stays(tmp_path: Path, content: bytes | str | None) -> None:
    file = tmp_path / "taught.safetensors"
    if isinstance(content, bytes):
        file.write_bytes(content)
    elif content is None:
        save_file({"weights": torch.zeros(2)}, file)
    else:
        TaughtThings(content, file).add("padlock", LOOK)
    before = file.read_bytes()
    with pytest.raises(ValueError, match=r"^\S*taught\.safetensors [^\n]*another file$"):
        TaughtThings("eyes", file)
    assert file.read_bytes() == before


def test_a_file_that_breaks_later_loses_nothing(tmp_path: Path) -> None:
    file = tmp_path / "taught.safetensors"
    things = TaughtThings("eyes", file)
    file.write_bytes(b"broken by somebody")
    with pytest.raises(ValueError, match="broken"):
        things.add("padlock", LOOK)
    assert file.read_bytes() == b"broken by somebody"
    assert "padlock" in things


def plan(words: str) -> Step:
    understood = Understood(Hold("not_an_action"), 1.0, True)
    return plan_by_rules(
        words, Situation(lambda _: understood, seen=("ball", "toy car", "ball"), taught=("padlock",))
    )


@pytest.mark.parametrize(
    ("words", "step"),
    [
        ("This is a padlock.", Teach("padlock")),
        ("that's my rubber duck", Teach("rubber duck")),
        ("No, that is a trophy!", Teach("trophy")),
        ("The toy car is a trophy", Teach("trophy", Target("toy car"))),
        ("the left one is called Bobby", Teach("bobby", Target(side="left"))),
        ("the left ball is a hamburger", Teach("hamburger", Target("ball", side="left"))),
        ("Das ist ein Schloss.", Teach("schloss")),
        ("das heißt Pokal", Teach("pokal")),
        ("forget the padlock", Forget("padlock")),
        ("Vergiss das Padlock", Forget("padlock")),
    ],
)
def test_a_lesson(words: str, step: Step) -> None:
    assert plan(words) == step


@pytest.mark.parametrize(
    "words",
    [
        "this is great",
        "this is the ball",
        "is this a padlock?",
        "this is a mug that you must not push",
        "the mug is a present",  # there is no mug
        "it is a pity",
        "forget the ball",
        "forget it",
        "this is a 7",
        f"this is a {'a' * 31}",
    ],
)
def test_no_lesson(words: str) -> None:
    assert isinstance(plan(words), Say)


def test_rows_of_colours_do_not_depend_on_the_size() -> None:
    small, large = (
        torch.from_numpy(np.kron(np.asarray(image((0.5, RED))), np.ones((1, size, size), np.float32)))
        for size in (1, 3)
    )
    torch.testing.assert_close(*(colours_in(each, torch.tensor(box(0.5))) for each in (small, large)))


def test_a_part_of_a_thing_is_no_second_one() -> None:
    """The patch at a thing's edge proposes its right half, and looks nearly the same."""
    boxes = torch.tensor([box(0.2), [0.2, 0.42, 0.29, 0.58], box(0.8)])
    kinds = torch.tensor([[1.0, 0.0], [0.98, 0.2], [0.0, 1.0]])
    seen = Patches(image((0.2, RED), (0.8, BLUE)), boxes, kinds)
    assert seen.likeness([seen.appearance(boxes[0])])[:2].tolist() == [pytest.approx(2), 0]


def test_a_look_does_not_grow_without_end() -> None:
    names = [f"thing {number}" for number in range(MOST_THINGS)]
    scene = cast(Scene, SimpleNamespace(can_be_taught=True, taught=names))
    said, thing = teach(scene, Teach("padlock"), None, None)
    assert (thing, said.endswith("for example: forget the thing 0.")) == (None, True)


def test_a_file_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    things = TaughtThings("eyes", tmp_path / "things")
    things.add("padlock", LOOK)
    (tmp_path / "things").write_bytes(b"broken by somebody")
    scene = cast(Scene, SimpleNamespace(forget=things.remove))
    assert forget(scene, "padlock") == f"I no longer know what the padlock looks like. {NOT_WRITTEN}"
    assert (tmp_path / "things").read_bytes() == b"broken by somebody"
