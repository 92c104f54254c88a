# SPDX-License-Identifier: Apache-2.0
"""A robot as its policy knows it: LeRobot's observations in batches, and actions by joint."""

from collections.abc import Callable
from copy import copy
from typing import Any

import torch
from lerobot.policies.utils import make_robot_action, prepare_observation_for_inference
from lerobot.robots import Robot
from lerobot.utils.constants import ACTION, OBS_STATE, OBS_STR
from lerobot.utils.feature_utils import build_dataset_frame, hw_to_dataset_features
from torch import Tensor

Processor = Callable[[Any], Any]


class Body:
    """One robot, its cameras and joints.

    Args:
        robot: It is connected.
        processors: The policy's preprocessor and postprocessor.
        device: The policy's.
    """

    def __init__(self, robot: Robot, processors: tuple[Processor, Processor], device: torch.device) -> None:
        self._robot, self._device = robot, device
        self._preprocess, self._postprocess = processors
        self._seen_features = hw_to_dataset_features(robot.observation_features, OBS_STR)
        self._action_features = hw_to_dataset_features(robot.action_features, ACTION)
        self._frame: dict[str, Any] = {}

    @property
    def has_looked(self) -> bool:
        """Whether there is an observation, if an old one will do."""
        return bool(self._frame)

    def look(self) -> None:
        """Get an observation: joints and images of this moment."""
        self._frame = build_dataset_frame(self._seen_features, self._robot.get_observation(), OBS_STR)

    def batch(self, task: str) -> dict[str, Any]:
        """The last observation, as the policy takes it, with a task."""
        return self.preprocess(self.observation(task))

    def observation(self, task: str) -> dict[str, Any]:
        """The last observation before the preprocessor, features (1, ...), with a task."""
        frame = copy(self._frame)
        return dict(prepare_observation_for_inference(frame, self._device, task, self._robot.robot_type))

    def preprocess(self, batch: dict[str, Any]) -> dict[str, Any]:
        """A batch of the robot as the policy takes it."""
        return dict(self._preprocess(batch))

    def act(self, action: Tensor) -> None:
        """Send what a policy has chosen, (1, joints), scaled as it scales joints."""
        self._robot.send_action(make_robot_action(self._postprocess(action), self._action_features))

    def hold(self) -> None:
        """Send the joints to where they are now."""
        self.look()
        joints = torch.from_numpy(self._frame[OBS_STATE])
        self._robot.send_action(make_robot_action(joints[None], self._action_features))
