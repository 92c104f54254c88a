# SPDX-License-Identifier: Apache-2.0
"""What a policy saw of what it was asked for, before it plans."""

from dataclasses import dataclass

from .commands.replies import NO_OBJECTS_SEEN
from .look_again import Memory, remember
from .scene import Scene, Search, Thing


@dataclass(frozen=True)
class Sighting:
    """What was seen of one thing.

    Attributes:
        thing: What is meant; None where nothing is, or where it is not clear.
        name: What to call it, or empty.
        problem: Why it is not clear which thing is meant, a sentence; empty where it is.
        memory: What was seen; None where no thing was found, or nobody can compare.
    """

    thing: Thing | None
    name: str
    problem: str
    memory: Memory | None


def find(scene: Scene, search: Search) -> Sighting:
    """Look for what is meant in an image."""
    found = scene.find(search)
    if found.thing is None:
        return Sighting(None, "", found.problem, None)
    return Sighting(found.thing, found.thing.name, found.problem, remember(scene, found.thing))


def without_objects(search: Search) -> Sighting:
    """Take the words for the thing, as whoever sees whole images has to."""
    problem = NO_OBJECTS_SEEN if search.needs_objects else ""
    return Sighting(None, search.target.phrase if search.target else "", problem, None)
