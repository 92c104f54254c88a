# SPDX-License-Identifier: Apache-2.0
"""The checkpoint that somebody has chosen with `--policy.path`, changed by the other `--policy` options."""

from pathlib import Path
from typing import Any

from lerobot.configs import PreTrainedConfig, parser
from lerobot.policies.factory import get_policy_class, make_pre_post_processors


def read_config(path: str | Path) -> PreTrainedConfig:
    """The configuration of a checkpoint.

    Args:
        path: A folder, or the Hub's id.
    """
    options = parser.get_yaml_overrides("policy") + (parser.get_cli_overrides("policy") or [])
    config = PreTrainedConfig.from_pretrained(path, cli_overrides=options)
    config.pretrained_path = Path(path)
    return config


def load_checkpoint(config: PreTrainedConfig) -> tuple[Any, Any, Any]:
    """Load the policy of a configuration that was read, its preprocessor and its postprocessor."""
    path = str(config.pretrained_path)
    policy = get_policy_class(config.type).from_pretrained(path, config=config)
    overrides = {"device_processor": {"device": str(config.device)}}
    return policy, *make_pre_post_processors(config, path, preprocessor_overrides=overrides)
