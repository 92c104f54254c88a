# SPDX-License-Identifier: Apache-2.0
"""What a policy knows of an image: the only difference between OWLxT5 and CrossT5."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, Protocol

from torch import Tensor

from .commands.replies import NOTHING_KNOWN, NOTHING_MOVED
from .data.episode_store import EpisodeStore
from .scene import Scene, Thing


class VisualInput(NamedTuple):
    """What was seen of a batch.

    Attributes:
        features: (batch, steps, dim) in about [-1, 1]; one step where they stay the same.
        object_found: (batch,) bool: was the object that the task names seen?
    """

    features: Tensor
    object_found: Tensor


class MovedObjects(NamedTuple):
    """What was seen of finished episodes.

    Attributes:
        features: As in `VisualInput`.
        moved: (batch,) bool: did an object leave its place? True where that cannot be told.
        labels: What the object is called, for describe's prompt; empty where that cannot be told, or where no
            label was in view.
    """

    features: Tensor
    moved: Tensor
    labels: list[str]

    def answers(self, texts: Sequence[str]) -> list[str]:
        """What to say: the text about each sample, or that there is nothing to tell."""
        return [
            text if moved else NOTHING_MOVED if label else NOTHING_KNOWN
            for text, moved, label in zip(texts, self.moved.tolist(), self.labels, strict=True)
        ]


class VisualEncoder(Protocol):
    """Turns images into the numbers that stand beside the joints.

    Attributes:
        names_objects: Whether it looks for an object by its name.
    """

    names_objects: bool

    def can_read(self, names: Sequence[str]) -> bool:
        """Whether names that are looked for together are short enough; not asked unless `names_objects`."""

    def encode(self, batch: Mapping[str, Any], names: Sequence[str]) -> VisualInput:
        """Look at a batch's images: one step, or all steps of finished episodes.

        Args:
            batch: Features `observation.*`, with a time axis or without.
            names: What each sample's object is called.
        """

    def encode_cached(
        self, batch: Mapping[str, Any], names: Sequence[str], episodes: EpisodeStore
    ) -> VisualInput:
        """The same for a training batch, whose episodes come by again and again."""

    def find_moved(self, batch: Mapping[str, Any], labels: Sequence[str]) -> MovedObjects:
        """Look at finished episodes for the object that was moved.

        Args:
            batch: As `describe_delta_indices` of the policy's configuration requests it.
            labels: Names of the objects that may have been moved.
        """


class ObjectFinder(VisualEncoder, Protocol):
    """A visual encoder that `names_objects`."""

    def scenes(
        self, batch: Mapping[str, Any], labels: Sequence[str], in_english: Callable[[str], str]
    ) -> list[Scene]:
        """The images of a batch, each for somebody to ask. Who asks nothing has it not encoded.

        Args:
            batch: Features `observation.*`, with a time axis or without; the first step counts.
            labels: Names of what may be there.
            in_english: What a name is called in English.
        """

    def features(self, batch: Mapping[str, Any], things: Sequence[Thing | None]) -> Tensor:
        """What is seen of one thing in each of a batch's images, (batch, 1, dim); 0 for None."""
