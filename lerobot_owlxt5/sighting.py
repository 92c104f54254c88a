# SPDX-License-Identifier: Apache-2.0
"""How a policy looks: what it sees of what it was asked for, before, in and after a movement."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, cast

from torch import Tensor

from .commands.happened import Change
from .commands.replies import NO_OBJECTS_SEEN
from .listener import Listener
from .look_again import Memory, changed, displaced, find_again, remember
from .scene import Moved, Scene, Search, Thing
from .visual_encoder import ObjectFinder, VisualEncoder


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


class Comparison(NamedTuple):
    """What a second look has shown.

    Attributes:
        change: What has happened to a thing; None where nobody had looked at one before.
        moved: What the robot has moved, where it is seen now: `Scene.moved`.
    """

    change: Change | None
    moved: Moved


class Sight:
    """Looks at images with a policy's visual encoder, for names that its listener knows.

    All batches are observations as `select_action` takes them; of several steps the first counts.

    Attributes:
        last: What was seen at the last look, a scene for each robot that looked.
    """

    def __init__(self, visual: VisualEncoder, listener: Listener) -> None:
        self._visual, self._listener = visual, listener
        self.last: list[Scene] = []

    def scenes(self, batch: Mapping[str, Any], moved: Sequence[Moved]) -> list[Scene]:
        """What is seen now, for somebody to ask.

        Args:
            batch: Observations.
            moved: See `Scene.moved`, for each.

        Raises:
            ValueError: If the policy sees whole images and no objects.
        """
        if not self._visual.names_objects:
            raise ValueError(NO_OBJECTS_SEEN)
        finder, listener = cast(ObjectFinder, self._visual), self._listener
        self.last = finder.scenes(batch, listener.labels, listener.in_english)
        for scene, things in zip(self.last, moved, strict=True):
            scene.moved = things
        return self.last

    def find(
        self, batch: Mapping[str, Any], searches: Sequence[Search], moved: Sequence[Moved]
    ) -> tuple[list[Sighting], Tensor]:
        """Find what is meant: sightings, and the network's features (batch, 1, dim); see `scenes`.

        Without a detector, what a name means is for the network to tell.
        """
        if self._visual.names_objects:
            seen = [_find(*each) for each in zip(self.scenes(batch, moved), searches, strict=True)]
            things = [sighting.thing for sighting in seen]
            return seen, cast(ObjectFinder, self._visual).features(batch, things)
        seen = [without_objects(search) for search in searches]
        return seen, self._visual.encode(batch, [sighting.name for sighting in seen]).features[:, :1]

    def compare(
        self, batch: Mapping[str, Any], memories: Sequence[Memory | None], moved: Sequence[Moved]
    ) -> list[Comparison]:
        """What has changed since something was seen, and where it is now; see `scenes`."""
        if not any(memories):
            return [Comparison(None, things) for things in moved]
        compared = []
        for memory, scene in zip(memories, self.scenes(batch, moved), strict=True):
            change = None
            if memory:
                now = find_again(memory, scene)
                change = changed(memory, scene, now)
                others = [thing for thing in scene.moved if thing.name != memory.thing.name]
                # What was taught is known by what it looks like, until somebody tells the robot to forget it.
                scene.moved = (*others, now) if now and now.name not in scene.taught else (*others,)
            compared.append(Comparison(change, scene.moved))
        return compared

    def follow(
        self, batch: Mapping[str, Any], memories: Sequence[Memory], moved: Sequence[Moved]
    ) -> tuple[list[Memory | None], Tensor]:
        """Find things that are elsewhere now, None for the others, and the network's features."""
        things = [displaced(*each) for each in zip(memories, self.scenes(batch, moved), strict=True)]
        now = [
            Memory(thing, memory.others) if thing else None
            for thing, memory in zip(things, memories, strict=True)
        ]
        return now, cast(ObjectFinder, self._visual).features(batch, things)


def _find(scene: Scene, search: Search) -> Sighting:
    """Look for what is meant in an image."""
    found = scene.find(search)
    if found.thing is None:
        return Sighting(None, "", found.problem, None)
    return Sighting(found.thing, found.thing.name, found.problem, remember(scene, found.thing))


def without_objects(search: Search) -> Sighting:
    """Take the words for the thing, as whoever sees whole images has to."""
    problem = NO_OBJECTS_SEEN if search.needs_objects else ""
    return Sighting(None, search.target.phrase if search.target else "", problem, None)
