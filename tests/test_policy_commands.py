# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from lerobot_owlxt5.commands import pseudo_names
from lerobot_owlxt5.commands.parser import (
    Command,
    formal_command,
    object_name,
    parse_command,
    plain,
    spoken,
    with_article,
)
from lerobot_owlxt5.commands.verbs import VERBS
from lerobot_owlxt5.commands.vocabulary import DIRECTIONS, VERB_PHRASES
from lerobot_owlxt5.mode_sampling import draw_modes, spread

CLANT_WORDINGS = {
    "push": ("push", "move-up", "Move up"),
    "pull": ("pull", "move-down"),
    "slide-to-left": ("slide-to-left", "move-sideways-to-left", "slide to left"),
    "slide-to-right": ("slide-to-right", "move-sideways-to-right"),
}
# Names may begin with many words of commands; the last word is a noun.
nouns = st.text("bcdfgjkm", min_size=2, max_size=8)
adjectives = st.sampled_from(
    ["push", "pulling", "left", "right", "up", "back", "can", "please", "red", "not"]
)
names = st.builds(lambda before, noun: " ".join([*before, noun]), st.lists(adjectives, max_size=3), nouns)


@pytest.mark.parametrize(
    ("text", "verb", "name"),
    [
        # CLANT's own forms.
        ("push red", "push", "red"),
        ("Push the red cube!", "push", "red cube"),
        ("move-up greenish-blue", "push", "greenish blue"),
        ("pull white chess piece", "pull", "white chess piece"),
        ("slide-to-left ball", "slide-to-left", "ball"),
        ("slide the mug to the right.", "slide-to-right", "mug"),
        ("move-sideways-to-left scarlet", "slide-to-left", "scarlet"),
        ("move sideways the mug to left", "slide-to-left", "mug"),
        # Directions, in front and behind.
        ("move the can away from you", "push", "can"),
        ("move forward the can", "push", "can"),
        ("push the can straight ahead", "push", "can"),
        ("pull back the can", "pull", "can"),
        ("shift the mug back", "pull", "mug"),
        ("slide to the left the ball", "slide-to-left", "ball"),
        ("sweep the ball leftwards", "slide-to-left", "ball"),
        ("move the ball sideways to your left", "slide-to-left", "ball"),
        # Names that hold the words of commands.
        ("push push pin", "push", "push pin"),
        ("push back cover", "push", "back cover"),
        ("push the robot", "push", "robot"),
        ("move left shoe up", "push", "left shoe"),
        ("slide the left shoe to the right", "slide-to-right", "left shoe"),
        ("slide to left side table", "slide-to-left", "side table"),
        ("move the yellow move-up toy to your left", "slide-to-left", "yellow move up toy"),
        ("pull the ball on the left", "pull", "ball on left"),
        ("push the black and white ball", "push", "black and white ball"),
        ("push: the big, red ball", "push", "big red ball"),
    ],
)
def test_commands(text: str, verb: str, name: str) -> None:
    assert parse_command(text) == Command(verb, name)


@pytest.mark.parametrize(
    "text",
    [
        "",
        "Dance wildly!",
        "the red cube",
        "I pushed the ball",
        "don't push the ball",
        "push the ball to the can",
        "pull the can towards me",
        "push the ball if it is red",
        "push the ball or the can",
        "slide the ball",
        "slide red left right",
        "push the ball to the left",
        "push",
    ],
)
def test_what_is_no_task_of_ours_is_one_phrase(text: str) -> None:
    assert parse_command(text) == Command(None, plain(text))


@pytest.mark.parametrize(
    ("text", "command"),
    [
        ("push red", Command("push", "red")),
        ("move-down greenish-blue", Command("pull", "greenish blue")),
        ("slide-to-left white chess piece", Command("slide-to-left", "white chess piece")),
        ("push the ball", None),
        ("push ball later", None),
        ("push no ball", None),
        ("push left cube", None),
        ("Push ball", None),
        ("push ball!", None),
        ("push it", None),
        ("push", None),
        ("don't push ball", None),
    ],
)
def test_clants_own_form_needs_no_understanding(text: str, command: Command | None) -> None:
    assert formal_command(text) == command


@given(
    verb=st.sampled_from([*VERBS]),
    data=st.data(),
    name=names,
    article=st.sampled_from(["", "the ", "a ", "an "]),
)
def test_clants_forms_take_any_name(verb: str, data: st.DataObject, name: str, article: str) -> None:
    wording = data.draw(st.sampled_from(CLANT_WORDINGS[verb]))
    command = parse_command(f"  {wording} {article}{name.upper()} ")
    assert command == Command(verb, name)
    assert parse_command(command.canonical) == command


@given(st.text() | st.lists(adjectives | st.sampled_from([*VERB_PHRASES, *DIRECTIONS])).map(" ".join))
def test_any_text_can_be_parsed(text: str) -> None:
    command = parse_command(text)
    assert command.object == plain(command.object)
    assert f" {command.object} " in f" {plain(text)} "
    assert command.verb is None or command.object


@pytest.mark.parametrize(
    ("text", "canonical"),
    [
        ("Push the red cube!", "push red"),
        ("pull the mug", "pull mug"),
        ("move greenish-blue to the left", "slide-to-left greenish blue"),
        ("slide the ice cube right", "slide-to-right ice cube"),
        ("dance wildly", "dance wildly"),
    ],
)
def test_a_command_has_a_canonical_form(text: str, canonical: str) -> None:
    assert parse_command(text).canonical == canonical


def test_names_are_said_in_full() -> None:
    assert object_name("red") == "red cube"
    assert object_name("greenish-blue") == "greenish blue cube"
    assert object_name("the mug") == "mug"
    assert [with_article(name) for name in ("ball", "azure cube")] == ["a ball", "an azure cube"]
    assert spoken("slide-to-left  red") == "slide to left red"


@given(
    st.integers(0, 2**31), st.sampled_from(["push red", "move-up greenish-blue", "slide the cup to the left"])
)
def test_a_pseudo_name_takes_the_place_of_the_object(seed: int, text: str) -> None:
    name = pseudo_names.draw_name(np.random.default_rng(seed))
    assert parse_command(pseudo_names.rename_object(text, name)) == Command(parse_command(text).verb, name)
    assert pseudo_names.rename_object("dance wildly", name) == "dance wildly"


@given(
    weights=st.lists(st.floats(0.01, 1), min_size=4, max_size=4),
    absent=st.sets(st.integers(0, 3), max_size=3),
    uniform=st.floats(0, 1, exclude_max=True, width=32),
)
def test_a_mode_without_probability_is_never_drawn(
    weights: list[float], absent: set[int], uniform: float
) -> None:
    row = torch.tensor([0.0 if mode in absent else weight for mode, weight in enumerate(weights)])
    drawn = draw_modes(row[None], torch.tensor([uniform]))
    assert int(drawn) not in absent


def test_modes_are_drawn_as_often_as_they_should() -> None:
    shares = torch.tensor([0.3, 0.3, 0.3, 0.1])
    drawn = draw_modes(shares.expand(1000, 4), spread(torch.arange(1000)))
    assert torch.allclose(torch.bincount(drawn, minlength=4) / 1000, shares, atol=0.01)
