# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from lerobot_owlxt5.commands import pseudo_names
from lerobot_owlxt5.commands.parser import (
    Command,
    object_name,
    parse_command,
    plain,
    spoken,
    with_article,
)
from lerobot_owlxt5.commands.verbs import VERBS
from lerobot_owlxt5.commands.vocabulary import DIRECTIONS, ENDINGS, GERUNDS, OPENINGS, SLIPS, VERB_PHRASES
from lerobot_owlxt5.mode_sampling import draw_modes, spread

CLANT_WORDINGS = {
    "push": ("push", "move-up", "Move up"),
    "pull": ("pull", "move-down"),
    "slide-to-left": ("slide-to-left", "move-sideways-to-left", "slide to left"),
    "slide-to-right": ("slide-to-right", "move-sideways-to-right"),
}
# Names may hold and begin with any words of commands; the last word is a noun.
nouns = st.text("bcdfgjkm", min_size=2, max_size=8)
adjectives = st.sampled_from(
    [
        *GERUNDS,
        *GERUNDS.values(),
        "left",
        "right",
        "up",
        "back",
        "away",
        "can",
        "please",
        "now",
        "robot",
        "red",
    ]
)
names = st.builds(lambda before, noun: " ".join([*before, noun]), st.lists(adjectives, max_size=3), nouns)
# A comma before the ending, as "right now" is a time and "right, now" a direction.
parts = st.tuples(*map(st.sampled_from, map(sorted, (OPENINGS, DIRECTIONS, ENDINGS))), nouns)
sentences = parts.map(lambda part: f"{part[0]} move the {part[3]} {part[1]}, {part[2]}")


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
        # Polite and indirect.
        ("could you push the ball, please", "push", "ball"),
        ("Please would you mind pulling the mug towards you?", "pull", "mug"),
        ("I\u2019d like you to slide the red cube to the left", "slide-to-left", "red cube"),
        ("robot, push the can!", "push", "can"),
        ("Hey NICO: push this can for me, will you?", "push", "can"),
        ("can you push the can", "push", "can"),
        ("Push the can, if you don't mind, robot.", "push", "can"),
        ("Slowly move the ball up again now", "push", "ball"),
        # Synonyms and directions, in front and behind.
        ("shove the can a bit", "push", "can"),
        ("move the can away from you", "push", "can"),
        ("move forward the can", "push", "can"),
        ("push the can straight ahead", "push", "can"),
        ("drag that mug a little closer to you", "pull", "mug"),
        ("draw the mug", "pull", "mug"),
        ("pull back the can", "pull", "can"),
        ("shift the mug back", "pull", "mug"),
        ("slide to the left the ball", "slide-to-left", "ball"),
        ("sweep the ball leftwards", "slide-to-left", "ball"),
        ("Shift that mug over to your right-hand side, please.", "slide-to-right", "mug"),
        ("move the ball sideways to your left", "slide-to-left", "ball"),
        ("slide the ball right, now", "slide-to-right", "ball"),
        ("slide the ball to the right now", "slide-to-right", "ball"),
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
        # Two letters swapped.
        ("psuh the lfet bush", "push", "lfet bush"),
        ("could you sldie the ball to the lfet", "slide-to-left", "ball"),
    ],
)
def test_commands(text: str, verb: str, name: str) -> None:
    assert parse_command(text) == Command(verb, name)


@pytest.mark.parametrize(
    ("text", "refusal"),
    [
        ("", "What should I do?"),
        ("Please, robot!", "What should I do?"),
        # No action that we know.
        ("Dance wildly!", "I do not know how to dance wildly."),
        ("could you pick up the cube, please", "I do not know how to pick up the cube."),
        ("the red cube", "I do not know how to the red cube."),
        ("I pushed the ball", "I do not know how to i pushed the ball."),
        ("shoe to the left", "I do not know how to shoe to the left."),
        ("push the ball to the can", "I do not know how to push the ball to the can."),
        ("slide the ball to the light", "I do not know how to slide the ball to the light."),
        ("pull the can towards me", "I do not know how to pull the can towards me."),
        ("push the can off the table", "I do not know how to push the can off the table."),
        ("push the ball if it is red", "I do not know how to push the ball if it is red."),
        ("push the can with your left hand", "I do not know how to push the can with your left hand."),
        # More than one.
        ("push the ball and pull the can", "I do not know how to push the ball and pull the can."),
        ("push the ball, pull the can", "I do not know how to push the ball, pull the can."),
        ("push the ball pull the can", "I do not know how to push the ball pull the can."),
        ("push the ball or the can", "I do not know how to push the ball or the can."),
        ("slide the ball left and right", "I do not know how to slide the ball left and right."),
        # Not clearly one.
        ("slide the ball", "Should I slide the ball to the left or slide it to the right?"),
        ("slide the ball right now", "Should I slide the ball to the left or slide it to the right?"),
        ("sweep the one on the left", "Should I slide the one on left to the left or slide it to the right?"),
        ("slide red left right", "Should I slide the red cube to the left or slide it to the right?"),
        ("move it", "Should I push it, pull it, slide it to the left or slide it to the right?"),
        ("push the ball to the left", "Should I push the ball or slide it to the left?"),
        ("push back the cover", "Should I push the cover or pull it?"),
        ("slide red up", "Should I push the red cube, slide it to the left or slide it to the right?"),
        # No object.
        ("push it", "What should I push?"),
        ("push", "What should I push?"),
        ("Move this to your left!", "What should I slide to the left?"),
        # Negated.
        ("don't push the ball", "I hold still."),
        ("would you mind not pushing the ball?", "I hold still."),
        ("push the ball but not the can", "I hold still."),
    ],
)
def test_what_is_not_clearly_one_known_action_is_refused(text: str, refusal: str) -> None:
    assert parse_command(text) == Command(None, plain(text), refusal)


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


@given(part=parts)
def test_each_opening_direction_and_ending_is_understood(part: tuple[str, str, str, str]) -> None:
    opening, direction, ending, noun = part
    text = f"{opening} move the {noun} {direction}, {ending}"
    assert parse_command(text) == Command(DIRECTIONS[direction], noun)


@pytest.mark.parametrize("word", sorted({*VERB_PHRASES, *GERUNDS}))
def test_each_verb_is_known_even_with_two_letters_swapped(word: str) -> None:
    known = parse_command(f"{word} the ball")
    assert known.verb or known.refusal.startswith("Should I")
    for slip in (slip for slip, meant in SLIPS.items() if meant == word):
        assert parse_command(f"{slip} the ball").verb == known.verb


def test_a_slip_is_no_other_word_of_commands() -> None:
    words = {word for phrase in (*VERB_PHRASES, *GERUNDS, *DIRECTIONS, *OPENINGS) for word in phrase.split()}
    assert not words & set(SLIPS)


@given(
    sentence=sentences,
    place=st.integers(0, 20),
    word=st.sampled_from(["not", "never", "Don\u2019t"]),
)
def test_a_negated_command_is_never_carried_out(sentence: str, place: int, word: str) -> None:
    words = sentence.split()
    assert parse_command(" ".join([*words[:place], word, *words[place:]])).verb is None


@given(first=sentences, second=sentences, joint=st.sampled_from([" and ", ", ", " then ", "; ", " "]))
def test_two_commands_at_once_are_refused(first: str, second: str, joint: str) -> None:
    assert parse_command(first + joint + second).verb is None


@given(st.text() | st.lists(adjectives | st.sampled_from(sorted(OPENINGS | set(DIRECTIONS)))).map(" ".join))
def test_any_text_can_be_parsed(text: str) -> None:
    command = parse_command(text)
    assert command.object == plain(command.object)
    assert f" {command.object} " in f" {plain(text)} "
    assert (command.verb is None) == (command.refusal != "")
    assert command.verb is None or command.object


@pytest.mark.parametrize(
    ("text", "canonical", "intention"),
    [
        ("Could you push the red cube?", "push red", "I will push the red cube."),
        ("drag the mug", "pull mug", "I will pull the mug."),
        (
            "move greenish-blue to the left",
            "slide-to-left greenish blue",
            "I will slide the greenish blue cube to the left.",
        ),
        ("slide the ice cube right", "slide-to-right ice cube", "I will slide the ice cube to the right."),
        ("dance wildly", "dance wildly", "I will do it."),
    ],
)
def test_a_command_has_a_canonical_form_and_an_intention(text: str, canonical: str, intention: str) -> None:
    command = parse_command(text)
    assert (command.canonical, command.intention) == (canonical, intention)


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
