# SPDX-License-Identifier: Apache-2.0
"""Configuration of the policy CrossT5."""

from dataclasses import dataclass, field
from typing import ClassVar

from lerobot.configs import PreTrainedConfig

from .configuration_crossmodal import CrossmodalConfig


def _default_mode_probabilities() -> dict[str, float]:
    return {
        "execute": 0.3,
        "describe": 0.3,
        "repeat_action": 0.15,
        "repeat_language": 0.15,
        "translate": 0.1,
    }


@PreTrainedConfig.register_subclass("crosst5")
@dataclass
class CrossT5Config(CrossmodalConfig):
    """Configuration of CrossT5, which sees with an autoencoder that is trained before the rest.

    Args:
        autoencoder: Checkpoint of a training with `--policy.type=crosst5_autoencoder`: the folder
            `pretrained_model` or a Hub id. It is read once: a checkpoint of crosst5 holds its autoencoder.
    """

    dim_visual: ClassVar[int] = 30

    autoencoder: str | None = None
    mode_probabilities: dict[str, float] = field(default_factory=_default_mode_probabilities)

    @property
    def describe_delta_indices(self) -> list[int]:
        """A window that covers all frames of a finished episode: CrossT5 watches it from first to last."""
        return self.episode_delta_indices
