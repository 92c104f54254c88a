# SPDX-License-Identifier: Apache-2.0
"""The simulator's own boxes in place of a detector: an upper bound, named so wherever it is reported."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from ..commands.parser import object_name, plain
from ..configuration_owlxt5 import NO_OBJECTS, OBS_OBJECTS
from .detections import Candidates, Detector

# Per object: a box of 4 numbers and its name as 24 bytes.
OBJECT_NUMBERS, BOX_NUMBERS = 28, 4


class GroundTruthDetector(Detector):
    """Reads boxes and names from `observation.objects`; see `detections.Detector`."""

    threshold = 0.5
    revision: str | None = None

    def can_read(self, names: Sequence[str]) -> bool:
        """See `detections.Detector`: names are compared as they are."""
        return True

    def propose(self, observation: Mapping[str, Any], names: Sequence[Sequence[str]]) -> Candidates:
        """See `detections.Detector`.

        Raises:
            ValueError: If the observation has no `observation.objects`.
        """
        if OBS_OBJECTS not in observation:
            raise ValueError(NO_OBJECTS)
        objects = observation[OBS_OBJECTS].unflatten(1, (-1, OBJECT_NUMBERS)).float()
        boxes = objects[..., :BOX_NUMBERS]
        visible = (boxes >= 0).all(dim=-1)
        spellings = objects[..., BOX_NUMBERS:].round().to(torch.uint8).cpu().numpy()
        present = [[bytes(slot).rstrip(b"\0").decode() for slot in sample] for sample in spellings]
        fits = torch.tensor(
            [[_fit(name, objects) for name in asked] for asked, objects in zip(names, present, strict=True)],
            device=boxes.device,
        )
        return Candidates(boxes, fits.transpose(1, 2) * visible[..., None])


def _fit(name: str, present: Sequence[str]) -> list[float]:
    """How well a name fits each object: "red" fits the red cube, and "bottle" two bottles.

    With an object of this very name there, no other one is meant.
    """
    asked = plain(object_name(name))
    words = {*asked.split()}
    names = [plain(object_name(other)) if other else "" for other in present]
    if asked in names:
        return [float(other == asked) for other in names]
    others = [{*other.split()} for other in names]
    return [float(bool(words and other) and (words <= other or words >= other)) for other in others]
