# SPDX-License-Identifier: Apache-2.0
"""Open-vocabulary detectors of transformers, frozen: the box with the highest score counts (paper, 3).

Each kind of model finds candidates in its own way: a class here, and an entry in `KINDS` by the `model_type`
of its config.json. What they have in common is `ZeroShotDetector`.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
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
from .appearance import Patches, as_score
from .detections import Candidates, Detector, Look
from .pretrained import find_backbone, load_pretrained
from .taught import TaughtThings

# OWLv2 looks at 3600 patches of an image: a whole training batch at once would not fit into memory.
IMAGES_AT_ONCE = 8
# Of which the embeddings are kept, a few kilobytes each.
MOST_NAMES = 1000
# So much of a box has to be in the image (our decision): boxes of training end where the image does.
MOSTLY = 0.75
# A darker image, by the mean of its pixels, is brightened to this, at most so many times.
DARK, MOST_GAIN = 0.4, 10.0


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
        middle, half = boxes[..., :2], boxes[..., 2:] / 2
        corners = [middle - half, middle + half]
        if self._pads:
            corners = [to_image_coordinates(point, *images.shape[-2:]) for point in corners]
        return torch.cat(corners, dim=-1)

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
            box, score, _ = self._propose(images, [asked[start:stop] for asked in names])
            found.append((box, nn.functional.pad(score, (start, total - stop))))
            start = stop
        boxes, scores = zip(*found, strict=True)
        return Candidates(torch.cat(boxes, dim=1), torch.cat(scores, dim=1))

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
        if isinstance(self.candidates, OwlCandidates):
            self.taught = TaughtThings(revision or name)

    def can_read(self, names: Sequence[str]) -> bool:
        """See `detections.Detector`."""
        return self.candidates.can_read([object_name(name) for name in names])

    @torch.no_grad()
    def look(self, observation: Mapping[str, Any]) -> Look:
        """See `detections.Detector`; for a few images, which are encoded at once."""
        find = self.candidates
        images = self._images(observation)
        look = find.look(images) if isinstance(find, OwlCandidates) else partial(find, images)

        @torch.no_grad()
        def candidates(names: Sequence[Sequence[str]]) -> Candidates:
            asked = _full(names)
            return only_inside(self._know_again(images, asked, look(asked)))

        return candidates

    @torch.no_grad()
    def propose(self, observation: Mapping[str, Any], names: Sequence[Sequence[str]]) -> Candidates:
        """See `detections.Detector`."""
        images, asked = self._images(observation), _full(names)
        parts = (slice(first, first + IMAGES_AT_ONCE) for first in range(0, len(images), IMAGES_AT_ONCE))
        found = [
            self._know_again(images[part], asked[part], self.candidates(images[part], asked[part]))
            for part in parts
        ]
        boxes, scores, _ = zip(*found, strict=True)
        return only_inside(Candidates(torch.cat(boxes), torch.cat(scores)))

    @torch.no_grad()
    def teach(self, name: str, observation: Mapping[str, Any], box: Tensor) -> None:
        """See `detections.Detector`."""
        found = self.look(observation)([[name]])
        assert self.taught is not None and found.embedding is not None
        patches = Patches(self._images(observation)[0], found.box[0], found.embedding[0])
        self.taught.add(object_name(name), patches.appearance(box))

    def _know_again(self, images: Tensor, names: Sequence[Sequence[str]], found: Candidates) -> Candidates:
        """The same, but names that were taught are scored by what their things look like."""
        if not self.taught or found.embedding is None:
            return found
        for sample, asked in enumerate(names):
            patches = Patches(images[sample], found.box[sample], found.embedding[sample])
            for column, name in enumerate(asked):
                if name in self.taught:
                    alike = patches.likeness(self.taught[name])
                    found.score[sample, :, column] = as_score(alike, self.threshold)
        return found

    def _images(self, observation: Mapping[str, Any]) -> Tensor:
        """The camera's images, in [0, 1]; the model moves to where they are."""
        images: Tensor = observation[self.camera]
        self.model.to(images.device)
        return _exposed(images / 255 if images.dtype == torch.uint8 else images)


def _exposed(images: Tensor) -> Tensor:
    """Brighten dark images, as a camera's automatic exposure does (our decision); others stay as they are.

    Args:
        images: (batch, 3, height, width) in [0, 1].
    """
    mean = images.mean(dim=(1, 2, 3), keepdim=True)
    return (images * (DARK / mean).clamp(1.0, MOST_GAIN)).clamp(max=1.0)


def _full(names: Sequence[Sequence[str]]) -> list[list[str]]:
    return [[object_name(name) for name in asked] for asked in names]


def only_inside(found: Candidates) -> Candidates:
    """The same, with no score for a box that lies half outside the image: perhaps a thing's second one."""
    low, high = found.box[..., :2], found.box[..., 2:]
    visible = (high.clamp(max=1) - low.clamp(min=0)).clamp(min=0).prod(dim=-1)
    inside = visible >= MOSTLY * (high - low).prod(dim=-1)
    return found._replace(score=found.score * inside[..., None])


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
