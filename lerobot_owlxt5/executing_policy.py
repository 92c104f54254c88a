# SPDX-License-Identifier: Apache-2.0
"""The mode execute: what a robot does about a command, and what it says."""

from functools import cached_property
from typing import Any, cast

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import OBS_STATE
from torch import Tensor

from .backbones.understanding import Understanding
from .commands.answer import Target
from .commands.instruction import Instruction, TaskReader, spoken_of
from .commands.parser import named_objects
from .configuration_crossmodal import NO_UNDERSTANDING, CrossmodalConfig
from .data.start_pose import NEAR, is_far
from .data.windows import first_pose, still
from .model.crossmodal_model import CrossmodalModel
from .plans import Plans
from .scene import Search
from .validation import check_state, read_tasks
from .visual_encoder import ObjectFinder, Sightings, VisualEncoder

NO_OBJECTS_SEEN = "I hold still, because I see whole images and no objects: I know neither places nor names."


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
        self._spoken_of: list[Target | None] = []
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
        tasks = read_tasks(batch)
        before = self._spoken_of if len(self._spoken_of) == len(tasks) else [None] * len(tasks)
        instructions = [self._instruct(*each) for each in zip(tasks, before, strict=True)]
        searches = [
            Search(each.target, last, takes_best=each.trained, wants_report=each.wants_report)
            for each, last in zip(instructions, before, strict=True)
        ]
        seen = self._look(batch, searches)
        far = is_far(batch[OBS_STATE], self.rest_pose, self.rest_tolerance).tolist()
        facts = zip(instructions, seen.problems, far, strict=True)
        obstacles = [instruction.obstacle(problem, is_far_off) for instruction, problem, is_far_off in facts]
        answers = zip(obstacles, instructions, seen.names, strict=True)
        self.responses = [obstacle or instruction.intention(name) for obstacle, instruction, name in answers]
        self._spoken_of = [
            last if obstacle else spoken_of(instruction.target, name)
            for obstacle, instruction, name, last in zip(
                obstacles, instructions, seen.names, before, strict=True
            )
        ]
        pose = first_pose(batch)
        prompts = [instruction.prompt for instruction in instructions]
        actions = self.model.plan(prompts, seen.features, still(pose), self.config.max_episode_steps)
        moves = torch.tensor([not obstacle for obstacle in obstacles], device=pose.device)
        return torch.where(moves[:, None, None], actions, pose[:, None])

    def _look(self, batch: dict[str, Any], searches: list[Search]) -> Sightings:
        """Find what is meant. Without a detector, what a name means is for the network to tell."""
        if self.visual.names_objects:
            labels = named_objects(self.config.tasks or [])
            finder = cast(ObjectFinder, self.visual)
            return finder.find(batch, searches, labels, self._in_english)
        names = [search.target.phrase if search.target else "" for search in searches]
        problems = [NO_OBJECTS_SEEN if search.needs_objects else "" for search in searches]
        return Sightings(self.visual.encode(batch, names).features[:, :1], names, problems)

    def _instruct(self, task: str, before: Target | None) -> Instruction:
        """What a task asks for; `before` was spoken of last."""
        reader = TaskReader(tuple(self.config.tasks or ()), self.visual.names_objects)
        instruction = reader.read_task(task)
        if instruction is not None:
            return instruction
        if self._understanding is None:
            return reader.read_words(task)
        understood = self._understanding(task)
        return reader.read_answer(understood.answer, understood.sure, before, understood.unknown)

    def _in_english(self, name: str) -> str:
        return self._understanding.in_english(name) if self._understanding else name

    @cached_property
    def _understanding(self) -> Understanding | None:
        """Loaded when something is said that no training had. It is no part of a checkpoint."""
        config = self.config
        if config.understanding == NO_UNDERSTANDING:
            return None
        understanding = Understanding(config.understanding, config.understanding_revision)
        config.understanding_revision = understanding.revision
        return understanding
