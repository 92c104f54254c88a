# SPDX-License-Identifier: Apache-2.0
"""The policy OWLxT5: "Open-Vocabulary Robotic Object Manipulation using Foundation Models"."""

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from . import modes
from .commands import named_objects, parse_command
from .configuration_owlxt5 import OWLxT5Config
from .crossmodal_policy import NOTHING_MOVED, CrossmodalPolicy, View
from .detection import Detections, RememberedDetections, make_detector

# An object whose centre moved less than this share of the image has not moved: the detector's noise.
DETECTION_NOISE = 0.02


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
        return _view(self.detector(batch, [[name] for name in _objects(batch)]))

    def _remember(self, batch: dict[str, Any]) -> View:
        return _view(self._remembered_detections(batch, _objects(batch)))

    def _describe_prompt(self, task: str) -> str:
        return modes.describe_prompt(parse_command(task).object)

    @torch.no_grad()
    def describe(self, batch: dict[str, Any], labels: Sequence[str] | None = None) -> list[str]:
        """Say what was done to which object: see `CrossmodalPolicy`.

        The detector looks for all labels in the first and in the last frame; the one that moved most goes
        into the prompt, or else one that is gone: what fell over or lies behind an arm may not be recognised.
        That is our reading of the paper, whose prompt names no object. Of several labels for one object that
        with the best score stands.
        """
        self.eval()
        names = list(labels) if labels is not None else self._trained_objects()
        joints = self._recorded_joints(batch)
        asked = [names] * len(joints)
        before, after = self.detector(batch, asked, step=0), self.detector(batch, asked, step=-1)
        known, still_seen = _best_label(before), after.score > 0
        distance = torch.where(known & still_seen, (after.centre - before.centre).norm(dim=-1), 0.0)
        distance[distance <= DETECTION_NOISE] = 0.0
        gone = torch.where(known & ~still_seen, before.score, 0.0)
        sign, moved = torch.where(distance.any(dim=1, keepdim=True), distance, gone).max(dim=1)
        has_moved = sign > 0
        centre = before.centre.gather(1, moved[:, None, None].expand(-1, -1, 2))
        view = _view(Detections(centre, has_moved[:, None].float()))
        prompts = [modes.describe_prompt(names[index]) for index in moved.tolist()]
        texts = self._speak(prompts, view.visual, joints)
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
    """Which labels were found, (samples, labels) bool; of several for one object only the best."""
    centre, score = detections
    same = (centre[:, :, None] - centre[:, None]).norm(dim=-1) < DETECTION_NOISE
    best = torch.where(same, score[:, None], 0.0).amax(dim=-1)
    return (score > 0) & (score == best)


def _view(detections: Detections) -> View:
    """Centre of the one box per sample, from [0, 1] to [-1, 1] like the joints; 0 where nothing was found."""
    found = detections.score > 0
    return View(torch.where(found[..., None], 2 * detections.centre - 1, 0.0), found[:, 0])
