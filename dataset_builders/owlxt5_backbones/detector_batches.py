# SPDX-License-Identifier: Apache-2.0
"""What the detector is trained on: batches of rendered images with queries and the right boxes."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torchvision.ops import box_convert
from torchvision.transforms import v2
from transformers import Owlv2Processor

from .queries import PATTERNS, Objects, Query, draw_queries
from .rng import choice

# Queries with colours and sides in a batch, beside all names.
_QUERIES = 96
# Of the patches looked at so many are anywhere; in this share of the batches all are looked at, as later.
_ANY_PATCHES = 16
_ALL_PATCHES = 0.1
# Patches whose middle lies in this inner share of a box are to find it.
_INNER = 0.8
_FAR = 4.0  # more than any squared distance in a square with edges of 1
# What cheap cameras do, each to this share of the images: blur (standard deviation, pixels), JPEG (quality).
_EFFECT, _BLUR, _QUALITY = 0.3, (0.2, 2.0), (25, 90)


class Collator:
    """Makes a batch of images, blurred, compressed, flipped and relit, with queries of their own.

    What it draws follows from PyTorch's generator, of which each worker of a data loader has its own.

    Args:
        processor: The detector's.
        side: Patches along an edge of the detector's image.
        patches: How many patches of an image are looked at, those with objects first, as in OWLv2's own
            training; all by default.
    """

    def __init__(self, processor: Owlv2Processor, side: int, patches: int | None = None) -> None:
        self._processor = processor
        self._edge = processor.image_processor.size["width"]  # type: ignore[attr-defined]
        self._side, self._patches = side, patches
        effects = (v2.GaussianBlur(9, _BLUR), v2.JPEG(_QUALITY))
        self._worsen = v2.Compose([v2.RandomApply([effect], _EFFECT) for effect in effects])
        light = v2.ColorJitter(brightness=0.25, contrast=0.25, saturation=0.25)
        self.relight = v2.Compose([light, v2.GaussianNoise(sigma=0.02)])

    def __call__(self, rows: Sequence[Mapping[str, Any]]) -> dict[str, Tensor]:
        """Collate rows of `scenes.RandomScenes.images`.

        Returns:
            `pixel_values`; `input_ids` and `attention_mask` of the queries, which are asked of all images;
            `patches` (batch, patches), indices of those to look at; `positive` (batch, patches, queries)
            bool, which of them show what is asked for; `boxes` (batch, patches, 4), which box they are to
            find, middle and edges, shares of the padded square, zero where there is none; `known` (batch,
            queries), False where nobody could say what is meant.
        """
        rng = np.random.default_rng(int(torch.randint(2**62, ())))
        images, scenes = [], []
        for row in rows:
            flipped = rng.random() < 0.5
            images.append(self._prepare(np.array(row["image"]), flipped))
            objects = [dict(item) for item in row["objects"]]
            for item in objects if flipped else ():
                x0, y0, x1, y1 = item["box"]
                item["box"] = [1 - x1, y0, 1 - x0, y1]
            scenes.append(objects)
        queries = draw_queries(scenes, rng, _QUERIES)
        number = self._side**2
        if self._patches and rng.random() >= _ALL_PATCHES:
            number = min(number, self._patches)
        truth = [
            self._truth(objects, queries, number, image)
            for objects, image in zip(scenes, images, strict=True)
        ]
        keys = "patches", "positive", "boxes", "known"
        stacked = {
            key: torch.stack(values) for key, values in zip(keys, zip(*truth, strict=True), strict=True)
        }
        texts = [choice(rng, PATTERNS).format(query.phrase) for query in queries]
        inputs = self._processor(
            text=texts, images=images, do_rescale=False, truncation=True, return_tensors="pt"
        )
        return {**inputs, **stacked}

    def _prepare(self, pixels: NDArray[np.uint8], flipped: bool) -> Tensor:
        """As large as the model wants it: OWLv2's processor, whose blur is slow, has nothing to shrink."""
        image = self._worsen(torch.from_numpy(pixels).permute(2, 0, 1))
        height, width = image.shape[-2:]
        scale = self._edge / max(height, width)
        image = v2.functional.resize(image, [round(height * scale), round(width * scale)], antialias=False)
        image = self.relight(image.float() / 255).clamp(0, 1)
        return image.flip(-1) if flipped else image

    def _truth(
        self, objects: Objects, queries: Sequence[Query], number: int, image: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """`patches`, `positive`, `boxes` and `known` of an image.

        Our decision: a patch in the inner part of an object is positive and finds its box. As all boxes are
        known, OWLv2's own matching of sets is not needed.
        """
        height, width = image.shape[-2:]
        corners = torch.tensor([item["box"] for item in objects]).view(-1, 4)
        boxes = box_convert(
            corners * torch.tensor([width, height, width, height]) / self._edge, "xyxy", "cxcywh"
        )
        middle = (torch.arange(self._side) + 0.5) / self._side
        patch = torch.stack(torch.meshgrid(middle, middle, indexing="xy"), dim=-1).view(-1, 1, 2)
        offset = (patch - boxes[:, :2]).abs()  # (patches, objects, 2)
        nearest = offset.square().sum(dim=-1)
        inner = (offset <= _INNER / 2 * boxes[:, 2:]).all(dim=-1)
        inner |= nearest == nearest.amin(dim=0, keepdim=True)
        touched = (offset <= (boxes[:, 2:] + 1 / self._side) / 2).all(dim=-1).any(dim=-1)
        rank = torch.rand(len(patch)) + touched
        rank[torch.randperm(len(patch))[:_ANY_PATCHES]] += 2
        patches = rank.topk(number).indices
        inner, nearest = inner[patches], nearest[patches]
        meant = torch.zeros(len(objects), len(queries))
        known = torch.ones(len(queries), dtype=torch.bool)
        for column, query in enumerate(queries):
            indices = query.meant(objects)
            known[column] = indices is not None
            meant[list(indices or ()), column] = 1
        # A patch in two boxes belongs to the nearer middle, one in none to a box of nothing.
        nearest = nn.functional.pad(nearest.masked_fill(~inner, torch.inf), (0, 1), value=_FAR)
        found = nn.functional.pad(boxes, (0, 0, 0, 1))[nearest.argmin(dim=-1)]
        return patches, inner.float() @ meant > 0, found, known
