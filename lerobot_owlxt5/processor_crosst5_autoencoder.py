# SPDX-License-Identifier: Apache-2.0
"""Pre- and post-processing of the policy CrossT5Autoencoder: LeRobot's standard steps."""

from typing import Any

import torch
from lerobot.processor import PolicyAction, PolicyProcessorPipeline, make_default_pre_post_processors

from .configuration_crosst5_autoencoder import CrossT5AutoencoderConfig


def make_crosst5_autoencoder_pre_post_processors(
    config: CrossT5AutoencoderConfig,
    dataset_stats: dict[str, dict[str, torch.Tensor]] | None = None,
) -> tuple[
    PolicyProcessorPipeline[dict[str, Any], dict[str, Any]],
    PolicyProcessorPipeline[PolicyAction, PolicyAction],
]:
    """Make the two pipelines: rename, batch, device, normalise; and unnormalise, device."""
    return make_default_pre_post_processors(config, dataset_stats)
