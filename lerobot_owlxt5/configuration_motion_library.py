# SPDX-License-Identifier: Apache-2.0
"""Configuration of the policy motion_library."""

from dataclasses import dataclass, field
from typing import ClassVar

from lerobot.configs import PreTrainedConfig

from .backbones.pretrained import EMBEDDED
from .configuration_owlxt5 import FOOT, OWLxT5Config
from .table_view import TableView


@PreTrainedConfig.register_subclass("motion_library")
@dataclass
class MotionLibraryConfig(OWLxT5Config):
    """Configuration of motion_library, which learns nothing: detector, camera geometry, solved motions.

    Of the options that it has in common with owlxt5, those on detector, understanding, camera,
    `max_episode_steps` and `replan_every` count. There is no network and no training that others could
    change. `object_point` and `aim_nearer` are refused: `object_depth` says where it aims. The camera's
    numbers are those of NICO's `eyes` in the world of `--env.type=clant`, computed from its MuJoCo model; a
    test compares them.

    Args:
        camera_place: Of the camera: x forward and y to the robot's left in the robot's frame, and its height
            over the table, metres.
        camera_tilt_deg: How far it looks down, from the horizon, degrees.
        camera_fovy_deg: Its vertical field of view, degrees.
        object_depth: How far an object's middle lies behind its side that is nearest to the robot, metres. By
            default that of CLANT's cubes, the mean over all turns (our decision).
    """

    modes: ClassVar[tuple[str, ...]] = ("execute",)

    detector: str = EMBEDDED
    object_point: str = FOOT
    mode_probabilities: dict[str, float] = field(default_factory=lambda: {"execute": 1.0})
    trained_modes: list[str] | None = field(default_factory=lambda: ["execute"])

    camera_place: tuple[float, float, float] = (0.148, -0.0002, 0.3178)
    camera_tilt_deg: float = 57.0
    camera_fovy_deg: float = 58.0
    object_depth: float = 0.0296

    def __post_init__(self) -> None:
        if self.object_point != FOOT or self.aim_nearer:
            raise ValueError(
                "motion_library aims by --policy.object_depth: leave --policy.object_point and "
                "--policy.aim_nearer out."
            )
        self.nadir = self._view(1.0).nadir
        super().__post_init__()

    @property
    def backbones(self) -> dict[str, tuple[str, str | None]]:
        """Name and revision of the pretrained models, by the option that names them; no language model."""
        return {name: each for name, each in super().backbones.items() if name != "language_model"}

    @property
    def can_be_blind(self) -> bool:
        """Never: the camera's image tells its width over its height."""
        return False

    @property
    def table_view(self) -> TableView:
        """The camera over the table; known after `validate_features`."""
        _, height, width = self.image_features[self.camera_key].shape
        return self._view(width / height)

    def _view(self, aspect: float) -> TableView:
        return TableView(self.camera_place, self.camera_tilt_deg, self.camera_fovy_deg, aspect)
