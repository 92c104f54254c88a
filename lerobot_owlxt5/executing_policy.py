# SPDX-License-Identifier: Apache-2.0
"""The mode execute: what a robot does about a command, and what it says."""

from collections.abc import Sequence
from functools import cached_property
from typing import Any, cast

import torch
from lerobot.policies.pretrained import PreTrainedPolicy
from lerobot.utils.constants import OBS_STATE
from torch import Tensor

from .backbones.understanding import Understood
from .commands.answer import Request, Target, format_answer
from .commands.instruction import Instruction, spoken_of
from .commands.replies import GOING_HOME
from .configuration_crossmodal import CrossmodalConfig
from .data.start_pose import NEAR, is_far
from .data.windows import first_pose, samples_at, still
from .execution import Execution, Next, carry_out
from .listener import Listener
from .look_again import Memory
from .model.crossmodal_model import CrossmodalModel
from .scene import Moved, Scene, Search
from .sighting import Sight, Sighting
from .text_query import Query, answer
from .validation import check_state, read_tasks
from .visual_encoder import VisualEncoder
from .way_home import straight


class ExecutingPolicy(PreTrainedPolicy):
    """Plans a whole movement, carries it out, goes home, and looks what has happened.

    Attributes:
        responses: One sentence for each environment: before and in a movement what the robot is going to do,
            after it what it sees that it did; empty before the first.
        reported: The last movement of each robot whose report is there; None before the first.
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
        self.reported: list[Execution | None] = []
        self.__dict__.pop("sight", None)  # a new one has seen nothing

    def understand(self, sentence: str) -> Understood:
        """What a sentence asks for, as `select_action` takes it; nothing is done about it."""
        return self.listener.understand(sentence)

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

    def supports_text_generation(self) -> bool:
        """Whether `generate_text` answers: always. LeRobot's `--interactive` asks it."""
        return True

    @torch.no_grad()
    def generate_text(self, batch: dict[str, Any]) -> str:
        """Answer what somebody asks while the robot goes on with its task.

        It looks at the image of this moment, and changes nothing that `select_action` depends on. A question
        is answered. Of anything else it says what it would do about it as a task, and does not do it.

        Args:
            batch: Observation of one robot with its `task`. What is asked is in `query_text`, as LeRobot's
                `/vqa` has it, or else the task itself. Where `query_kind` is `next_subtask`, as
                `/autosteer` has it, the goal comes back as the one subtask: it is carried out wish by wish.

        Returns:
            At least one sentence.

        Raises:
            ValueError: If the batch is of several robots.
        """
        self._begin("execute")
        query = Query.of(batch)
        if query.wants_subtask:
            return query.text
        before = self._spoken_of[0] if len(self._spoken_of) == 1 else None
        instruction = self._instruct(query.text, before)
        [sighting], _ = self._look(batch, [_search(instruction, before)], self._moved_before(1))
        return answer(instruction, sighting)

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
        waiting = [each.memory if each and each.waits else None for each in last]
        compared = self.sight.compare(batch, waiting, _moved(last))
        instructions = dict[int, Instruction]()
        for sample, (index, task) in enumerate(zip(due, read_tasks(batch), strict=True)):
            execution, change = last[sample], compared[sample].change
            self.responses[index] = ""
            if execution is None or execution.task != task:
                instructions[sample] = self._instruct(task, self._spoken_of[index])
            elif execution.next is Next.PLAN:
                instructions[sample] = execution.instruction
            else:
                execution.next, self.reported[index] = Next.NOTHING, execution
                execution.change, execution.moved = compared[sample]
                self.responses[index] = execution.report(change)
                if later := execution.instruction.later:
                    instructions[sample] = self.listener.instruct_later(later, self._spoken_of[index])
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
            Search(None) if home else _search(each, spoken)
            for each, spoken, home in zip(instructions, before, goes_home, strict=True)
        ]
        seen, features = self._look(batch, searches, _moved(last))
        prompts = [instruction.prompt for instruction in instructions]
        plans = self.model.plan(prompts, features, still(poses), self.config.max_episode_steps)
        executions = []
        for sample, (task, instruction, pose) in enumerate(zip(tasks, instructions, poses, strict=True)):
            known, execution = (task, instruction, pose), last[sample]
            if goes_home[sample]:
                way = (
                    execution.way_home(pose, self.rest_pose) if execution else straight(pose, self.rest_pose)
                )
                executions.append(Execution(*known, way, GOING_HOME, before[sample], Next.PLAN))
            elif obstacle := instruction.obstacle(seen[sample].problem, far[sample]):
                came = execution.way_here(pose) if execution else None
                executions.append(Execution(*known, pose[None], obstacle, before[sample], came=came))
            else:
                name = seen[sample].name
                spoken = spoken_of(instruction.target, name)
                said = instruction.intention(name)
                executions.append(carry_out(*known, plans[sample], said, spoken, seen[sample].memory))
        for execution, moved in zip(executions, _moved(last), strict=True):
            execution.moved = moved
        return executions

    def scenes(self, batch: dict[str, Any]) -> list[Scene]:
        """What is seen now, for somebody to ask: one scene for each robot.

        Args:
            batch: Observations of robots, as `select_action` takes them.

        Raises:
            ValueError: If the policy sees whole images and no objects.
        """
        return self.sight.scenes(batch, self._moved_before(len(batch[OBS_STATE])))

    def _look(
        self, batch: dict[str, Any], searches: Sequence[Search], moved: Sequence[Moved]
    ) -> tuple[list[Sighting], Tensor]:
        """Find what is meant: sightings, and the network's features (batch, 1, dim)."""
        return self.sight.find(batch, searches, moved)

    def _moved_before(self, count: int) -> list[Moved]:
        """What each of so many robots has moved; nothing if these are other robots than before."""
        return _moved(self._executions if len(self._executions) == count else [None] * count)

    def _follow_things(self, batch: dict[str, Any]) -> None:
        """Pass over to new plans where a thing is elsewhere now that is about to be moved."""
        moving = [index for index in range(len(self._executions)) if self._follows_thing(index)]
        if not moving:
            return
        executions = [cast(Execution, self._executions[index]) for index in moving]
        memories = [cast(Memory, execution.memory) for execution in executions]
        now, features = self.sight.follow(samples_at(batch, moving), memories, _moved(executions))
        if not any(now):
            return
        starts = torch.stack([execution.start for execution in executions])
        prompts = [execution.instruction.prompt for execution in executions]
        plans = self.model.plan(prompts, features, still(starts), self.config.max_episode_steps)
        for execution, plan, memory in zip(executions, plans, now, strict=True):
            if memory:
                execution.change_plan(plan, memory)

    def _instruct(self, task: str, before: Target | None) -> Instruction:
        """What a task asks for; `before` was spoken of last."""
        return self.listener.instruct(task, before, self._agreed.get(task))

    @cached_property
    def listener(self) -> Listener:
        """Says what a task asks for."""
        return Listener(self.config, self.visual.names_objects)

    @cached_property
    def sight(self) -> Sight:
        """Looks at images."""
        return Sight(self.visual, self.listener)


def _moved(executions: Sequence[Execution | None]) -> list[Moved]:
    """What each robot has moved."""
    return [execution.moved if execution else () for execution in executions]


def _search(instruction: Instruction, before: Target | None) -> Search:
    """What to look for, for an instruction; `before` was spoken of last."""
    trained, report = instruction.trained, instruction.wants_report
    return Search(instruction.target, before, takes_best=trained, wants_report=report)
