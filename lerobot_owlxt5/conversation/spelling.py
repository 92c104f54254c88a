# SPDX-License-Identifier: Apache-2.0
"""Which of the things that are seen a misspelt name may mean."""

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches

from ..commands.answer import Target
from ..commands.instruction import target_of

_ALIKE = 0.66
"""Share of letters in common, in their order, as "umg" has with "mug" (our decision)."""


def respelt(target: Target, seen: Sequence[str]) -> Target | None:
    """A target with the name that is most like its own, of what was seen.

    Args:
        target: What somebody asked for, such as "botlte".
        seen: Names of what was seen, such as "wine bottle": as a whole or the last word.

    Returns:
        None if nothing is like it, or a thing of just this name is there.
    """
    called = {name.split()[-1]: name for name in seen} | {name: name for name in seen}
    if not target.name or target.name in called:
        return None
    for alike in get_close_matches(target.name, called, n=1, cutoff=_ALIKE):
        other = target_of(called[alike])
        return replace(target, name=other.name, colour=target.colour or other.colour)
    return None
