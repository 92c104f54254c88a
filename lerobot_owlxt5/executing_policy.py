# SPDX-License-Identifier: Apache-2.0
"""The mode execute: what a robot does about a command, and what it says."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, cast

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import OBS_STATE
from torch import Tensor

from .backbones.understanding import Understanding, Understood
from .commands.answer import Action, Request, Target, format_answer
from .commands.happened import Change
from .commands.instruction import Instruction, TaskReader, spoken_of, target_of
from .commands.parser import named_objects, parse_command
from .commands.replies import GOING_HOME, NO_OBJECTS_SEEN
from .configuration_crossmodal import NO_UNDERSTANDING, CrossmodalConfig
from .data.start_pose import NEAR, is_far
from .data.windows import first_pose, samples_at, still
from .execution import Execution, Next, carry_out
from .look_again import Memory, changed, displaced
from .model.crossmodal_model import CrossmodalModel
from .scene import Scene, Search
from .sighting import Sighting, find, without_objects
from .validation import check_state, read_tasks
from .visual_encoder import ObjectFinder, VisualEncoder
from .way_home import straight


class ExecutingPolicy(PreTrainedPolicy):
    """Plans a whole movement, carries it out, goes home, and looks what has happened.

    Attributes:
        responses: One sentence for each environment: before and in a movement what the robot is going to do,
            after it what it sees that it did; empty before the first.
        reported: The last movement of each robot whose report is there; None before the first.
        last_scenes: What was seen at the last look, a scene for each environment that looked.
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
        # Older checkpoints do not know how far their first poses were from the mean: go home in doubt.
        state_dict.setdefault(f"{prefix}rest_tolerance", torch.full_like(self.rest_tolerance, NEAR))
        super()._load_from_state_dict(state_dict, prefix, *args)

    def reset(self) -> None:
        """Forget what the robots are doing: a new episode begins."""
        self._executions: list[Execution | None] = []
        self._spoken_of: list[Target | None] = []
        self._agreed: dict[str, Request] = {}
        self.responses: list[str] = []
        self.last_scenes: list[Scene] = []
        self.reported: list[Execution | None] = []

    def understand(self, sentence: str) -> Understood:
        """What a sentence asks for, as `select_action` takes it; nothing is done about it."""
        command = self._reader.command(sentence)
        if command is None and self._understanding:
            return self._understanding(sentence)
        command = command or parse_command(sentence)
        return Understood(Request((Action(command.verb, target_of(command.object)),)), 1.0, True)

    def agree(self, request: Request, words: str = "") -> str:
        """Note what a person wants for sure, as after a question: nobody has to understand it again.

        Args:
            request: What is wanted; it is clear.
            words: In which it was said, if these words have no other meaning at another time.

        Returns:
            The task that asks for it, until `reset`.
        """
        task = words or format_answer(request)
        self._agreed[task] = request
        return task

    def speak_of(self, things: Sequence[Target | None]) -> None:
        """Note what "it" means from now on for each environment, as after a question about a thing."""
        if len(self._executions) != len(things):
            self._executions = [None] * len(things)
        self._spoken_of = [*things]

    @property
    def executions(self) -> list[Execution | None]:
        """What each robot is doing, or has done last; None before its first task. To read, not to change."""
        return [*self._executions]

    def drop_queued_actions(self) -> None:
        """Stop: the next `select_action` plans anew, from where the robot is then."""
        for execution in filter(None, self._executions):
            execution.task = None
        self.responses = []

    @property
    def movement_steps(self) -> list[int]:
        """How many steps of what each robot does move a thing, before it goes home; 0 where none do."""
        return [execution.movement if execution else 0 for execution in self._executions]

    def _begin(self, mode: str) -> None:
        """Without dropout, and for nothing that was never learnt."""
        self.eval()
        self.config.check_mode(mode)

    @torch.no_grad()
    def select_action(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Return the next action; look and plan where a task is new, or something comes at a path's end.

        A robot whose arms are not where movements begin goes home first. After a movement it goes home, looks
        again, and says in `responses` what happened. Then it begins with what else it was asked for.

        Args:
            batch: Observation of a batch of environments, with their tasks in `task`. An environment whose
                task is another one than before gets a new plan, the others go on with theirs.
            **kwargs: Not used.

        Returns:
            (batch, joints), scaled to [-1, 1]. When all is done the last action is held.
        """
        self._begin("execute")
        tasks = read_tasks(batch)
        if len(self._executions) != len(tasks):
            self._executions, self._spoken_of = [None] * len(tasks), [None] * len(tasks)
        if len(self.responses) != len(tasks):
            self.responses = [""] * len(tasks)
        if len(self.reported) != len(tasks):
            self.reported = [None] * len(tasks)
        due = [index for index, task in enumerate(tasks) if self._is_due(index, task)]
        if due:
            self._go_on(samples_at(batch, due), due)
        self._follow_things(batch)
        return torch.stack([execution.next_action() for execution in self._executions if execution])

    def looks(self, tasks: Sequence[str]) -> list[bool]:
        """Whether the next `select_action` looks at each robot's image; otherwise an old one will do.

        Args:
            tasks: Of the robots, as in its batch.
        """
        if len(self._executions) != len(tasks):
            return [True] * len(tasks)
        return [self._is_due(*each) or self._follows_thing(each[0]) for each in enumerate(tasks)]

    @property
    def is_done(self) -> list[bool]:
        """Whether each robot has done and said all that it was asked for, and holds still."""
        return [execution is not None and execution.is_over for execution in self._executions]

    @torch.no_grad()
    def predict_action_chunk(self, batch: dict[str, Any], **kwargs: Any) -> Tensor:
        """Plan a movement for each environment, and note what to say about it in `responses`.

        The robot holds still if it does not know the command, or does not see the object. If its arms are too
        far from where the movements of the training data begin, the chunk is the way there.

        Args:
            batch: Observation at the beginning, with the tasks in `task`.
            **kwargs: Not used.

        Returns:
            (batch, L, joints), scaled to [-1, 1]; its end is held.

        Raises:
            ValueError: If there are other joints than in training, or a joint's position is not finite: then
                there is not even a pose to hold.
            FloatingPointError: If the plan is not finite.
        """
        self._begin("execute")
        tasks = read_tasks(batch)
        before = self._spoken_of if len(self._spoken_of) == len(tasks) else [None] * len(tasks)
        instructions = [self._instruct(*each) for each in zip(tasks, before, strict=True)]
        begun = self._plan(batch, instructions, before, [None] * len(tasks))
        self.responses = [execution.response for execution in begun]
        self._spoken_of = [execution.spoken_of for execution in begun]
        return torch.stack([execution.chunk(self.config.max_episode_steps) for execution in begun])

    def _is_due(self, index: int, task: str) -> bool:
        """Whether a robot has a new task, or something comes at its path's end."""
        execution = self._executions[index]
        return execution is None or execution.task != task or execution.waits

    def _follows_thing(self, index: int) -> bool:
        """Whether it is time for a robot to look where the thing is that it is about to move."""
        every, execution = self.config.replan_every, self._executions[index]
        return bool(every and execution and execution.memory and execution.is_time_to_look(every))

    def _go_on(self, batch: dict[str, Any], due: Sequence[int]) -> None:
        """Do what comes next for some environments, of which the batch is: its i-th sample is `due[i]`'s."""
        last = [self._executions[index] for index in due]
        changes = self._look_again(batch, last)
        instructions = dict[int, Instruction]()
        for sample, (index, task) in enumerate(zip(due, read_tasks(batch), strict=True)):
            execution, change = last[sample], changes[sample]
            self.responses[index] = ""
            if execution is None or execution.task != task:
                instructions[sample] = self._instruct(task, self._spoken_of[index])
            elif execution.next is Next.PLAN:
                instructions[sample] = execution.instruction
            else:
                execution.next, execution.change, self.reported[index] = Next.NOTHING, change, execution
                self.responses[index] = execution.report(change)
                if later := execution.instruction.later:
                    read = self._reader.read_answer
                    instructions[sample] = read(Request(later), True, self._spoken_of[index])
        if not instructions:
            return
        chosen = [*instructions]
        before = [self._spoken_of[due[sample]] for sample in chosen]
        executions = self._plan(
            samples_at(batch, chosen), [*instructions.values()], before, [last[sample] for sample in chosen]
        )
        for sample, execution in zip(chosen, executions, strict=True):
            index = due[sample]
            self._executions[index], self._spoken_of[index] = execution, execution.spoken_of
            self.responses[index] = f"{self.responses[index]} {execution.response}".strip()

    def _plan(
        self,
        batch: dict[str, Any],
        instructions: Sequence[Instruction],
        before: Sequence[Target | None],
        last: Sequence[Execution | None],
    ) -> list[Execution]:
        """Look, and plan what each robot does about an instruction.

        Args:
            batch: Observations with their tasks.
            instructions: One for each.
            before: What was spoken of last.
            last: What each robot did last; None if that is not known.
        """
        check_state(batch[OBS_STATE], self.config.action_feature.shape[0])
        tasks, poses = read_tasks(batch), first_pose(batch)
        far = is_far(batch[OBS_STATE], self.rest_pose, self.rest_tolerance).tolist()
        goes_home = [
            is_far_off and instruction.needs_home and not (execution and execution.came_home)
            for is_far_off, instruction, execution in zip(far, instructions, last, strict=True)
        ]
        # Who goes home first looks there.
        searches = [
            Search(None)
            if home
            else Search(each.target, spoken, takes_best=each.trained, wants_report=each.wants_report)
            for each, spoken, home in zip(instructions, before, goes_home, strict=True)
        ]
        seen, features = self._look(batch, searches)
        prompts = [instruction.prompt for instruction in instructions]
        plans = self.model.plan(prompts, features, still(poses), self.config.max_episode_steps)
        executions = []
        for sample, (task, instruction, pose) in enumerate(zip(tasks, instructions, poses, strict=True)):
            known = (task, instruction, pose)
            if goes_home[sample]:
                execution = last[sample]
                way = (
                    execution.way_home(pose, self.rest_pose) if execution else straight(pose, self.rest_pose)
                )
                executions.append(Execution(*known, way, GOING_HOME, before[sample], Next.PLAN))
            elif obstacle := instruction.obstacle(seen[sample].problem, far[sample]):
                executions.append(Execution(*known, pose[None], obstacle, before[sample]))
            else:
                name = seen[sample].name
                spoken = spoken_of(instruction.target, name)
                said = instruction.intention(name)
                executions.append(carry_out(*known, plans[sample], said, spoken, seen[sample].memory))
        return executions

    def scenes(self, batch: dict[str, Any]) -> list[Scene]:
        """What is seen now, for somebody to ask.

        Args:
            batch: Observations of robots, as `select_action` takes them.

        Returns:
            One for each robot.

        Raises:
            ValueError: If the policy sees whole images and no objects.
        """
        if not self.visual.names_objects:
            raise ValueError(NO_OBJECTS_SEEN)
        labels = named_objects(self.config.tasks or [])
        self.last_scenes = cast(ObjectFinder, self.visual).scenes(batch, labels, self._in_english)
        return self.last_scenes

    def _look(self, batch: dict[str, Any], searches: Sequence[Search]) -> tuple[list[Sighting], Tensor]:
        """Find what is meant: sightings, and the network's features (batch, 1, dim).

        Without a detector, what a name means is for the network to tell.
        """
        if self.visual.names_objects:
            seen = [find(*each) for each in zip(self.scenes(batch), searches, strict=True)]
            things = [sighting.thing for sighting in seen]
            return seen, cast(ObjectFinder, self.visual).features(batch, things)
        seen = [without_objects(search) for search in searches]
        return seen, self.visual.encode(batch, [sighting.name for sighting in seen]).features[:, :1]

    def _look_again(
        self, batch: dict[str, Any], executions: Sequence[Execution | None]
    ) -> list[Change | None]:
        """What has changed for those whose movement is over; None for the others."""
        memories = [each.memory if each and each.waits else None for each in executions]
        if not any(memories):
            return [None] * len(memories)
        scenes = self.scenes(batch)
        return [
            changed(memory, scene) if memory else None for memory, scene in zip(memories, scenes, strict=True)
        ]

    def _follow_things(self, batch: dict[str, Any]) -> None:
        """Pass over to new plans where a thing is elsewhere now that is about to be moved."""
        moving = [index for index in range(len(self._executions)) if self._follows_thing(index)]
        if not moving:
            return
        executions = [cast(Execution, self._executions[index]) for index in moving]
        memories = [cast(Memory, execution.memory) for execution in executions]
        now = samples_at(batch, moving)
        things = [displaced(*each) for each in zip(memories, self.scenes(now), strict=True)]
        if not any(things):
            return
        features = cast(ObjectFinder, self.visual).features(now, things)
        starts = torch.stack([execution.start for execution in executions])
        prompts = [execution.instruction.prompt for execution in executions]
        plans = self.model.plan(prompts, features, still(starts), self.config.max_episode_steps)
        for execution, plan, memory, thing in zip(executions, plans, memories, things, strict=True):
            if thing:
                execution.change_plan(plan, Memory(thing, memory.others))

    def _instruct(self, task: str, before: Target | None) -> Instruction:
        """What a task asks for; `before` was spoken of last."""
        reader = self._reader
        instruction = reader.read_task(task)
        if instruction is not None:
            return instruction
        if task in self._agreed:
            return reader.read_answer(self._agreed[task], True, before)
        if self._understanding is None:
            return reader.read_words(task)
        understood = self._understanding(task)
        return reader.read_answer(understood.answer, understood.sure, before, understood.unknown)

    @property
    def _reader(self) -> TaskReader:
        return TaskReader(tuple(self.config.tasks or ()), self.visual.names_objects)

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
