# SPDX-License-Identifier: Apache-2.0
"""The policy that the robot of a visitor runs on."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from huggingface_hub.errors import HFValidationError
from lerobot.configs import FeatureType, PreTrainedConfig, parser
from lerobot.envs.utils import env_to_policy_features
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

import lerobot_policy_owlxt5  # noqa: F401  registers the policies and what their names must pass
from lerobot_owlxt5 import MotionLibraryConfig, MotionLibraryPolicy
from lerobot_owlxt5.executing_policy import ExecutingPolicy
from nico_tabletop.configuration import ClaeoEnvConfig

Processors = tuple[Any, Any]
"""LeRobot's preprocessor and postprocessor of a policy."""


def policy_maker() -> Callable[[], tuple[ExecutingPolicy, Processors]]:
    """What makes the policy that `--policy.path` names, or motion_library, which needs no training.

    Each visitor needs a policy of their own: it remembers what it is doing, and what "it" is.

    Raises:
        ValueError: If there is no policy, or one that carries nothing out.
    """
    path = parser.get_path_arg("policy")
    options = parser.get_yaml_overrides("policy") + (parser.get_cli_overrides("policy") or [])
    if path is None:
        return _motion_library
    try:
        config = PreTrainedConfig.from_pretrained(path, cli_overrides=options)
    except (HFValidationError, OSError):
        raise ValueError(
            f"--policy.path={path} is no folder with a policy, nor one on the Hub that can be reached; name "
            "the folder `pretrained_model` of a checkpoint"
        ) from None
    config.pretrained_path = Path(path)
    policy_class = get_policy_class(config.type)
    if not issubclass(policy_class, ExecutingPolicy):
        raise ValueError(
            f"--policy.path={path} holds the policy '{config.type}', which does not do what it is told; "
            "owlxt5, crosst5 and motion_library do"
        )

    def load() -> tuple[ExecutingPolicy, Processors]:
        overrides = {"device_processor": {"device": str(config.device)}}
        processors = make_pre_post_processors(config, path, preprocessor_overrides=overrides)
        return policy_class.from_pretrained(path, config=config), processors

    return load


def _motion_library() -> tuple[ExecutingPolicy, Processors]:
    features = env_to_policy_features(ClaeoEnvConfig())
    config = MotionLibraryConfig(
        device="cpu",
        input_features={key: each for key, each in features.items() if each.type is not FeatureType.ACTION},
        output_features={key: each for key, each in features.items() if each.type is FeatureType.ACTION},
    )
    return MotionLibraryPolicy(config), make_pre_post_processors(config)
