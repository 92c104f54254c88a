# SPDX-License-Identifier: Apache-2.0
"""What a policy knows of an image: the only difference between OWLxT5 and CrossT5."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import torch
from lerobot.utils.constants import ACTION
from torch import Tensor, nn
from tqdm import tqdm

from .backbones.detections import Detections, Detector, same_place
from .backbones.ground_truth import BOX_NUMBERS, GroundTruthDetector
from .backbones.zero_shot import ZeroShotDetector
from .commands.instruction import NOTHING_KNOWN, NOTHING_MOVED
from .configuration_owlxt5 import CENTRE, GROUND_TRUTH, OWLxT5Config
from .data.episode_store import EpisodeStore
from .data.windows import at_step, observation_at, recover_actions
from .model.autoencoder import ChannelSeparatedAutoencoder

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
# CLANT's 1080 training episodes begin with 90 pictures, which are soon learnt by heart. With noise of this
# standard deviation in training, more of the pictures that it never saw are read rightly (measured).
FEATURE_NOISE = 0.15
# A feature that varies less than this is not blown up.
SMALLEST_RANGE = 1e-6


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


class AutoencoderFeatures(nn.Module):
    """CrossT5's: 30 features of each frame, from an autoencoder that stays as it is.

    It sees whole images and no objects, so it cannot miss one. A checkpoint holds its weights.
    """

    names_objects = False
    lowest: Tensor
    highest: Tensor

    def __init__(self, camera: str, max_episode_steps: int) -> None:
        super().__init__()
        self.autoencoder = ChannelSeparatedAutoencoder().requires_grad_(False)
        # What the features of the training data's first frames lie between.
        self.register_buffer("lowest", -torch.ones(self.autoencoder.dim_output))
        self.register_buffer("highest", torch.ones(self.autoencoder.dim_output))
        self._camera = camera
        self._steps = max_episode_steps
        self._cache: dict[int, Tensor] = {}

    def can_read(self, names: Sequence[str]) -> bool:
        """See `VisualEncoder`: no name is looked for."""
        return True

    def encode(self, batch: Mapping[str, Any], names: Sequence[str]) -> VisualInput:
        """See `VisualEncoder`: one frame, or an episode's frames, (batch, 1 or L, 30)."""
        images: Tensor = batch[self._camera]
        features = self.autoencoder.encode_frames(images if images.ndim == 5 else images[:, None])
        if features.shape[1] > 1:
            features, _ = recover_actions(features, batch[f"{self._camera}_is_pad"])
        return self._input(features)

    def encode_cached(
        self, batch: Mapping[str, Any], names: Sequence[str], episodes: EpisodeStore
    ) -> VisualInput:
        """See `VisualEncoder`; each frame of the dataset is encoded once.

        This waits for the first batch, when the weights are loaded and on their device. Like the joints'
        range, the features' range is that of the data on which the policy is trained last. It is the range of
        first frames: they show which object is where, and over all frames the arms vary six times as much.
        """
        indices = batch["episode_index"].flatten().tolist()
        if not self._cache:
            camera = episodes.frames.find_camera(indices, at_step(batch[self._camera], 0))
            step = torch.arange(self._steps)
            frames = tqdm(
                episodes.frames.read(camera), "Encoding all frames", total=len(episodes), unit="episode"
            )
            self._cache = {
                episode: self.autoencoder.encode_frames(images)[step.clamp(max=len(images) - 1)]
                for episode, images in frames
            }
            first = torch.stack([features[0] for features in self._cache.values()])
            self.lowest, self.highest = first.amin(dim=0), first.amax(dim=0)
        seen = self._input(torch.stack([self._cache[episode] for episode in indices]))
        if not self.training:
            return seen
        noise = FEATURE_NOISE * torch.randn_like(seen.features)
        return VisualInput(seen.features + noise, seen.object_found)

    def find_moved(self, batch: Mapping[str, Any], labels: Sequence[str]) -> MovedObjects:
        """See `VisualEncoder`; which object moved is for the network to tell."""
        features, seen = self.encode(batch, ())
        return MovedObjects(features, seen, [""] * len(features))

    def _input(self, features: Tensor) -> VisualInput:
        """Scale features to [-1, 1], like the joints."""
        half = ((self.highest - self.lowest) / 2).clamp(min=SMALLEST_RANGE)
        scaled = (features - (self.highest + self.lowest) / 2) / half
        return VisualInput(scaled, torch.ones(len(scaled), dtype=torch.bool, device=scaled.device))


def _best_label(detections: Detections) -> Tensor:
    """Which labels say best what is at their place, (samples, labels) bool."""
    same = same_place(detections.centre[:, :, None], detections.centre[:, None])
    return detections.score == torch.where(same, detections.score[:, None], 0.0).amax(dim=-1)
