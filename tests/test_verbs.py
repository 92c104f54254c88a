# SPDX-License-Identifier: Apache-2.0
"""World and policy have a record of each verb of their own, because neither may import the other."""

import pytest

from lerobot_owlxt5.commands.parser import parse_command
from lerobot_owlxt5.commands.verbs import VERBS
from nico_tabletop import tasks


def test_both_know_the_same_verbs() -> None:
    assert [(verb.name, verb.synonym) for verb in VERBS.values()] == [
        (verb.name, verb.synonym) for verb in tasks.VERBS
    ]


@pytest.mark.parametrize("verb", tasks.VERBS, ids=lambda verb: verb.name)
def test_the_policy_understands_the_worlds_commands(verb: tasks.Verb) -> None:
    for name in (verb.name, verb.synonym):
        command = parse_command(f"{name} red")
        assert (command.verb, command.object) == (verb.name, "red")


@pytest.mark.parametrize("name", VERBS)
def test_every_phrase_of_a_verb_is_understood(name: str) -> None:
    verb = VERBS[name]
    for direction in verb.directions:
        assert parse_command(f"move the ball {direction}").verb == name
    for phrase in (verb.imperative, *verb.unseen):
        assert parse_command(phrase.format("ball")).verb == name
