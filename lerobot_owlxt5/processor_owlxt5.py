# SPDX-License-Identifier: Apache-2.0
"""Pre- and post-processing of the policy OWLxT5: LeRobot's standard steps with one range for the joints."""

from typing import Any

import torch
from lerobot.configs import PreTrainedConfig
from lerobot.processor import PolicyAction, PolicyProcessorPipeline, make_default_pre_post_processors

from .data.normalization import share_joint_range


def make_owlxt5_pre_post_processors(
    config: PreTrainedConfig,
    dataset_stats: dict[str, dict[str, torch.Tensor]] | None = None,
) -> tuple[
    PolicyProcessorPipeline[dict[str, Any], dict[str, Any]],
    PolicyProcessorPipeline[PolicyAction, PolicyAction],
]:
    """Make the two pipelines: rename, batch, device, normalise; and unnormalise, device.

    LeRobot calls this for a new policy alone. For one that goes on it loads the saved pipelines and puts the
    dataset's statistics into them, in which the policy has shared the range (`CrossmodalPolicy`).

    Args:
        config: The policy's configuration, after `validate_features`.
        dataset_stats: Statistics of the dataset's features.

    Returns:
        The preprocessor and the postprocessor.
    """
    return make_default_pre_post_processors(config, share_joint_range(dataset_stats or {}))
