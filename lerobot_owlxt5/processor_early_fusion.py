# SPDX-License-Identifier: Apache-2.0
"""Pre- and post-processing of the policy early_fusion: state and action share one range, and so bins."""

from typing import Any

import torch
from lerobot.processor import PolicyAction, PolicyProcessorPipeline, make_default_pre_post_processors

from .configuration_early_fusion import EarlyFusionConfig
from .data.normalization import share_joint_range


def make_early_fusion_pre_post_processors(
    config: EarlyFusionConfig,
    dataset_stats: dict[str, dict[str, torch.Tensor]] | None = None,
) -> tuple[
    PolicyProcessorPipeline[dict[str, Any], dict[str, Any]],
    PolicyProcessorPipeline[PolicyAction, PolicyAction],
]:
    """Make the two pipelines: rename, batch, device, normalise; and unnormalise, device.

    Args:
        config: The policy's configuration, after `validate_features`.
        dataset_stats: Statistics of the dataset's features.

    Returns:
        The preprocessor and the postprocessor.
    """
    return make_default_pre_post_processors(config, share_joint_range(dataset_stats or {}))
