# SPDX-License-Identifier: Apache-2.0
"""Open-vocabulary detectors of transformers, frozen: the box with the highest score counts (paper, 3).

Each kind of model finds candidates in its own way: a class in a file of its own, and an entry in `KINDS` by
the `model_type` of its config.json. What they have in common is `ZeroShotDetector`.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import Tensor
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
from .grounding_dino import GroundingDinoCandidates
from .owl import OwlCandidates
from .pretrained import find_backbone, load_pretrained
from .taught import TaughtThings

# OWLv2 looks at 3600 patches of an image: a whole training batch at once would not fit into memory.
IMAGES_AT_ONCE = 8
# So much of a box has to be in the image (our decision): boxes of training end where the image does.
MOSTLY = 0.75
# A darker image, by the mean of its pixels, is brightened to this, at most so many times.
DARK, MOST_GAIN = 0.4, 10.0


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
