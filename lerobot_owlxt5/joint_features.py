# SPDX-License-Identifier: Apache-2.0
"""What a policy that commands joint positions needs of a dataset's state and action."""

from lerobot.configs import PreTrainedConfig
from lerobot.utils.constants import ACTION, OBS_STATE


def check_joint_features(config: PreTrainedConfig) -> None:
    """Check that state and action are there, and may be positions of the same joints.

    Args:
        config: With the features of a dataset or an environment.

    Raises:
        ValueError: If one is missing, or they differ in size.
    """
    state, action = config.robot_state_feature, config.action_feature
    if state is None or action is None:
        missing = OBS_STATE if state is None else ACTION
        raise ValueError(
            f"{config.type} needs the feature '{missing}', which the dataset lacks. It has the inputs "
            f"{sorted(config.input_features or {})} and the outputs {sorted(config.output_features or {})}."
        )
    if state.shape != action.shape:
        raise ValueError(
            f"{config.type} commands joint positions, so '{OBS_STATE}' {state.shape} and '{ACTION}' "
            f"{action.shape} must be of one size. Choose a dataset whose action is the next position of "
            "the same joints, and for a checkpoint one of the same robot."
        )
