# SPDX-License-Identifier: Apache-2.0
"""The mode execute: what a robot does about a command, and what it says."""

from typing import Any

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import OBS_STATE
from torch import Tensor

from .commands.instruction import interpret
from .configuration_crossmodal import CrossmodalConfig
from .data.start_pose import NEAR, is_far
from .data.windows import first_pose, still
from .model.crossmodal_model import CrossmodalModel
from .plans import Plans
from .validation import check_state, read_tasks
from .visual_encoder import VisualEncoder


class ExecutingPolicy(PreTrainedPolicy):
    """Plans a movement once for each task, and then carries it out.

    Attributes:
        responses: One sentence for each environment on the plan that was made last; empty before the first.
            It says what the robot is going to do, not that it was done: nobody has looked yet.
        rest_pose: Mean first pose of the training data, (joints,), scaled to [-1, 1].
        rest_tolerance: How far from it each joint may be when a plan begins, (joints,), scaled.
    """

    # LeRobot asks both of each class, of this unfinished one too.
    config_class = CrossmodalConfig
    name = "executing"
    config: CrossmodalConfig
    model: CrossmodalModel
    visual: VisualEncoder
    rest_pose: Tensor
    rest_tolerance: Tensor

    def register_rest_pose(self, n_joints: int) -> None:
        """Make room for what the checkpoint knows of first poses. Without training any pose will do."""
        self.register_buffer("rest_pose", torch.zeros(n_joints))
        self.register_buffer("rest_tolerance", torch.full((n_joints,), torch.inf))

    def _load_from_state_dict(self, state_dict: dict[str, Any], prefix: str, *args: Any) -> None:
        # Older checkpoints do not know how far their first poses were from the mean: hold still in doubt.
        state_dict.setdefault(f"{prefix}rest_tolerance", torch.full_like(self.rest_tolerance, NEAR))
        super()._load_from_state_dict(state_dict, prefix, *args)

    def reset(self) -> None:
        """Forget the plans: a new episode begins."""
        self._plans = Plans()
        self.responses: list[str] = []

    def drop_queued_actions(self) -> None:
        """Forget the plans: the next `select_action` makes new ones, from where the robot is then."""
        self.reset()

    def _begin(self, mode: str) -> None:
        """Without dropout, and for nothing that was never learnt."""
        self.eval()
        self.config.check_mode(mode)

    @torch.no_grad()
    def select_action(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Return the next action of the plan; make a plan if there is none for this task.

        Args:
            batch: Observation of a batch of environments, with their tasks in `task`. An environment whose
                task is another one than before gets a new plan, the others go on with theirs.
            **kwargs: Not used.

        Returns:
            (batch, joints), scaled to [-1, 1]. After the plan's end the last action is held.
        """
        tasks = read_tasks(batch)
        if not self._plans.fit(tasks):
            plan = self.predict_action_chunk(batch)
            self.responses = self._plans.renew(tasks, plan, self.responses)
        return self._plans.next_action()

    @torch.no_grad()
    def predict_action_chunk(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Plan a whole episode for each environment, and note what to say about it in `responses`.

        The robot holds still if it does not know the command, does not see the object, or is too far from
        where the movements of the training data begin.

        Args:
            batch: Observation at the beginning of the episode, with the tasks in `task`.
            **kwargs: Not used.

        Returns:
            (batch, L, joints), scaled to [-1, 1].

        Raises:
            ValueError: If there are other joints than in training, or a joint's position is not finite: then
                there is not even a pose to hold.
            FloatingPointError: If the plan is not finite.
        """
        self._begin("execute")
        check_state(batch[OBS_STATE], self.config.action_feature.shape[0])
        can_read = self.visual.can_read if self.visual.names_objects else None
        instructions = [interpret(task, self.config.tasks or (), can_read) for task in read_tasks(batch)]
        seen = self.visual.encode(batch, [instruction.command.object for instruction in instructions])
        far = is_far(batch[OBS_STATE], self.rest_pose, self.rest_tolerance)
        facts = zip(instructions, seen.object_found.tolist(), far.tolist(), strict=True)
        obstacles = [instruction.obstacle(*what) for instruction, *what in facts]
        answers = zip(obstacles, instructions, strict=True)
        self.responses = [obstacle or instruction.command.intention for obstacle, instruction in answers]
        pose = first_pose(batch)
        prompts = [instruction.prompt for instruction in instructions]
        actions = self.model.plan(prompts, seen.features[:, :1], still(pose), self.config.max_episode_steps)
        moves = torch.tensor([not obstacle for obstacle in obstacles], device=pose.device)
        return torch.where(moves[:, None, None], actions, pose[:, None])
