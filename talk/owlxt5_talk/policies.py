# SPDX-License-Identifier: Apache-2.0
"""The policy that the robot of a visitor runs on."""

from collections.abc import Callable
from copy import deepcopy
from pathlib import Path
from typing import Any

from huggingface_hub.errors import HFValidationError
from lerobot.configs import FeatureType, parser
from lerobot.envs.utils import env_to_policy_features
from lerobot.policies.factory import get_policy_class, make_pre_post_processors

import lerobot_policy_owlxt5  # noqa: F401  registers the policies and what their names must pass
from lerobot_owlxt5 import MotionLibraryConfig, MotionLibraryPolicy
from lerobot_owlxt5.backbones.taught import TaughtThings
from lerobot_owlxt5.camera import DEFAULT_CAMERA
from lerobot_owlxt5.checkpoint import load_checkpoint, read_config
from lerobot_owlxt5.configuration_owlxt5 import GROUND_TRUTH
from lerobot_owlxt5.executing_policy import ExecutingPolicy
from lerobot_owlxt5.object_point import ObjectPoint
from lerobot_owlxt5.trained import find_policy, is_there
from nico_tabletop.configuration import ClaeoEnvConfig

Processors = tuple[Any, Any]
"""LeRobot's preprocessor and postprocessor of a policy."""


def policy_maker(taught: Path | None = None) -> Callable[[], tuple[ExecutingPolicy, Processors]]:
    """What copies the policy that was chosen; without a choice the trained one of the package.

    `--policy.path` chooses: a folder, or `motion_library`, which needs no training and is also taken where
    the package came without a trained one. Each visitor needs a policy of their own: it remembers what it is
    doing, and what "it" is. All is loaded now, in this thread: while transformers loads a model, no other
    thread may compute.

    Args:
        taught: File that keeps what things look like that people teach the robot.

    Raises:
        ValueError: If there is no policy, or one that carries nothing out; or if the file cannot be used.
        OSError: If its models cannot be loaded.
    """
    path = parser.get_path_arg("policy") or (find_policy() if is_there() else MotionLibraryPolicy.name)
    policy, processors = _motion_library() if path == MotionLibraryPolicy.name else _load(Path(path))
    if taught is not None:
        _keep(policy, taught)
    policy.understand("hello")  # loads what else is only loaded when it is asked
    weights = {id(tensor): tensor for tensor in (*policy.parameters(), *policy.buffers())}

    def make() -> tuple[ExecutingPolicy, Processors]:
        copied = deepcopy(policy, {**weights})
        if taught is not None:
            _keep(copied, taught)  # others may have taught it something since
        return copied, deepcopy(processors)

    return make


def _keep(policy: ExecutingPolicy, taught: Path) -> None:
    detector = policy.visual.detector if isinstance(policy.visual, ObjectPoint) else None
    if detector is None or detector.taught is None:
        raise ValueError(f"--taught={taught} is of no use: this policy cannot learn what things look like")
    detector.taught = TaughtThings(detector.taught.detector, taught)


def _load(path: Path) -> tuple[ExecutingPolicy, Processors]:
    try:
        config = read_config(path)
    except (HFValidationError, OSError):
        raise ValueError(
            f"--policy.path={path} is no folder with a policy, nor one on the Hub that can be reached; name "
            "the folder `pretrained_model` of a checkpoint"
        ) from None
    if not issubclass(get_policy_class(config.type), ExecutingPolicy):
        raise ValueError(
            f"--policy.path={path} holds the policy '{config.type}', which cannot hold a conversation; "
            "owlxt5, crosst5 and motion_library can"
        )
    if getattr(config, "detector", None) == GROUND_TRUTH:
        raise ValueError(
            f"--policy.path={path} sees the simulator's boxes, which this robot has not: add "
            "--policy.detector=embedded"
        )
    if DEFAULT_CAMERA not in config.image_features:
        raise ValueError(
            f"--policy.path={path} sees {', '.join(config.image_features) or 'no image'}, and this robot has "
            f"{DEFAULT_CAMERA} alone"
        )
    policy, *processors = load_checkpoint(config)
    return policy, (processors[0], processors[1])


def _motion_library() -> tuple[ExecutingPolicy, Processors]:
    if given := parser.get_cli_overrides("policy"):
        raise ValueError(f"--policy.path={MotionLibraryPolicy.name} takes no {given[0]} here: leave it out")
    features = env_to_policy_features(ClaeoEnvConfig())
    config = MotionLibraryConfig(
        device="cpu",
        input_features={key: each for key, each in features.items() if each.type is not FeatureType.ACTION},
        output_features={key: each for key, each in features.items() if each.type is FeatureType.ACTION},
    )
    return MotionLibraryPolicy(config), make_pre_post_processors(config)
