# SPDX-License-Identifier: Apache-2.0
"""OWLxT5's visual encoder: where the named object is."""

import logging
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import torch
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor

from .backbones.detections import Detections, Detector, same_place
from .backbones.ground_truth import BOX_NUMBERS, GroundTruthDetector
from .backbones.zero_shot import ZeroShotDetector
from .configuration_owlxt5 import CENTRE, GROUND_TRUTH, OWLxT5Config
from .data.episode_store import EpisodeStore
from .data.windows import at_step, observation_at
from .scene import Scene, Thing
from .visual_encoder import MovedObjects, VisualInput

# In describe names compete for what is seen, and one that counts must leave its place: weaker scores will do.
DESCRIBE_THRESHOLD_SHARE = 0.5
# An object is gone from a place where its score has fallen below this share of what it was.
GONE = 0.5
# Every so many pixels of a row and rows of an image are compared.
PIXEL_STRIDE = 8
# A place where nothing is seen any more may be hidden. What moved is seen elsewhere: with this share of the
# detector's threshold, and at most a share of its box in the old one, which would be what is left to see.
# A hand hides much of what it has just moved, so what is hardly seen counts, if it is clearly elsewhere.
SEEN_ELSEWHERE, CLEARLY_SEEN = 0.15, 0.4
INSIDE, INSIDE_IF_CLEARLY_SEEN = 0.5, 0.7


class ObjectPoint:
    """OWLxT5's: a point of the named object's box, two numbers, the same at each step (paper, section 3)."""

    names_objects = True

    def __init__(self, config: OWLxT5Config) -> None:
        """Load the detector that the configuration names, and note there which of the Hub's commits it is."""
        self.detector: Detector
        if config.detector == GROUND_TRUTH:
            self.detector = GroundTruthDetector()
        else:
            self.detector = ZeroShotDetector(
                config.detector, config.detector_revision, config.score_threshold, config.camera_key
            )
            config.detector_revision = self.detector.revision
        self._config = config
        self._cache: dict[tuple[int, str], tuple[float, ...]] = {}
        self._first_frames: dict[int, int] = {}
        self._frames_change = False

    def can_read(self, names: Sequence[str]) -> bool:
        """See `VisualEncoder`."""
        return self.detector.can_read(names)

    def scenes(
        self, batch: Mapping[str, Any], labels: Sequence[str], in_english: Callable[[str], str]
    ) -> list[Scene]:
        """See `ObjectFinder`."""
        observation = observation_at(batch, 0)
        samples = range(len(batch[OBS_STATE]))
        images = [{key: value[i : i + 1] for key, value in observation.items()} for i in samples]
        return [Scene(self.detector, image, labels, in_english) for image in images]

    def features(self, batch: Mapping[str, Any], things: Sequence[Thing | None]) -> Tensor:
        """See `ObjectFinder`."""
        nothing = batch[OBS_STATE].new_zeros(BOX_NUMBERS)
        box = torch.stack([thing.box if thing else nothing for thing in things])[:, None]
        score = torch.tensor([[float(thing is not None)] for thing in things]).to(box)
        nearer = torch.stack([torch.zeros_like(score), 2 * self._config.aim_nearer * score], dim=-1)
        return self._input(Detections(box, score)).features + nearer

    def encode(self, batch: Mapping[str, Any], names: Sequence[str]) -> VisualInput:
        """See `VisualEncoder`; of several steps the first counts."""
        return self._input(self.detector(observation_at(batch, 0), [[name] for name in names]))

    def encode_cached(
        self, batch: Mapping[str, Any], names: Sequence[str], episodes: EpisodeStore
    ) -> VisualInput:
        """See `VisualEncoder`; an episode and a name are looked for once, unless its first frame changes."""
        if self._do_frames_change(batch):
            return self.encode(batch, names)
        keys = list(zip(batch["episode_index"].flatten().tolist(), names, strict=True))
        first_seen = {key: sample for sample, key in enumerate(keys) if key not in self._cache}
        if first_seen:
            chosen = list(first_seen.values())
            observation = {key: value[chosen] for key, value in observation_at(batch, 0).items()}
            box, score = self.detector(observation, [[names[sample]] for sample in chosen])
            found = torch.cat([box[:, 0], score], dim=1).tolist()
            self._cache |= {key: tuple(numbers) for key, numbers in zip(first_seen, found, strict=True)}
        numbers = torch.tensor([self._cache[key] for key in keys], device=batch[ACTION].device)
        return self._input(Detections(numbers[:, None, :BOX_NUMBERS], numbers[:, BOX_NUMBERS:]))

    def find_moved(self, batch: Mapping[str, Any], labels: Sequence[str]) -> MovedObjects:
        """See `VisualEncoder`.

        The detector looks for all labels in the first image, and in the last one at the same places. The
        label whose score there has fallen to the smallest share counts. That is our reading of the paper,
        whose prompt names no object. Of several labels for one object the one with the best score stands.
        An arm may hide a place, so the object must also be seen elsewhere, where no other one was.
        """
        first, last = observation_at(batch, 0), observation_at(batch, -1)
        asked = [list(labels)] * len(batch[ACTION])
        before, proposed = self.detector(first, asked), self.detector.propose(last, asked)
        at_places = proposed.at(before.centre)
        after = proposed.best(at_places)
        known = _best_label(before) & (before.score >= DESCRIBE_THRESHOLD_SHARE * self.detector.threshold)
        still_there, index = torch.where(known, after.score / before.score, 1.0).min(dim=1)
        others = known[:, None] & ~same_place(before.centre[:, :, None], before.centre[:, None])
        at_others = at_places.float() @ others.float().mT > 0
        elsewhere = proposed.best(~at_others)
        share = elsewhere.score / self.detector.threshold
        inside = torch.where(share < CLEARLY_SEEN, INSIDE, INSIDE_IF_CLEARLY_SEEN)
        seen = (share >= SEEN_ELSEWHERE) & (elsewhere.share_inside(before) < inside)
        moved = (still_there < GONE) & seen.gather(1, index[:, None])[:, 0]
        point = self._points(before).gather(1, index[:, None, None].expand(-1, -1, 2))
        features = torch.where(moved[:, None, None], point, 0.0)
        found = zip(index.tolist(), known.any(dim=1).tolist(), strict=True)
        return MovedObjects(features, moved, [labels[each] if any_known else "" for each, any_known in found])

    def _do_frames_change(self, batch: Mapping[str, Any]) -> bool:
        """Whether an episode's first frame ever came in two versions, as of --dataset.image_transforms.

        Nobody tells a policy that images are transformed, so hashes of some of their pixels are compared.
        """
        if not self._frames_change and self._config.detector != GROUND_TRUTH:
            images = at_step(batch[self._config.camera_key], 0)
            pixels = images[..., ::PIXEL_STRIDE, ::PIXEL_STRIDE].flatten(1)
            hashes = [hash(row.tobytes()) for row in pixels.cpu().numpy()]
            episodes = batch["episode_index"].flatten().tolist()
            known = [self._first_frames.setdefault(*each) for each in zip(episodes, hashes, strict=True)]
            self._frames_change = known != hashes
            if self._frames_change:
                logging.warning(
                    "First frames of episodes come in several versions (--dataset.image_transforms?), so the "
                    "detector looks at each of them. That takes time."
                )
        return self._frames_change

    def _input(self, detections: Detections) -> VisualInput:
        """Where the one object of each sample is; 0 if it was not seen."""
        found = detections.score >= self.detector.threshold
        return VisualInput(torch.where(found[..., None], self._points(detections), 0.0), found[:, 0])

    def _points(self, detections: Detections) -> Tensor:
        """The object points, scaled to [-1, 1] like the joints; (samples, names, 2)."""
        config = self._config
        point = detections.centre if config.object_point == CENTRE else detections.foot(config.nadir)
        return 2 * point - 1


def _best_label(detections: Detections) -> Tensor:
    """Which labels say best what is at their place, (samples, labels) bool."""
    same = same_place(detections.centre[:, :, None], detections.centre[:, None])
    return detections.score == torch.where(same, detections.score[:, None], 0.0).amax(dim=-1)
