# SPDX-License-Identifier: Apache-2.0
"""What a thing looks like, to find it again after it was shown once: its name need not mean anything.

All of it is our decision. OWLv2's embedding of a patch tells kinds of things, and tells things that have no
known name badly apart; the shares of colours (Swain and Ballard, 1991) tell these apart and know no shapes.
"""

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torchvision.ops import box_iou

ALIKE = 1.3
"""From this likeness on, of 2, it is the same thing: `benchmarks/teaching.py` chose it on other things."""
MOST_PATCHES = 16
"""So many patches, those with the most similar embeddings, may be the thing."""

_BINS = (6, 6, 4)  # of the share of red, of the share of green, and of the brightness
_DARK = 0.12  # added to the brightness: nobody sees a colour in the dark
_INNER = 0.8  # of a box's width and height, in whose ellipse colours are taken


class Appearance(NamedTuple):
    """One look at a thing.

    Attributes:
        embedding: (dim,), of norm 1, the detector's for the patch that found it.
        colours: (bins,), of norm 1: the root of each colour's share of its pixels.
    """

    embedding: Tensor
    colours: Tensor


class Patches:
    """What a detector sees in each patch of an image, to compare it with looks.

    Args:
        image: (3, height, width) in [0, 1].
        boxes: (patches, 4), those that the detector proposes, edges as shares of the image.
        embeddings: (patches, dim), of norm 1.
    """

    def __init__(self, image: Tensor, boxes: Tensor, embeddings: Tensor) -> None:
        self._image, self._boxes, self._embeddings = image, boxes, embeddings
        self._colours: dict[int, Tensor] = {}

    def appearance(self, box: Tensor) -> Appearance:
        """What the thing in a box (4,) looks like."""
        best = int(box_iou(box[None], self._boxes)[0].argmax())
        return Appearance(self._embeddings[best].clone(), self._colours_of(best))

    def likeness(self, looks: Sequence[Appearance]) -> Tensor:
        """How much each patch shows a thing, of which there are some looks: (patches,), from 0 to 2.

        The best look counts.
        """
        boxes, embeddings = self._boxes, self._embeddings
        shown = torch.stack([look.embedding for look in looks]).to(embeddings)
        colours = torch.stack([look.colours for look in looks]).to(embeddings)
        alike = (embeddings @ shown.T).clamp(min=0)
        found = alike.new_zeros(len(boxes))
        for patch in alike.amax(dim=1).topk(min(MOST_PATCHES, len(boxes))).indices.tolist():
            found[patch] = (alike[patch] + colours @ self._colours_of(patch)).max()
        # A patch at a thing's edge may propose a part of it: it would be a second thing.
        middle = (boxes[:, :2] + boxes[:, 2:]) / 2
        for patch in found.argsort(descending=True)[:MOST_PATCHES].tolist():
            inside = ((middle >= boxes[patch, :2]) & (middle <= boxes[patch, 2:])).all(dim=1)
            inside[patch] = False
            found[inside & (found <= found[patch])] = 0
        return found

    def _colours_of(self, patch: int) -> Tensor:
        """Those in a patch's box; several things are compared with the same few patches."""
        if patch not in self._colours:
            self._colours[patch] = colours_in(self._image, self._boxes[patch])
        return self._colours[patch]


def as_score(found: Tensor, threshold: float) -> Tensor:
    """A likeness as a detector's score: `ALIKE` as its threshold, 0 as 0 and 2 as 1."""
    above = threshold + (1 - threshold) * (found - ALIKE) / (2 - ALIKE)
    return torch.where(found < ALIKE, threshold * found / ALIKE, above)


def colours_in(image: Tensor, box: Tensor) -> Tensor:
    """The root of each colour's share of the pixels in a box's ellipse, (bins,).

    Args:
        image: (3, height, width) in [0, 1].
        box: (4,), edges as shares of the image.
    """
    height, width = image.shape[-2:]
    middle, half = (box[:2] + box[2:]) / 2, _INNER * (box[2:] - box[:2]) / 2
    low = ((middle - half) * box.new_tensor([width, height])).floor().int().clamp(min=0).tolist()
    high = ((middle + half) * box.new_tensor([width, height])).ceil().int().tolist()
    crop = image[:, low[1] : high[1], low[0] : high[0]]
    x = (torch.arange(crop.shape[2], device=image.device) + low[0] + 0.5) / width
    y = (torch.arange(crop.shape[1], device=image.device) + low[1] + 0.5) / height
    inside = ((x - middle[0]) / half[0]) ** 2 + (((y - middle[1]) / half[1]) ** 2)[:, None] <= 1
    pixels = crop[:, inside]  # (3, pixels)
    share = pixels[:2] / (pixels.sum(dim=0) + _DARK)
    bins = torch.tensor(_BINS, device=image.device)
    place = (torch.cat([share, pixels.amax(dim=0, keepdim=True)]) * bins[:, None]).long()
    place = place.clamp(max=bins[:, None] - 1)
    counts = torch.bincount(
        (place[0] * _BINS[1] + place[1]) * _BINS[2] + place[2], minlength=int(bins.prod())
    )
    return (counts / counts.sum().clamp(min=1)).sqrt()
