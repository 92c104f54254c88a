# SPDX-License-Identifier: Apache-2.0
"""Open-vocabulary detectors of transformers, frozen: the box with the highest score counts (paper, 3).

Each kind of model finds candidates in its own way: a class here, and an entry in `KINDS` by the `model_type`
of its config.json. What they have in common is `ZeroShotDetector`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor, nn
from transformers import (
    AutoConfig,
    AutoModelForZeroShotObjectDetection,
    GroundingDinoProcessor,
    Owlv2Processor,
    OwlViTProcessor,
)

from ..commands.parser import object_name
from .detections import Candidates, Detector
from .pretrained import find_backbone, load_pretrained

# OWLv2 looks at 3600 patches of an image: a whole training batch at once would not fit into memory.
IMAGES_AT_ONCE = 8


class OwlCandidates:
    """OWLv2 and OWL-ViT: a box for each patch of the image, scored for each name."""

    usual_threshold = 0.1

    def __init__(self, model: Any, processor: Any) -> None:
        self.model = model
        self.processor = processor
        self._pads = model.config.model_type == "owlv2"

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
        middle, half = outputs.pred_boxes[..., :2], outputs.pred_boxes[..., 2:] / 2
        corners = [middle - half, middle + half]
        if self._pads:
            corners = [to_image_coordinates(point, *images.shape[-2:]) for point in corners]
        return Candidates(torch.cat(corners, dim=-1), outputs.logits.sigmoid())


class GroundingDinoCandidates:
    """Grounding DINO: some hundred boxes, scored for each token of a caption that lists the names."""

    usual_threshold = 0.3

    def __init__(self, model: Any, processor: Any) -> None:
        self.model = model
        self.processor = processor
        self._full_stop = processor.tokenizer.convert_tokens_to_ids(".")
        self._longest = model.config.max_text_len

    def can_read(self, names: Sequence[str]) -> bool:
        """Whether the caption with all the names is no longer than what the model reads."""
        return len(self.processor.tokenizer(_caption(names))["input_ids"]) <= self._longest

    def __call__(self, images: Tensor, names: Sequence[Sequence[str]]) -> Candidates:
        """Propose boxes in images (batch, 3, height, width) in [0, 1]; a name's best token counts.

        Names that are too many for a caption are looked for in several.

        Raises:
            ValueError: If a name alone is too long.
        """
        found, start, total = [], 0, len(names[0])
        while start < total:
            stop = start + 1
            while stop < total and all(self.can_read(asked[start : stop + 1]) for asked in names):
                stop += 1
            box, score = self._propose(images, [asked[start:stop] for asked in names])
            found.append(Candidates(box, nn.functional.pad(score, (start, total - stop))))
            start = stop
        return Candidates(*(torch.cat(tensors, dim=1) for tensors in zip(*found, strict=True)))

    def _propose(self, images: Tensor, names: Sequence[Sequence[str]]) -> Candidates:
        captions = [_caption(asked) for asked in names]
        inputs = self.processor(
            text=captions, images=list(images), do_rescale=False, padding=True, return_tensors="pt"
        ).to(images.device)
        outputs = self.model(**inputs)
        tokens = inputs["input_ids"]
        if tokens.shape[1] > outputs.logits.shape[-1]:
            raise ValueError(
                f"{names[0][0]!r} is too long for the detector, which reads captions of "
                f"{outputs.logits.shape[-1]} tokens: use fewer words."
            )
        ends = tokens == self._full_stop
        # Which name a token belongs to; the full stops and what begins and ends a caption belong to none.
        name = (ends.cumsum(dim=1) - ends.long()).masked_fill(ends | (inputs["attention_mask"] == 0), -1)
        name[:, 0] = -1
        of_token = outputs.logits[..., : tokens.shape[1]].sigmoid()
        scores = [
            of_token.masked_fill((name != number)[:, None], 0.0).amax(dim=-1)
            for number in range(len(names[0]))
        ]
        middle, half = outputs.pred_boxes[..., :2], outputs.pred_boxes[..., 2:] / 2
        return Candidates(torch.cat([middle - half, middle + half], dim=-1), torch.stack(scores, dim=-1))


def _query(name: str) -> str:
    return f"a photo of a {name}"


def _caption(names: Sequence[str]) -> str:
    return " ".join(f"{name} ." for name in names)


class Kind(NamedTuple):
    """How a kind of model is read, and how it finds candidates."""

    processor: Any
    candidates: Callable[[Any, Any], OwlCandidates | GroundingDinoCandidates]


KINDS: dict[str, Kind] = {
    "owlv2": Kind(Owlv2Processor, OwlCandidates),
    "owlvit": Kind(OwlViTProcessor, OwlCandidates),
    "grounding-dino": Kind(GroundingDinoProcessor, GroundingDinoCandidates),
}
"""By `model_type`."""


class ZeroShotDetector(Detector):
    """Any detector of `KINDS`, on one camera; see `detections.Detector`.

    Like the frozen language model it is no part of the policy's module tree.
    """

    def __init__(self, name: str, revision: str | None, threshold: float | None, camera: str) -> None:
        """Load it.

        Args:
            name: Hub id, folder, or `embedded`.
            revision: Hub revision, or what an embedded one was before; or None.
            threshold: From this score on an object counts as seen. None: the `score_threshold` in the model's
                config.json, or the usual one of its kind.
            camera: Image feature to look at.

        Raises:
            OSError: If it cannot be loaded.
            ValueError: If its kind is not known.
        """
        where = (
            "--policy.detector",
            f"embedded, ground_truth, or a folder that holds one of {', '.join(KINDS)}",
        )
        found, revision = find_backbone(name, "detector", revision)
        kind = load_pretrained(AutoConfig, found, revision, *where).model_type
        if kind not in KINDS:
            raise ValueError(f"--policy.detector={name} is a {kind}; give one of {', '.join(KINDS)}.")
        processor = load_pretrained(KINDS[kind].processor, found, revision, *where)
        self.model = load_pretrained(
            AutoModelForZeroShotObjectDetection,
            found,
            revision,
            *where,
            use_safetensors=True,
            dtype=torch.float32,
        )
        self.model.requires_grad_(False).eval()
        self.candidates = KINDS[kind].candidates(self.model, processor)
        self.revision: str | None = self.model.config._commit_hash or revision
        own = getattr(self.model.config, "score_threshold", self.candidates.usual_threshold)
        self.threshold: float = own if threshold is None else threshold
        self.camera = camera

    def can_read(self, names: Sequence[str]) -> bool:
        """See `detections.Detector`."""
        return self.candidates.can_read([object_name(name) for name in names])

    def propose(self, observation: Mapping[str, Any], names: Sequence[Sequence[str]]) -> Candidates:
        """See `detections.Detector`."""
        images = observation[self.camera]
        if images.dtype == torch.uint8:
            images = images / 255
        parts = [
            self._propose(images[part], names[part])
            for part in (
                slice(first, first + IMAGES_AT_ONCE) for first in range(0, len(images), IMAGES_AT_ONCE)
            )
        ]
        return Candidates(*(torch.cat(tensors) for tensors in zip(*parts, strict=True)))

    @torch.no_grad()
    def _propose(self, images: Tensor, names: Sequence[Sequence[str]]) -> Candidates:
        self.model.to(images.device)
        full_names = [[object_name(name) for name in asked] for asked in names]
        boxes, scores = self.candidates(images, full_names)
        centre = (boxes[..., :2] + boxes[..., 2:]) / 2
        inside = ((centre >= 0) & (centre <= 1)).all(dim=-1)
        return Candidates(boxes, scores * inside[..., None])


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
