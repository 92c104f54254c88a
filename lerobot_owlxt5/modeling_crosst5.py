# SPDX-License-Identifier: Apache-2.0
"""The policy CrossT5: "Enabling action crossmodality for a pretrained large language model"."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import torch

from .autoencoder_features import AutoencoderFeatures
from .commands.prompts import check_texts, repeat_language_prompt
from .configuration_crosst5 import CrossT5Config
from .modeling_crossmodal import CrossmodalPolicy
from .modeling_crosst5_autoencoder import load_autoencoder

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata


class CrossT5Policy(CrossmodalPolicy):
    """Sees whole images, as features of an autoencoder, and no objects.

    So it cannot miss an object: every command that it knows is carried out.
    """

    config_class = CrossT5Config
    name = "crosst5"
    config: CrossT5Config
    visual: AutoencoderFeatures

    def __init__(
        self,
        config: CrossT5Config,
        dataset_meta: "LeRobotDatasetMetadata | None" = None,
        **kwargs: Any,
    ) -> None:
        """Make the policy: see `CrossmodalPolicy`.

        Raises:
            ValueError: If a new policy is given no autoencoder.
            OSError: If its autoencoder cannot be loaded.
        """
        super().__init__(config, dataset_meta, **kwargs)
        self.visual = AutoencoderFeatures(config.camera_key, config.max_episode_steps)
        # The weights of a policy that goes on, or does not train, come from its own checkpoint.
        if dataset_meta is not None and config.pretrained_path is None:
            self.visual.autoencoder.load_state_dict(load_autoencoder(config.autoencoder).state_dict())

    @torch.no_grad()
    def repeat_language(self, texts: Sequence[str], batch: dict[str, Any] | None = None) -> list[str]:
        """Say texts again.

        Args:
            texts: One per sample.
            batch: May hold an observation: the camera's frames and the pose in `observation.state`, scaled.

        Raises:
            ValueError: If a text is too long.
        """
        self._begin("repeat_language")
        check_texts(texts, "`texts`")
        features = None if batch is None else self.visual.encode(batch, texts).features[:, :1]
        return self._answer([repeat_language_prompt(text) for text in texts], features, batch)
