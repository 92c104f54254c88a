# SPDX-License-Identifier: Apache-2.0
"""What a detector answers: where the named objects are in an image."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

import torch
from torch import Tensor
from torchvision.ops import box_iou, nms

if TYPE_CHECKING:
    from .taught import TaughtThings

SAME_PLACE = 0.02
"""Centres closer than this share of the image are at one place: the detector's noise."""

ONE_THING = 0.4
"""Boxes that share more of their joint area are boxes of one thing (our decision)."""


class Detections(NamedTuple):
    """Where the named objects are.

    Attributes:
        box: (batch, names, 4), left, upper, right and lower edge as shares of the image's width and height,
            from its upper left corner; of the best box, however low its score.
        score: (batch, names) in [0, 1]; the object counts as seen from the detector's threshold on.
    """

    box: Tensor
    score: Tensor

    @property
    def centre(self) -> Tensor:
        """Middle of the box, (batch, names, 2), x and y."""
        return (self.box[..., :2] + self.box[..., 2:]) / 2

    def share_inside(self, other: "Detections") -> Tensor:
        """Which share of each box lies inside the other one of the same name, (batch, names)."""
        low = torch.maximum(self.box[..., :2], other.box[..., :2])
        high = torch.minimum(self.box[..., 2:], other.box[..., 2:])
        area = (self.box[..., 2:] - self.box[..., :2]).prod(dim=-1)
        return (high - low).clamp(min=0).prod(dim=-1) / area.clamp(min=1e-9)

    def foot(self, nadir: float | None) -> Tensor:
        """Where upright objects touch the table: in the box's lower edge, under its middle.

        In an image from above, uprights lean away from the middle; their lines meet at the nadir.

        Args:
            nadir: Where straight down is in the image, in the column of its middle: the row as a share of
                the height; more than 1 lies below the image. None: uprights stand upright in the image.

        Returns:
            (batch, names, 2), x and y.
        """
        x, y = self.centre.unbind(dim=-1)
        lower = self.box[..., 3]
        if nadir is not None:
            x = 0.5 + (x - 0.5) * (nadir - lower) / (nadir - y)
        return torch.stack([x, lower], dim=-1)


class Candidates(NamedTuple):
    """All boxes that a detector proposes in each image.

    Attributes:
        box: (batch, boxes, 4), as in `Detections`.
        score: (batch, boxes, names) in [0, 1].
        embedding: (batch, boxes, dim), of norm 1, what the detector makes of each box's patch; None where it
            has no such thing.
    """

    box: Tensor
    score: Tensor
    embedding: Tensor | None = None

    def at(self, places: Tensor) -> Tensor:
        """Which boxes have their centre at which places (batch, places, 2); bool (batch, boxes, places)."""
        centre = (self.box[..., :2] + self.box[..., 2:]) / 2
        return same_place(centre[:, :, None], places[:, None])

    def best(self, counts: Tensor | None = None) -> Detections:
        """For each name the box with the highest score (paper, 3).

        Args:
            counts: (batch, boxes, names) bool: which boxes count for which name. None: all.
        """
        scores = self.score if counts is None else self.score * counts
        score, index = scores.max(dim=1)
        return Detections(self.box.gather(1, index[..., None].expand(-1, -1, self.box.shape[-1])), score)

    def things(self, threshold: float) -> Detections:
        """Find each thing that one of the names fits, not the best one alone; for a batch of one.

        Boxes that overlap by more than `ONE_THING` are boxes of one thing. For each name the one with the
        best score counts.

        Args:
            threshold: A thing has a name that scores so much.

        Returns:
            (things, names): things in place of samples.
        """
        box, score = self.box[0], self.score[0]
        seen = score.amax(dim=1) >= threshold
        box, score = box[seen], score[seen]
        if not len(box):
            return Detections(box.new_zeros(0, score.shape[1], box.shape[1]), score)
        kept = box[nms(box, score.amax(dim=1), ONE_THING)]
        belongs = box_iou(kept, box) > ONE_THING
        best, index = torch.where(belongs[..., None], score, 0.0).max(dim=1)
        return Detections(box[index], best)


Look = Callable[[Sequence[Sequence[str]]], Candidates]
"""Images that were looked at once, to be asked for names: for each sample the same number of them."""


class Detector(Protocol):
    """Finds named objects.

    Attributes:
        threshold: From this score on an object counts as seen.
        revision: The Hub's commit, or the digest of embedded weights; None for a folder and the simulator.
        taught: What it was shown and told the name of; None if it cannot be.
    """

    threshold: float
    revision: str | None
    taught: "TaughtThings | None" = None

    def can_read(self, names: Sequence[str]) -> bool:
        """Whether names that are looked for together are short enough to be read to their end."""

    def look(self, observation: Mapping[str, Any]) -> Look:
        """Look once, to ask for several names one after the other; see `propose`."""
        return partial(self.propose, observation)

    def teach(self, name: str, observation: Mapping[str, Any], box: Tensor) -> None:
        """Remember what is in a box (4,) of one image (1, ...) under a name; only where it has `taught`.

        Raises:
            ValueError, OSError: If the file of what was taught cannot be used.
        """
        raise TypeError(f"{type(self).__name__} cannot be taught.")

    def propose(self, observation: Mapping[str, Any], names: Sequence[Sequence[str]]) -> Candidates:
        """Look once, to choose among the boxes afterwards.

        Args:
            observation: Features `observation.*` of one step, (batch, ...) without a time axis.
            names: For each sample, the names to look for; the same number for each sample.
        """

    def __call__(self, observation: Mapping[str, Any], names: Sequence[Sequence[str]]) -> Detections:
        """Detect: the best of what `propose` gives."""
        return self.propose(observation, names).best()


def same_place(centre: Tensor, other: Tensor) -> Tensor:
    """Which of two sets of points (..., 2), shares of the image, are closer than `SAME_PLACE`; bool (...)."""
    return (centre - other).norm(dim=-1) < SAME_PLACE
