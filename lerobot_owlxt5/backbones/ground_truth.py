# SPDX-License-Identifier: Apache-2.0
"""The simulator's own boxes in place of a detector: an upper bound, named so wherever it is reported."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch

from ..commands.parser import plain
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
        slot = torch.tensor(
            [[_find(name, objects) for name in asked] for asked, objects in zip(names, present, strict=True)],
            device=boxes.device,
        )
        here = slot[:, None] == torch.arange(boxes.shape[1], device=boxes.device)[:, None]
        return Candidates(boxes, (here & visible[..., None]).float())


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
