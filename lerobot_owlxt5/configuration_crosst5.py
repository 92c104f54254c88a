# SPDX-License-Identifier: Apache-2.0
"""Configuration of the policy CrossT5."""

from dataclasses import dataclass, field

from lerobot.configs import PreTrainedConfig
from lerobot.optim import AdamConfig

from .configuration_crossmodal import CrossmodalConfig

EYES_STAGE, CROSSMODAL_STAGE = "eyes", "crossmodal"


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
    """Configuration of CrossT5, whose eyes are an autoencoder that is trained before the rest.

    Args:
        stage: `eyes` trains the autoencoder alone, on single frames; `crossmodal` trains the core with the
            eyes that `autoencoder` names, which stay as they are.
        autoencoder: Checkpoint of the first stage: the folder `pretrained_model` or a Hub id. It is read
            once; a checkpoint of the second stage holds the eyes too.
        eyes_lr: Learning rate of Adam in the stage `eyes`; `optimizer_lr` is the other stage's.
    """

    stage: str = CROSSMODAL_STAGE
    autoencoder: str | None = None
    eyes_lr: float = 1e-3
    mode_probabilities: dict[str, float] = field(default_factory=_default_mode_probabilities)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.stage not in (EYES_STAGE, CROSSMODAL_STAGE):
            raise ValueError(
                f"--policy.stage={self.stage} is unknown; the stages are {EYES_STAGE} and {CROSSMODAL_STAGE}."
            )
        if self.stage == EYES_STAGE and self.autoencoder is not None:
            raise ValueError(
                f"--policy.autoencoder={self.autoencoder} is for --policy.stage={CROSSMODAL_STAGE}; "
                f"--policy.stage={EYES_STAGE} trains an autoencoder from the beginning."
            )

    def check_core_version(self, checkpoint: str) -> None:
        """Check a checkpoint: see `CrossmodalConfig`. Eyes alone have no core."""
        if self.stage != EYES_STAGE:
            super().check_core_version(checkpoint)

    def get_optimizer_preset(self) -> AdamConfig:
        """Adam, with the stage's learning rate."""
        return AdamConfig(lr=self.eyes_lr if self.stage == EYES_STAGE else self.optimizer_lr)

    @property
    def observation_delta_indices(self) -> list[int]:
        """The drawn frame itself for the eyes; else the episode's first, as the others are remembered."""
        return [0] if self.stage == EYES_STAGE else super().observation_delta_indices

    @property
    def describe_delta_indices(self) -> list[int]:
        """A window that covers all frames of a finished episode: CrossT5 watches it from first to last."""
        return self.episode_delta_indices
