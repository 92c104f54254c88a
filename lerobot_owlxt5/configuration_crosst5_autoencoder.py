# SPDX-License-Identifier: Apache-2.0
"""Configuration of the policy CrossT5Autoencoder, which makes what CrossT5 sees with."""

from dataclasses import dataclass, field

from lerobot.configs import FeatureType, NormalizationMode, PolicyFeature, PreTrainedConfig
from lerobot.optim import AdamConfig

from .camera import choose_camera


@PreTrainedConfig.register_subclass("crosst5_autoencoder")
@dataclass
class CrossT5AutoencoderConfig(PreTrainedConfig):
    """CrossT5's autoencoder learns to reconstruct single frames, from episodes of any length.

    Args:
        camera: Image feature to look at. None: `observation.images.eyes`, or the only camera.
        optimizer_lr: Learning rate of Adam.
    """

    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: {"VISUAL": NormalizationMode.IDENTITY}
    )

    camera: str | None = None
    optimizer_lr: float = 1e-3

    def validate_features(self) -> None:
        """Keep the one camera.

        Raises:
            ValueError: If there is none, or several and none is named.
        """
        inputs: dict[str, PolicyFeature] = self.input_features or {}  # type: ignore[has-type]
        cameras = [key for key, feature in inputs.items() if feature.type is FeatureType.VISUAL]
        camera = choose_camera(cameras, self.camera, self.type)
        self.input_features = {camera: inputs[camera]}

    @property
    def camera_key(self) -> str:
        """The one camera that is left after `validate_features`."""
        return next(iter(self.image_features))

    def get_optimizer_preset(self) -> AdamConfig:
        """Adam (our decision)."""
        return AdamConfig(lr=self.optimizer_lr)

    def get_scheduler_preset(self) -> None:
        """The learning rate stays constant."""

    @property
    def observation_delta_indices(self) -> list[int]:
        """The drawn frame itself."""
        return [0]

    @property
    def action_delta_indices(self) -> None:
        """No actions."""
        return None

    @property
    def reward_delta_indices(self) -> None:
        """No rewards."""
        return None
