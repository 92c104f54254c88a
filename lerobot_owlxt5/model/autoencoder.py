# SPDX-License-Identifier: Apache-2.0
"""CrossT5's channel-separated convolutional autoencoder: 10 features for each colour channel."""

import torch
from torch import Tensor, nn
from torch.nn.functional import interpolate

HEIGHT, WIDTH = 120, 160
CHANNELS, FEATURES = 3, 10
# A whole episode at once, at the size of the camera's images, would not fit into every memory.
FRAMES_AT_ONCE = 32


class ChannelSeparatedAutoencoder(nn.Module):
    """One autoencoder for each of red, green and blue, so that colours cannot be mixed up in the features.

    Layers and sizes follow the autoencoder of the paired variational autoencoders (Özdemir et al., "Language
    Model-Based Paired Variational Autoencoders for Robotic Language Learning", 2022), which CrossT5 took
    over. The ReLUs between the fully connected layers and the initial weights are our decisions.
    """

    dim_output = CHANNELS * FEATURES

    def __init__(self) -> None:
        super().__init__()
        self.encoders = nn.ModuleList(_encoder() for _ in range(CHANNELS))
        self.decoders = nn.ModuleList(_decoder() for _ in range(CHANNELS))

    def forward(self, images: Tensor) -> Tensor:
        """Reconstruct images of the autoencoder's size.

        Args:
            images: (batch, 3, HEIGHT, WIDTH) in [0, 1].

        Returns:
            The same shape and range.
        """
        features = self.encode(images).chunk(CHANNELS, dim=1)
        return torch.cat([decode(part) for decode, part in zip(self.decoders, features, strict=True)], dim=1)

    def encode(self, images: Tensor) -> Tensor:
        """Encode images of the autoencoder's size.

        Args:
            images: (batch, 3, HEIGHT, WIDTH) in [0, 1].

        Returns:
            (batch, 30), not bounded: the features of red, then green, then blue.
        """
        channels = images.split(1, dim=1)
        return torch.cat([encode(part) for encode, part in zip(self.encoders, channels, strict=True)], dim=1)

    @torch.no_grad()
    def encode_frames(self, images: Tensor) -> Tensor:
        """Encode images of any size, a few at a time.

        Args:
            images: (..., 3, height, width), float in [0, 1] or uint8, on any device.

        Returns:
            (..., 30), float32, on the autoencoder's device.
        """
        device = next(self.parameters()).device
        parts = images.flatten(0, -4).split(FRAMES_AT_ONCE)
        features = torch.cat([self.encode(resize(part.to(device))).float() for part in parts])
        return features.unflatten(0, images.shape[:-3])


def resize(images: Tensor) -> Tensor:
    """Bring images to the autoencoder's size, whatever their shape, by averaging.

    Args:
        images: (batch, 3, height, width), float in [0, 1] or uint8.

    Returns:
        (batch, 3, HEIGHT, WIDTH), float in [0, 1].
    """
    images = images / 255 if images.dtype == torch.uint8 else images
    return interpolate(images, (HEIGHT, WIDTH), mode="area")


def _encoder() -> nn.Sequential:
    """(batch, 1, 120, 160) to (batch, 10)."""
    return nn.Sequential(
        *_rectified(nn.Conv2d(1, 8, 4, stride=2, padding=1)),
        *_rectified(nn.Conv2d(8, 16, 4, stride=2, padding=1)),
        *_rectified(nn.Conv2d(16, 32, 4, stride=2, padding=1)),
        *_rectified(nn.Conv2d(32, 64, 8, stride=5, padding=2)),
        nn.Flatten(),
        *_rectified(nn.Linear(64 * 3 * 4, 384)),
        *_rectified(nn.Linear(384, 192)),
        nn.Linear(192, FEATURES),
    )


def _decoder() -> nn.Sequential:
    """(batch, 10) to (batch, 1, 120, 160)."""
    return nn.Sequential(
        *_rectified(nn.Linear(FEATURES, 192)),
        *_rectified(nn.Linear(192, 384)),
        nn.Unflatten(1, (32, 3, 4)),
        *_rectified(nn.ConvTranspose2d(32, 32, 8, stride=5, padding=2, output_padding=1)),
        *_rectified(nn.ConvTranspose2d(32, 16, 4, stride=2, padding=1)),
        *_rectified(nn.ConvTranspose2d(16, 8, 4, stride=2, padding=1)),
        nn.ConvTranspose2d(8, 1, 4, stride=2, padding=1),
        nn.Sigmoid(),
    )


def _rectified(layer: nn.Linear | nn.Conv2d | nn.ConvTranspose2d) -> tuple[nn.Module, nn.ReLU]:
    """A layer and its ReLU, initialised so that what tells images apart keeps its size (He et al., 2015).

    PyTorch's own weights shrink it in each layer, and a colour can stay unseen for hundreds of steps.
    """
    inputs = layer.weight[0].numel()
    if isinstance(layer, nn.ConvTranspose2d):
        # A pixel of the output sees all channels, but only so many of the kernel's weights.
        inputs = layer.weight[:, 0].numel() // (layer.stride[0] * layer.stride[1])
    nn.init.normal_(layer.weight, std=(2 / inputs) ** 0.5)
    if layer.bias is not None:
        nn.init.zeros_(layer.bias)
    return layer, nn.ReLU()
