# SPDX-License-Identifier: Apache-2.0
"""The policy OWLxT5: "Open-Vocabulary Robotic Object Manipulation using Foundation Models"."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from . import modes
from .commands import named_objects, parse_command
from .configuration_owlxt5 import CENTRE, OWLxT5Config
from .crossmodal_policy import NOTHING_MOVED, CrossmodalPolicy, View
from .detection import Detections, RememberedDetections, make_detector, same_place

# In describe names compete for what is seen, and one that counts must leave its place: weaker scores will do.
DESCRIBE_THRESHOLD_SHARE = 0.5
# An object is gone from a place where its score has fallen below this share of what it was.
GONE = 0.5


class OWLxT5Policy(CrossmodalPolicy):
    """Its eyes are a detector, which tells where an object is that it need not have been trained on."""

    config_class = OWLxT5Config
    name = "owlxt5"
    dim_visual = 2
    config: OWLxT5Config

    def __init__(self, config: OWLxT5Config, *args: Any, **kwargs: Any) -> None:
        """Make the policy: see `CrossmodalPolicy`."""
        super().__init__(config, *args, **kwargs)
        self.detector = make_detector(config)
        self._remembered_detections = RememberedDetections(self.detector)

    def _watch(self, batch: dict[str, Any]) -> View:
        return self._view(self.detector(batch, [[name] for name in _objects(batch)]))

    def _remember(self, batch: dict[str, Any]) -> View:
        return self._view(self._remembered_detections(batch, _objects(batch)))

    def _view(self, detections: Detections) -> View:
        """Where the one object of each sample is; 0 if it was not seen."""
        found = detections.score >= self.detector.threshold
        return View(torch.where(found[..., None], self._points(detections), 0.0), found[:, 0])

    def _points(self, detections: Detections) -> Tensor:
        """The object points, scaled to [-1, 1] like the joints; (samples, names, 2)."""
        config = self.config
        point = detections.centre if config.object_point == CENTRE else detections.foot(config.nadir)
        return 2 * point - 1

    def _describe_prompt(self, task: str) -> str:
        return modes.describe_prompt(parse_command(task).object)

    @torch.no_grad()
    def describe(self, batch: dict[str, Any], labels: Sequence[str] | None = None) -> list[str]:
        """Say what was done to which object: see `CrossmodalPolicy`.

        The detector looks for all labels in the first frame, and in the last one at the same places: what it
        finds there least of all goes into the prompt. That is our reading of the paper, whose prompt names no
        object. Of several labels for one object that with the best score stands.
        """
        self.eval()
        names = list(labels) if labels is not None else self._trained_objects()
        joints = self._recorded_joints(batch)
        asked = [names] * len(joints)
        before = self.detector(batch, asked, step=0)
        after = self.detector(batch, asked, step=-1, near=before.centre)
        known = _best_label(before) & (before.score >= DESCRIBE_THRESHOLD_SHARE * self.detector.threshold)
        still_there, moved = torch.where(known, after.score / before.score, 1.0).min(dim=1)
        has_moved = still_there < GONE
        point = self._points(before).gather(1, moved[:, None, None].expand(-1, -1, self.dim_visual))
        visual = torch.where(has_moved[:, None, None], point, 0.0)
        prompts = [modes.describe_prompt(names[index]) for index in moved.tolist()]
        texts = self._speak(prompts, visual, joints)
        return [
            text if any_moved else NOTHING_MOVED
            for text, any_moved in zip(texts, has_moved.tolist(), strict=True)
        ]

    def _trained_objects(self) -> list[str]:
        names = named_objects(self.config.tasks or [])
        if not names:
            raise ValueError("The policy was not trained, so it knows no objects to look for: pass `labels`.")
        return names


def _objects(batch: dict[str, Any]) -> list[str]:
    return [parse_command(task).object for task in batch["task"]]


def _best_label(detections: Detections) -> Tensor:
    """Which labels say best what is at their place, (samples, labels) bool."""
    same = same_place(detections.centre[:, :, None], detections.centre[:, None])
    return detections.score == torch.where(same, detections.score[:, None], 0.0).amax(dim=-1)
