# SPDX-License-Identifier: Apache-2.0
"""The policy CrossT5Autoencoder: the first of CrossT5's two trainings."""

from typing import Any, NoReturn, Self

from lerobot.configs import PreTrainedConfig
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor, nn
from torch.nn.functional import mse_loss

from .configuration_crosst5_autoencoder import CrossT5AutoencoderConfig
from .data.windows import at_step
from .losses import reduce_loss
from .model.autoencoder import ChannelSeparatedAutoencoder, resize

_GIVE_A_CHECKPOINT = (
    "Give the folder pretrained_model, or the Hub id, of a training with --policy.type=crosst5_autoencoder."
)


class CrossT5AutoencoderPolicy(PreTrainedPolicy):
    """Learns to reconstruct single frames; it cannot act.

    Its checkpoint is what `--policy.type=crosst5 --policy.autoencoder=…` reads.
    """

    config_class = CrossT5AutoencoderConfig
    name = "crosst5_autoencoder"

    def __init__(self, config: CrossT5AutoencoderConfig, **kwargs: Any) -> None:
        """Make the autoencoder; its features are checked here."""
        super().__init__(config)
        config.validate_features()
        self.config: CrossT5AutoencoderConfig = config
        self.autoencoder = ChannelSeparatedAutoencoder()

    @classmethod
    def from_pretrained(cls, *args: Any, strict: bool = True, **kwargs: Any) -> Self:
        """Load a checkpoint as LeRobot does, but refuse weights of another model: see `CrossmodalPolicy`."""
        return super().from_pretrained(*args, strict=strict, **kwargs)

    def get_optim_params(self) -> list[nn.Parameter]:
        """All parameters."""
        return list(self.parameters())

    def forward(self, batch: dict[str, Any], reduction: str = "mean") -> tuple[Tensor, dict[str, float]]:
        """Compute the mean squared error of reconstructed frames, shares of the full brightness.

        Args:
            batch: The camera's frames (batch, 3, height, width) in [0, 1].
            reduction: `mean`, or `none` for the loss of each frame, (batch,).

        Returns:
            The loss, and `grey_levels`, the root of its mean, of 255.
        """
        images = resize(at_step(batch[self.config.camera_key], 0))
        made = self.autoencoder(images)
        loss = mse_loss(made, images)
        each = loss if reduction == "mean" else (made - images).square().mean(dim=(1, 2, 3))
        return reduce_loss(each, reduction), {"grey_levels": 255 * loss.item() ** 0.5}

    def reset(self) -> None:
        """There is nothing to forget."""

    def select_action(self, batch: dict[str, Any], **kwargs: Any) -> NoReturn:
        """Refuse: see the class.

        Raises:
            ValueError: Always.
        """
        raise ValueError(
            "This checkpoint is CrossT5's autoencoder alone and cannot act or speak. Train the rest with "
            "--policy.type=crosst5 --policy.autoencoder=<this checkpoint>."
        )

    predict_action_chunk = select_action


def load_autoencoder(name: str | None) -> ChannelSeparatedAutoencoder:
    """Load the autoencoder of a checkpoint.

    Args:
        name: Folder or Hub id.

    Raises:
        ValueError: If no checkpoint is named.
        OSError: If it cannot be loaded, or holds another policy.
    """
    if name is None:
        raise ValueError(
            f"crosst5 needs a trained autoencoder: set --policy.autoencoder. {_GIVE_A_CHECKPOINT}"
        )
    try:
        config = PreTrainedConfig.from_pretrained(name)
        if not isinstance(config, CrossT5AutoencoderConfig):
            raise ValueError(f"it is a checkpoint of another kind ({config.type}).")
        config.device = "cpu"
        return CrossT5AutoencoderPolicy.from_pretrained(name, config=config).autoencoder
    except (OSError, ValueError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[0]
        raise OSError(
            f"--policy.autoencoder={name} cannot be loaded: {reason} {_GIVE_A_CHECKPOINT}"
        ) from error
