# SPDX-License-Identifier: Apache-2.0
"""CrossT5's visual encoder: features of whole images."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor, nn
from tqdm import tqdm

from .data.episode_store import EpisodeStore
from .data.windows import at_step, recover_actions
from .model.autoencoder import ChannelSeparatedAutoencoder
from .visual_encoder import MovedObjects, VisualInput

# CLANT's 1080 training episodes begin with 120 pictures, which are soon learnt by heart with their actions.
# With noise of this standard deviation in training, more of the other actions are right (measured).
FEATURE_NOISE = 0.15
# A feature that varies less than this is not blown up.
SMALLEST_RANGE = 1e-6


class AutoencoderFeatures(nn.Module):
    """CrossT5's: 30 features of each frame, from an autoencoder that stays as it is.

    It sees whole images and no objects, so it cannot miss one. A checkpoint holds its weights.
    """

    names_objects = False
    lowest: Tensor
    highest: Tensor

    def __init__(self, camera: str, max_episode_steps: int) -> None:
        super().__init__()
        self.autoencoder = ChannelSeparatedAutoencoder().requires_grad_(False)
        # What the features of the training data's first frames lie between.
        self.register_buffer("lowest", -torch.ones(self.autoencoder.dim_output))
        self.register_buffer("highest", torch.ones(self.autoencoder.dim_output))
        self._camera = camera
        self._steps = max_episode_steps
        self._cache: dict[int, Tensor] = {}
        self._is_scaled = False

    def can_read(self, names: Sequence[str]) -> bool:
        """See `VisualEncoder`: no name is looked for."""
        return True

    def encode(self, batch: Mapping[str, Any], names: Sequence[str]) -> VisualInput:
        """See `VisualEncoder`: one frame, or an episode's frames, (batch, 1 or L, 30)."""
        images: Tensor = batch[self._camera]
        features = self.autoencoder.encode_frames(images if images.ndim == 5 else images[:, None])
        if features.shape[1] > 1:
            features, _ = recover_actions(features, batch[f"{self._camera}_is_pad"])
        return self._input(features)

    def encode_cached(
        self, batch: Mapping[str, Any], names: Sequence[str], episodes: EpisodeStore
    ) -> VisualInput:
        """See `VisualEncoder`; each frame of the dataset is encoded once.

        This waits for the first batch, when the weights are loaded and on their device. Like the joints'
        range, the features' range is that of the data on which the policy is trained last. It is the range of
        first frames: they show which object is where, and over all frames the arms vary six times as much.
        """
        indices = batch["episode_index"].flatten().tolist()
        if not self._cache:
            camera = episodes.frames.find_camera(indices, at_step(batch[self._camera], 0))
            step = torch.arange(self._steps)
            frames = tqdm(
                episodes.frames.read(camera), "Encoding all frames", total=len(episodes), unit="episode"
            )
            self._cache = {
                episode: self.autoencoder.encode_frames(images)[step.clamp(max=len(images) - 1)]
                for episode, images in frames
            }
        if self.training and not self._is_scaled:
            first = torch.stack([features[0] for features in self._cache.values()])
            self.lowest, self.highest = first.amin(dim=0), first.amax(dim=0)
            self._is_scaled = True
        seen = self._input(torch.stack([self._cache[episode] for episode in indices]))
        if not self.training:
            return seen
        noise = FEATURE_NOISE * torch.randn_like(seen.features)
        return VisualInput(seen.features + noise, seen.object_found)

    def find_moved(self, batch: Mapping[str, Any], labels: Sequence[str]) -> MovedObjects:
        """See `VisualEncoder`; which object moved is for the network to tell."""
        features, seen = self.encode(batch, ())
        return MovedObjects(features, seen, [""] * len(features))

    def _input(self, features: Tensor) -> VisualInput:
        """Scale features to [-1, 1], like the joints."""
        half = ((self.highest - self.lowest) / 2).clamp(min=SMALLEST_RANGE)
        scaled = (features - (self.highest + self.lowest) / 2) / half
        return VisualInput(scaled, torch.ones(len(scaled), dtype=torch.bool, device=scaled.device))
