# SPDX-License-Identifier: Apache-2.0
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from lerobot_owlxt5 import made_up_names, modes
from lerobot_owlxt5.commands import VERBS, Command, object_name, parse_command, plain, spoken, with_article

WORDINGS = {
    "push": ("push", "move-up", "Move up"),
    "pull": ("pull", "move-down"),
    "slide-to-left": ("slide-to-left", "move-sideways-to-left", "slide to left"),
    "slide-to-right": ("slide-to-right", "move-sideways-to-right"),
}
# Longer objects may themselves hold a verb's words ("to left").
nouns = st.text("bcdfgjkm", min_size=2, max_size=8)


@pytest.mark.parametrize(
    ("text", "verb", "name"),
    [
        ("push red", "push", "red"),
        ("Push the red cube!", "push", "red cube"),
        ("move-up greenish-blue", "push", "greenish blue"),
        ("pull white chess piece", "pull", "white chess piece"),
        ("slide-to-left ball", "slide-to-left", "ball"),
        ("slide the mug to the right.", "slide-to-right", "mug"),
        ("move-sideways-to-left scarlet", "slide-to-left", "scarlet"),
        ("pick up the cube", None, "pick up cube"),
        ("push", None, "push"),
        ("", None, ""),
    ],
)
def test_commands(text: str, verb: str | None, name: str) -> None:
    assert parse_command(text) == Command(verb, name)


@given(
    verb=st.sampled_from(VERBS),
    data=st.data(),
    noun=nouns,
    article=st.sampled_from(["", "the ", "a ", "an "]),
)
def test_each_wording_names_its_verb_and_object(
    verb: str, data: st.DataObject, noun: str, article: str
) -> None:
    wording = data.draw(st.sampled_from(WORDINGS[verb]))
    assert parse_command(f"  {wording} {article}{noun.upper()} ") == Command(verb, noun)


@given(st.text())
def test_any_text_can_be_parsed(text: str) -> None:
    command = parse_command(text)
    assert command.object == plain(command.object)
    assert command.verb is None or command.object


def test_names_are_said_in_full() -> None:
    assert object_name("red") == "red cube"
    assert object_name("greenish-blue") == "greenish blue cube"
    assert object_name("the mug") == "mug"
    assert [with_article(name) for name in ("ball", "azure cube")] == ["a ball", "an azure cube"]
    assert parse_command("slide-to-left ball").done == "I slid the ball to the left."
    assert spoken("slide-to-left  red") == "slide to left red"


@given(
    st.integers(0, 2**31), st.sampled_from(["push red", "move-up greenish-blue", "slide the cup to the left"])
)
def test_a_made_up_name_takes_the_place_of_the_object(seed: int, text: str) -> None:
    torch.manual_seed(seed)
    name = made_up_names.draw_name()
    assert parse_command(made_up_names.rename_object(text, name)) == Command(parse_command(text).verb, name)
    assert made_up_names.rename_object("dance wildly", name) == "dance wildly"


@given(
    weights=st.lists(st.floats(0.01, 1), min_size=4, max_size=4),
    absent=st.sets(st.integers(0, 3), max_size=3),
    uniform=st.floats(0, 1, exclude_max=True),
)
def test_a_mode_without_probability_is_never_drawn(
    weights: list[float], absent: set[int], uniform: float
) -> None:
    row = torch.tensor([0.0 if mode in absent else weight for mode, weight in enumerate(weights)])
    drawn = modes.draw_modes(row[None], torch.tensor([uniform]))
    assert int(drawn) not in absent


def test_modes_are_drawn_as_often_as_they_should() -> None:
    shares = torch.tensor([0.3, 0.3, 0.3, 0.1])
    drawn = modes.draw_modes(shares.expand(1000, 4), modes.spread(torch.arange(1000)))
    assert torch.allclose(torch.bincount(drawn, minlength=4) / 1000, shares, atol=0.01)
