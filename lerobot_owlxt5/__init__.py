# SPDX-License-Identifier: Apache-2.0
"""OWLxT5, CrossT5 and rivals for LeRobot: importing this package registers their `--policy.type`."""

from typing import TYPE_CHECKING, Any

from .configuration_crosst5 import CrossT5Config
from .configuration_crosst5_autoencoder import CrossT5AutoencoderConfig
from .configuration_early_fusion import EarlyFusionConfig
from .configuration_motion_library import MotionLibraryConfig
from .configuration_owlxt5 import OWLxT5Config

if TYPE_CHECKING:
    from .data.windows import finished_episode
    from .modeling_crosst5 import CrossT5Policy
    from .modeling_crosst5_autoencoder import CrossT5AutoencoderPolicy
    from .modeling_early_fusion import EarlyFusionPolicy
    from .modeling_motion_library import MotionLibraryPolicy
    from .modeling_owlxt5 import OWLxT5Policy

__all__ = [
    "CrossT5AutoencoderConfig",
    "CrossT5AutoencoderPolicy",
    "CrossT5Config",
    "CrossT5Policy",
    "EarlyFusionConfig",
    "EarlyFusionPolicy",
    "MotionLibraryConfig",
    "MotionLibraryPolicy",
    "OWLxT5Config",
    "OWLxT5Policy",
    "finished_episode",
]

# Every lerobot-* command imports this package; torch and transformers only where a policy is made.
_LAZY = {
    "CrossT5AutoencoderPolicy": "modeling_crosst5_autoencoder",
    "CrossT5Policy": "modeling_crosst5",
    "EarlyFusionPolicy": "modeling_early_fusion",
    "MotionLibraryPolicy": "modeling_motion_library",
    "OWLxT5Policy": "modeling_owlxt5",
    "finished_episode": "data.windows",
}


def __getattr__(name: str) -> Any:
    if name not in _LAZY:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f".{_LAZY[name]}", __name__), name)
