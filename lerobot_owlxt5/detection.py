# SPDX-License-Identifier: Apache-2.0
"""The eyes: where in the image is the object with this name? OWLv2, or the simulator's ground truth."""

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import torch
from torch import Tensor
from transformers import Owlv2ForObjectDetection, Owlv2Processor

from .commands import object_name, plain
from .configuration_owlxt5 import GROUND_TRUTH, NO_OBJECTS, OBS_OBJECTS, OWLxT5Config
from .episodes import at_step
from .pretrained import EMBEDDED, find_backbone, load_pretrained

# Per object: a box of 4 numbers and its name as 24 bytes.
OBJECT_NUMBERS, BOX_NUMBERS = 28, 4
# OWLv2 looks at 3600 patches of an image: a whole training batch at once would not fit into memory.
IMAGES_AT_ONCE = 8
USUAL_THRESHOLD = 0.1
SAME_PLACE = 0.02
"""Centres closer than this share of the image are at one place: the detector's noise."""


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

    def foot(self, nadir: float | None) -> Tensor:
        """Where upright objects touch the table: in the box's lower edge, under its middle.

        In a picture from above, uprights lean away from the middle; their lines meet at the nadir.

        Args:
            nadir: Where straight down is in the picture, in the column of its middle: the row as a share of
                the height; more than 1 lies below the picture. None: uprights stand upright in the picture.

        Returns:
            (batch, names, 2), x and y.
        """
        x, y = self.centre.unbind(dim=-1)
        lower = self.box[..., 3]
        if nadir is not None:
            x = 0.5 + (x - 0.5) * (nadir - lower) / (nadir - y)
        return torch.stack([x, lower], dim=-1)


class Detector(Protocol):
    """Finds named objects in one frame of each sample of a batch.

    Attributes:
        threshold: From this score on an object counts as seen.
    """

    threshold: float

    def __call__(
        self,
        batch: dict[str, Any],
        names: Sequence[Sequence[str]],
        step: int = 0,
        near: Tensor | None = None,
    ) -> Detections:
        """Detect.

        Args:
            batch: A batch as the policy gets it.
            names: For each sample, the names to look for; the same number for each sample.
            step: Which of the batch's observation steps to look at.
            near: (batch, names, 2), shares of the image: only boxes whose centre is at this place count,
                `SAME_PLACE` about it.
        """


def make_detector(config: OWLxT5Config) -> Detector:
    """Make the detector that the configuration names, and note there which of the Hub's commits it is."""
    if config.detector == GROUND_TRUTH:
        return GroundTruthDetector()
    detector = Owlv2Detector(
        config.detector, config.detector_revision, config.score_threshold, config.camera_key
    )
    config.detector_revision = detector.revision
    return detector


class GroundTruthDetector:
    """Reads the simulator's boxes from `observation.objects`: an upper bound for any real detector."""

    threshold = 0.5

    def __call__(
        self,
        batch: dict[str, Any],
        names: Sequence[Sequence[str]],
        step: int = 0,
        near: Tensor | None = None,
    ) -> Detections:
        """Detect: see `Detector`."""
        if OBS_OBJECTS not in batch:
            raise ValueError(NO_OBJECTS)
        objects = at_step(batch[OBS_OBJECTS], step, ndim=2).unflatten(1, (-1, OBJECT_NUMBERS)).float()
        boxes = objects[..., :BOX_NUMBERS]
        visible = (boxes >= 0).all(dim=-1)
        spellings = objects[..., BOX_NUMBERS:].round().to(torch.uint8).cpu().numpy()
        present = [[bytes(slot).rstrip(b"\0").decode() for slot in sample] for sample in spellings]
        slot = torch.tensor(
            [[_find(name, objects) for name in asked] for asked, objects in zip(names, present, strict=True)],
            device=boxes.device,
        )
        index = slot.clamp(min=0)
        score = (slot >= 0) & visible.gather(1, index)
        found = Detections(boxes.gather(1, index[..., None].expand(-1, -1, BOX_NUMBERS)), score.float())
        return found if near is None else found._replace(score=found.score * same_place(found.centre, near))


def _find(name: str, present: Sequence[str]) -> int:
    """Index of the one object that a name fits, or -1: "red cube" fits "red", "bottle" not two bottles."""
    asked = plain(name)
    exact = [slot for slot, other in enumerate(present) if plain(other) == asked]
    words = set(asked.split())
    similar = [
        slot
        for slot, other in enumerate(present)
        if words and other and (words <= set(plain(other).split()) or words >= set(plain(other).split()))
    ]
    return next((matches[0] for matches in (exact, similar) if len(matches) == 1), -1)


class Owlv2Detector:
    """OWLv2 (paper, section 3), frozen: the box with the highest score is the object.

    Like the frozen language model it is no part of the policy's module tree.
    """

    def __init__(self, name: str, revision: str | None, threshold: float | None, camera: str) -> None:
        """Load it.

        Args:
            name: Hub id, folder, or `embedded`.
            revision: Hub revision, or what an embedded one was before; or None.
            threshold: From this score on an object counts as seen. None: the `score_threshold` in the model's
                config.json, or OWLv2's usual 0.1.
            camera: Image feature to look at.
        """
        where = ("--policy.detector", f"{EMBEDDED}, {GROUND_TRUTH}, or a folder that holds an OWLv2")
        name, revision = find_backbone(name, "eyes", revision)
        self.processor = load_pretrained(Owlv2Processor, name, revision, *where)
        self.model = load_pretrained(
            Owlv2ForObjectDetection, name, revision, *where, use_safetensors=True, dtype=torch.float32
        )
        self.model.requires_grad_(False).eval()
        # The Hub's commit, or the digest of embedded weights; None for a folder.
        self.revision: str | None = self.model.config._commit_hash or revision
        own = getattr(self.model.config, "score_threshold", USUAL_THRESHOLD)
        self.threshold = own if threshold is None else threshold
        self.camera = camera

    def __call__(
        self,
        batch: dict[str, Any],
        names: Sequence[Sequence[str]],
        step: int = 0,
        near: Tensor | None = None,
    ) -> Detections:
        """Detect: see `Detector`."""
        images = at_step(batch[self.camera], step, ndim=4)
        if images.dtype == torch.uint8:
            images = images / 255
        parts = [
            self._detect(images[part], names[part], None if near is None else near[part])
            for part in (
                slice(first, first + IMAGES_AT_ONCE) for first in range(0, len(images), IMAGES_AT_ONCE)
            )
        ]
        return Detections(*(torch.cat(tensors) for tensors in zip(*parts, strict=True)))

    @torch.no_grad()
    def _detect(self, images: Tensor, names: Sequence[Sequence[str]], near: Tensor | None) -> Detections:
        queries = [[f"a photo of a {object_name(name)}" for name in asked] for asked in names]
        inputs = self.processor(
            text=queries, images=list(images), do_rescale=False, truncation=True, return_tensors="pt"
        )
        outputs = self.model.to(images.device)(**inputs.to(images.device))
        height, width = images.shape[-2:]
        middle, half = outputs.pred_boxes[..., :2], outputs.pred_boxes[..., 2:] / 2
        corners = [to_image_coordinates(point, height, width) for point in (middle - half, middle + half)]
        boxes = torch.cat(corners, dim=-1)
        centre = to_image_coordinates(middle, height, width)[:, :, None]
        counts = ((centre >= 0) & (centre <= 1)).all(dim=-1)
        if near is not None:
            counts = counts & same_place(centre, near[:, None])
        score, index = (outputs.logits.sigmoid() * counts).max(dim=1)
        return Detections(boxes.gather(1, index[..., None].expand(-1, -1, BOX_NUMBERS)), score)


def same_place(centre: Tensor, other: Tensor) -> Tensor:
    """Which of two sets of points (..., 2), shares of the image, are closer than `SAME_PLACE`; bool (...)."""
    return (centre - other).norm(dim=-1) < SAME_PLACE


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


class RememberedDetections:
    """Remembers where an object is in an episode's first frame: that frame comes by in each epoch."""

    def __init__(self, detector: Detector) -> None:
        self.detector = detector
        self._found: dict[tuple[int, str], tuple[float, ...]] = {}

    def __call__(self, batch: dict[str, Any], names: Sequence[str]) -> Detections:
        """Detect one object per sample of a training batch, which must carry `episode_index`."""
        keys = list(zip(batch["episode_index"].flatten().tolist(), names, strict=True))
        first_seen = {key: sample for sample, key in enumerate(keys) if key not in self._found}
        if first_seen:
            chosen = list(first_seen.values())
            part = {
                key: value[chosen]
                for key, value in batch.items()
                if key.startswith("observation.") and isinstance(value, Tensor)
            }
            box, score = self.detector(part, [[names[sample]] for sample in chosen])
            found = torch.cat([box[:, 0], score], dim=1).tolist()
            self._found |= {key: tuple(numbers) for key, numbers in zip(first_seen, found, strict=True)}
        numbers = torch.tensor([self._found[key] for key in keys], device=batch["action"].device)
        return Detections(numbers[:, None, :BOX_NUMBERS], numbers[:, BOX_NUMBERS:])
