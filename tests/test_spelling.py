# SPDX-License-Identifier: Apache-2.0
"""A misspelt name is like what is seen, and another thing's name is not."""

import pytest

from lerobot_owlxt5.commands.answer import Target
from lerobot_owlxt5.conversation.spelling import respelt

SEEN = ("wine bottle", "mug", "can", "red cube")


@pytest.mark.parametrize(
    ("said", "meant"),
    [
        (Target("botlte"), Target("wine bottle")),
        (Target("umg", side="left"), Target("mug", side="left")),
        (Target("cn"), Target("can")),
        (Target("cubee"), Target("cube", "red")),
        (Target("cubee", "blue"), Target("cube", "blue")),
        (Target("mug"), None),
        (Target("bottle"), None),
        (Target("teapot"), None),
        (Target(colour="red"), None),
    ],
)
def test_a_name_is_like_one_thing_or_none(said: Target, meant: Target | None) -> None:
    assert respelt(said, SEEN) == meant
    assert respelt(said, ()) is None
