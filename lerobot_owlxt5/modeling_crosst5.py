# SPDX-License-Identifier: Apache-2.0
"""The policy CrossT5: "Enabling action crossmodality for a pretrained large language model"."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.pretrained import PreTrainedPolicy
from torch import Tensor
from torch.nn.functional import mse_loss
from tqdm import tqdm

from . import modes
from .autoencoder import ChannelSeparatedAutoencoder, resize
from .configuration_crosst5 import EYES_STAGE, CrossT5Config
from .crossmodal_policy import CrossmodalPolicy, View
from .episodes import at_step, recover_actions
from .frames import read_episodes

if TYPE_CHECKING:
    from lerobot.datasets import LeRobotDatasetMetadata

# A feature that varies less than this is not blown up.
SMALLEST_RANGE = 1e-6
_GIVE_A_CHECKPOINT = (
    "Give the folder pretrained_model, or the Hub id, of a training with "
    f"--policy.type=crosst5 --policy.stage={EYES_STAGE}."
)


class CrossT5Policy(CrossmodalPolicy):
    """Its eyes are an autoencoder, which was trained to tell apart the pictures that it knows.

    It sees whole pictures and no objects, so it cannot miss one: every command that it knows is carried out.
    """

    config_class = CrossT5Config
    name = "crosst5"
    dim_visual = ChannelSeparatedAutoencoder.dim_output
    config: CrossT5Config
    lowest: Tensor
    highest: Tensor

    def __init__(
        self,
        config: CrossT5Config,
        dataset_meta: "LeRobotDatasetMetadata | None" = None,
        **kwargs: Any,
    ) -> None:
        """Make the policy: see `CrossmodalPolicy`.

        Raises:
            ValueError: If a new policy of the stage `crossmodal` is given no eyes, or something else.
            OSError: If its eyes cannot be loaded.
        """
        if config.stage == EYES_STAGE:
            # The eyes learn alone: without language model and core, and from episodes of any length.
            PreTrainedPolicy.__init__(self, config)
            config.validate_features()
        else:
            super().__init__(config, dataset_meta, **kwargs)
        self.autoencoder = ChannelSeparatedAutoencoder()
        if config.stage != EYES_STAGE:
            self.autoencoder.requires_grad_(False)
            # What the features of all frames of the training data lie between.
            self.register_buffer("lowest", -torch.ones(self.dim_visual))
            self.register_buffer("highest", torch.ones(self.dim_visual))
            # The weights of a policy that goes on, or does not train, come from its own checkpoint.
            if dataset_meta is not None and config.pretrained_path is None:
                self.autoencoder.load_state_dict(_load_eyes(config.autoencoder).state_dict())
        self._dataset_meta = dataset_meta
        self._episodes: dict[int, Tensor] = {}

    # Eyes ---------------------------------------------------------------------------------------------------

    def forward(self, batch: dict[str, Any]) -> tuple[Tensor, dict[str, float]]:
        """Compute the loss of a batch.

        In the stage `eyes` it is the mean squared error of the reconstruction of single frames, shares of the
        full brightness; its term `grey_levels` is the root of it, of 255. Else see `CrossmodalPolicy`.
        """
        if self.config.stage != EYES_STAGE:
            return super().forward(batch)
        images = resize(at_step(batch[self.config.camera_key], 0, ndim=4))
        loss = mse_loss(self.autoencoder(images), images)
        return loss, {"grey_levels": 255 * loss.item() ** 0.5}

    def _watch(self, batch: dict[str, Any]) -> View:
        """Features of one frame, or of an episode's frames: (batch, 1 or L, 30)."""
        self._check_whole()
        camera = self.config.camera_key
        images = batch[camera]
        visual = self.autoencoder.look(images if images.ndim == 5 else images[:, None])
        if visual.shape[1] > 1:
            visual, _ = recover_actions(visual, batch[f"{camera}_is_pad"])
        return self._view(visual)

    def _remember(self, batch: dict[str, Any]) -> View:
        if not self._episodes:
            self._episodes = self._encode_dataset()
        episodes = batch["episode_index"].flatten().tolist()
        return self._view(torch.stack([self._episodes[episode] for episode in episodes]))

    def _encode_dataset(self) -> dict[int, Tensor]:
        """Encode each frame of the training data once: (L, 30) by episode, the last frame held.

        This waits for the first batch, when the weights are loaded and on their device. Like the joints'
        range, the features' range is that of the data on which the policy is trained last.
        """
        if self._dataset_meta is None:
            raise ValueError("crosst5 trains on a LeRobotDataset: pass its metadata as `dataset_meta`.")
        episodes = tqdm(
            read_episodes(self._dataset_meta, self.config.camera_key),
            total=self._dataset_meta.total_episodes,
            desc="Encoding all frames",
            unit="episode",
        )
        steps = torch.arange(self.config.max_episode_steps)
        features = {
            episode: self.autoencoder.look(frames)[steps.clamp(max=len(frames) - 1)]
            for episode, frames in episodes
        }
        self.lowest = torch.stack([episode.amin(dim=0) for episode in features.values()]).amin(dim=0)
        self.highest = torch.stack([episode.amax(dim=0) for episode in features.values()]).amax(dim=0)
        return features

    def _check_whole(self) -> None:
        if self.config.stage == EYES_STAGE:
            raise ValueError(
                f"This checkpoint has eyes alone (--policy.stage={EYES_STAGE}) and cannot act or speak. "
                "Train the rest with --policy.type=crosst5 --policy.autoencoder=<this checkpoint>."
            )

    def _view(self, features: Tensor) -> View:
        """Scale features to [-1, 1], like the joints; there is no object that could be missed."""
        half = ((self.highest - self.lowest) / 2).clamp(min=SMALLEST_RANGE)
        visual = (features - (self.highest + self.lowest) / 2) / half
        return View(visual, torch.ones(len(visual), dtype=torch.bool, device=visual.device))

    # Modes --------------------------------------------------------------------------------------------------

    def _describe_prompt(self, task: str) -> str:
        return modes.describe_prompt()

    @torch.no_grad()
    def describe(self, batch: dict[str, Any], labels: Sequence[str] | None = None) -> list[str]:
        """Say what was done: see `CrossmodalPolicy`. The labels have no use here."""
        self.eval()
        visual = self._watch(batch).visual
        joints = self._recorded_joints(batch)
        return self._speak([modes.describe_prompt()] * len(joints), visual, joints)

    @torch.no_grad()
    def repeat_language(self, texts: Sequence[str], batch: dict[str, Any] | None = None) -> list[str]:
        """Say texts again.

        Args:
            texts: One per sample.
            batch: May hold an observation: the camera's frames and the pose in `observation.state`, scaled.
        """
        visual = None if batch is None else self._watch(batch).visual[:, :1]
        return self._answer([modes.repeat_language_prompt(text) for text in texts], visual, batch)

    def _answer(
        self, prompts: Sequence[str], visual: Tensor | None, batch: dict[str, Any] | None
    ) -> list[str]:
        self._check_whole()
        return super()._answer(prompts, visual, batch)


def _load_eyes(name: str | None) -> ChannelSeparatedAutoencoder:
    """Load the autoencoder of a checkpoint of the first stage."""
    if name is None:
        raise ValueError(f"crosst5 needs trained eyes: set --policy.autoencoder. {_GIVE_A_CHECKPOINT}")
    try:
        config = PreTrainedConfig.from_pretrained(name)
        if not isinstance(config, CrossT5Config) or config.stage != EYES_STAGE:
            raise ValueError(f"it is a checkpoint of another kind ({config.type}).")
        config.device = "cpu"
        return CrossT5Policy.from_pretrained(name, config=config).autoencoder
    except (OSError, ValueError, RuntimeError) as error:
        reason = str(error).strip().splitlines()[0]
        raise OSError(
            f"--policy.autoencoder={name} cannot be loaded: {reason} {_GIVE_A_CHECKPOINT}"
        ) from error
