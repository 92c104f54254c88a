# SPDX-License-Identifier: Apache-2.0
"""Pre- and post-processing of the policy motion_library: joints are scaled by the range of its motions."""

from typing import Any

import torch
from lerobot.processor import PolicyAction, PolicyProcessorPipeline
from lerobot.utils.constants import ACTION, OBS_STATE

from .configuration_motion_library import MotionLibraryConfig
from .motion_library import MotionLibrary
from .processor_owlxt5 import make_owlxt5_pre_post_processors


def make_motion_library_pre_post_processors(
    config: MotionLibraryConfig,
    dataset_stats: dict[str, dict[str, torch.Tensor]] | None = None,
) -> tuple[
    PolicyProcessorPipeline[dict[str, Any], dict[str, Any]],
    PolicyProcessorPipeline[PolicyAction, PolicyAction],
]:
    """Make the two pipelines as for owlxt5.

    Args:
        config: The policy's configuration, after `validate_features`.
        dataset_stats: Not used: no data decides how far the motions go.

    Returns:
        The preprocessor and the postprocessor.
    """
    library = MotionLibrary()
    joints = {"min": library.low, "max": library.high}
    return make_owlxt5_pre_post_processors(config, {OBS_STATE: joints, ACTION: joints})
