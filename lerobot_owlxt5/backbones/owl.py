# SPDX-License-Identifier: Apache-2.0
"""How OWLv2 and OWL-ViT find candidates: each patch of the image is one (paper, 3)."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor
from torchvision.ops import box_convert

from .detections import Candidates, Look

# Of which the embeddings are kept, a few kilobytes each.
MOST_NAMES = 1000


class OwlCandidates:
    """OWLv2 and OWL-ViT: a box for each patch of the image, scored for each name."""

    usual_threshold = 0.1

    def __init__(self, model: Any, processor: Any) -> None:
        self.model = model
        self.processor = processor
        self._pads = model.config.model_type == "owlv2"
        self._embedded: dict[str, Tensor] = {}

    def can_read(self, names: Sequence[str]) -> bool:
        """Whether no name is longer than what the model reads: it would see the beginning alone."""
        longest = self.model.config.text_config.max_position_embeddings
        return all(len(self.processor.tokenizer(_query(name))["input_ids"]) <= longest for name in names)

    def __call__(self, images: Tensor, names: Sequence[Sequence[str]]) -> Candidates:
        """Propose boxes in images (batch, 3, height, width) in [0, 1]."""
        queries = [[_query(name) for name in asked] for asked in names]
        inputs = self.processor(
            text=queries, images=list(images), do_rescale=False, truncation=True, return_tensors="pt"
        )
        outputs = self.model(**inputs.to(images.device))
        boxes = self._corners(outputs.pred_boxes, images)
        return Candidates(boxes, outputs.logits.sigmoid(), outputs.class_embeds)

    def look(self, images: Tensor) -> Look:
        """Encode images once, to ask for several names one after the other."""
        inputs = self.processor(images=list(images), do_rescale=False, return_tensors="pt").to(images.device)
        feature_map = self.model.image_embedder(inputs["pixel_values"])[0]
        features = feature_map.flatten(1, 2)
        boxes = self._corners(self.model.box_predictor(features, feature_map), images)

        def candidates(names: Sequence[Sequence[str]]) -> Candidates:
            queries = torch.stack([torch.stack([self._embed(name) for name in asked]) for asked in names])
            logits, embeddings = self.model.class_predictor(features, queries.to(images.device))
            return Candidates(boxes, logits.sigmoid(), embeddings)

        return candidates

    def _corners(self, boxes: Tensor, images: Tensor) -> Tensor:
        """Boxes as in `Detections`, of the model's middles and sizes."""
        corners = box_convert(boxes, "cxcywh", "xyxy")
        if not self._pads:
            return corners
        return to_image_coordinates(corners.unflatten(-1, (2, 2)), *images.shape[-2:]).flatten(-2)

    def _embed(self, name: str) -> Tensor:
        """Embed a name, (dim,), of norm 1; the same names are asked for again and again."""
        if name not in self._embedded:
            inputs = self.processor.tokenizer(
                _query(name), padding="max_length", truncation=True, return_tensors="pt"
            ).to(self.model.device)
            owl = self.model.base_model
            text = owl.text_projection(owl.text_model(**inputs).pooler_output)[0]
            if len(self._embedded) >= MOST_NAMES:
                self._embedded.clear()
            self._embedded[name] = (text / text.norm()).cpu()
        return self._embedded[name]


def _query(name: str) -> str:
    return f"a photo of a {name}"


def to_image_coordinates(points: Tensor, height: int, width: int) -> Tensor:
    """Turn OWLv2's coordinates into shares of the image.

    OWLv2 pads an image at the right or at the bottom to a square and returns shares of that square.

    Args:
        points: (..., 2), x and y as shares of the square.
        height: The image's height in pixels.
        width: The image's width in pixels.
    """
    side = max(height, width)
    return points * points.new_tensor([side / width, side / height])
