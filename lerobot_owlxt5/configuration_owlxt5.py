# SPDX-License-Identifier: Apache-2.0
"""Configuration of the policy OWLxT5."""

from dataclasses import dataclass
from typing import Any, ClassVar

from lerobot.configs import PreTrainedConfig

from .commands.prompts import MODES
from .configuration_crossmodal import CrossmodalConfig

GROUND_TRUTH = "ground_truth"
OBS_OBJECTS = "observation.objects"
CENTRE, FOOT = "centre", "foot"
NO_OBJECTS = (
    f"--policy.detector={GROUND_TRUTH} reads the simulator's boxes from '{OBS_OBJECTS}', which this dataset "
    "or environment does not provide. Name an OWLv2 with --policy.detector."
)


@PreTrainedConfig.register_subclass("owlxt5")
@dataclass
class OWLxT5Config(CrossmodalConfig):
    """Configuration of OWLxT5, which sees with an open-vocabulary detector.

    Args:
        detector: OWLv2, OWL-ViT or Grounding DINO: Hub id, folder, or `embedded`, the small OWLv2 in this
            package. Or `ground_truth`: the
            simulator's own boxes, which the dataset and the environment give as `observation.objects`; an
            upper bound, never to be reported as OWLv2. It needs no camera.
        detector_revision: Hub revision of the detector; None is its main branch.
        score_threshold: A detection below this score (0 to 1) counts as not seen. None: the detector's own,
            as its config.json says, or 0.1.
        object_point: Which point of its box says where an object is. `centre`: as in the paper (section 3).
            `foot`: where an upright object touches the table, in the lower edge: for objects that are not as
            tall as those of the training data and may stand anywhere (our addition).
        nadir: For `foot`: where straight down is in the image of a camera that is not tilted sideways, the
            row as a share of the image's height. NICO's camera `eyes`: 1.086. None: the camera looks ahead,
            and uprights stand upright in its image.
        aim_nearer: For `foot`: how far below the foot that it sees the robot aims, as a share of the image's
            height. The middle of a cube stands farther behind its foot than that of most things, so whoever
            learnt with cubes aims too far. NICO's camera `eyes` and CLANT's cubes: 0.0175, which is about
            1 cm (`benchmarks/ceiling.py`). Training does not use it.
    """

    dim_visual: ClassVar[int] = 2
    modes: ClassVar[tuple[str, ...]] = tuple(mode for mode in MODES if mode != "repeat_language")

    detector: str = "google/owlv2-base-patch16"
    detector_revision: str | None = None
    score_threshold: float | None = None
    object_point: str = CENTRE
    nadir: float | None = None
    aim_nearer: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.object_point not in (CENTRE, FOOT):
            raise ValueError(f"--policy.object_point is {CENTRE} or {FOOT}, not {self.object_point!r}.")
        if self.nadir is not None and (self.object_point != FOOT or self.nadir <= 1):
            raise ValueError(
                f"--policy.nadir={self.nadir} belongs to --policy.object_point={FOOT} and lies below the "
                "image, at more than 1."
            )
        if self.aim_nearer and (self.object_point != FOOT or not 0 < self.aim_nearer < 1):
            raise ValueError(
                f"--policy.aim_nearer={self.aim_nearer} belongs to --policy.object_point={FOOT} and is a "
                "share of the image's height, from 0 to 1."
            )

    def check_dataset(self, features: dict[str, Any]) -> None:
        """Check that a dataset has what the policy reads: see `CrossmodalConfig`."""
        super().check_dataset(features)
        if self.detector == GROUND_TRUTH and OBS_OBJECTS not in features:
            raise ValueError(NO_OBJECTS)

    @property
    def backbones(self) -> dict[str, tuple[str, str | None]]:
        """Name and revision of the pretrained models, by the option that names them."""
        if self.detector == GROUND_TRUTH:
            return super().backbones
        return super().backbones | {"detector": (self.detector, self.detector_revision)}

    @property
    def can_be_blind(self) -> bool:
        """Whether a dataset without any camera will do."""
        return self.detector == GROUND_TRUTH
