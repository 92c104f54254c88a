# SPDX-License-Identifier: Apache-2.0
"""A conversation: what is heard becomes a step of a plan, and each control period goes on with it."""

from dataclasses import replace
from typing import Any

import torch
from lerobot.robots import Robot

from ..commands.answer import Request, Target
from ..commands.instruction import HOME, target_of
from ..commands.prompts import MAX_CHARACTERS
from ..commands.replies import HOLDS, NO_OBJECTS_SEEN, did_you_mean
from ..executing_policy import ExecutingPolicy
from ..execution import Execution
from ..scene import Scene, Thing
from .answers_from_sight import answer
from .body import Body, Processor
from .expressions import Expressions
from .lines import Line, add
from .memory import Memory
from .questions import IT, Question
from .rules import plan_by_rules
from .showing import Showing
from .spelling import respelt
from .steps import (
    Ask,
    Describe,
    Do,
    Forget,
    GoHome,
    Imitate,
    Open,
    Planner,
    Remark,
    Say,
    Situation,
    Step,
    Stop,
    Teach,
    Translate,
    Watch,
)
from .teaching import Point, forget, point_out, teach

ONCE_MORE = "I try once more."
STOPPED = "I stop."
TOLD_TO_STOP = "You told me to."
WHAT_TO_TRANSLATE = "What should I translate?"
NO_TRANSLATION = "I cannot translate: this policy has not learnt it."
AS_YOU_DID = "I move my arms as you did."
DONE_AS_YOU_DID = "I moved my arms as you did. I did not look what has moved."
LINES_BEFORE = 6
"""So many lines does a planner know, beside the words that it decides about (our decision)."""
_OF_MEMORY = ("did", "worked", "why", "doing", "ability", "robot")


class Conversation:
    """A robot, a policy, and a person who talks to it; all in one thread.

    Args:
        robot: Any LeRobot robot with the policy's cameras and joints; it is connected. One that is
            `expressions.Expressive` looks at what it speaks of, nods and shakes its head.
        policy: Any of ours. It forgets what it was doing before.
        processors: Its preprocessor and postprocessor.
        planner: Decides what to do about what is said.

    Attributes:
        lines: All that was said, the oldest first; the last `lines.MOST_LINES`.
        looking_at: What the robot acts on or has spoken of last; None if that was no single thing.
    """

    def __init__(
        self,
        robot: Robot,
        policy: ExecutingPolicy,
        processors: tuple[Processor, Processor],
        planner: Planner = plan_by_rules,
    ) -> None:
        policy.reset()
        self.lines: list[Line] = []
        self.looking_at: Thing | None = None
        self._policy = policy
        self._body = Body(robot, processors, torch.device(policy.config.device or "cpu"))
        self._expressions = Expressions(robot)
        self._planner = planner
        self._memory = Memory()
        self._open: Open | None = None
        self._last: Request | None = None
        self._task: str | None = None
        self._moving: torch.Tensor | None = None
        self._response = ""
        self._reported: Execution | None = None
        self._tried_again = False
        self._showing = Showing(policy, self._body)
        self._point: Point | None = None

    @property
    def busy(self) -> bool:
        """Whether a movement is going on, or is about to begin."""
        return self._task is not None or self._showing.copies

    @property
    def watching(self) -> bool:
        """Whether the robot watches how somebody moves its arms."""
        return self._showing.goes_on

    @property
    def things(self) -> list[Thing]:
        """What was seen at the last look, from left to right; empty before the first."""
        scene = self._last_scene
        return scene.things if scene else []

    def hear(self, words: str) -> None:
        """Hear what somebody says, and answer it or begin to do it.

        Args:
            words: Any text. With more than `MAX_CHARACTERS` characters it is not understood.
        """
        before = tuple(self.lines[-LINES_BEFORE:])
        add(self.lines, "person", words[:MAX_CHARACTERS])
        scene = self._last_scene
        seen = tuple(thing.name for thing in self.things)
        taught = tuple(scene.taught) if scene else ()
        understand = self._policy.understand
        situation = Situation(
            understand, self._open, self._last, seen, before, self.watching, taught, self._respelt
        )
        self._take(self._planner(words, situation))

    def point(self, x: float, y: float) -> None:
        """Look where somebody points: what is there is "this" from then on, and "it" if it has a name.

        Args:
            x: Share of the image's width, from the left.
            y: Share of its height, from above.
        """
        scene = self._scene_or_say()
        if scene is None:
            return
        self._point = x, y
        seen = point_out(scene, self._point)
        if isinstance(seen, str):
            self._say(seen)
        else:
            self._speak_of(seen)

    def look(self) -> None:
        """Look at the table, without a word: `things` then has what is there.

        It does nothing for a policy that sees no objects.
        """
        self._scene()

    def tick(self) -> None:
        """Go on for one control period, 0.1 s: while the robot is busy, one action is sent.

        Raises:
            ValueError: If a joint's position is not finite, or the robot has other joints than the policy.
            FloatingPointError: If a plan is not finite.
        """
        self._expressions.go_on()
        if self._task is None:
            if self.watching:
                if told := self._showing.watch():
                    self._say(told)
            elif self._showing.copies:
                self._copy()
            elif not self._body.has_looked:
                self._body.look()
            return
        if self._policy.looks([self._task])[0] or not self._body.has_looked:
            if self._moving is not None:
                # A look takes longer than a control period, so the arms come to rest before.
                self._body.act(self._moving)
                self._moving = None
                return
            self._body.look()
        self._moving = self._policy.select_action(self._body.batch(self._task))
        self._body.act(self._moving)
        self._hear_policy()
        if self._policy.is_done[0]:
            self._finish()

    def stop(self) -> None:
        """Hold still at once, where the arms are."""
        unfinished = self._unfinished()
        was_busy = self._halt()
        self._open = Open("stopped", unfinished) if unfinished else None
        self._memory.still = TOLD_TO_STOP
        self._say(STOPPED if was_busy else HOLDS["forbidden"])

    def home(self) -> None:
        """Move the arms where movements begin, in the next ticks."""
        self._begin(HOME)

    def _take(self, step: Step) -> None:
        """Do the next step of a plan."""
        if not isinstance(step, Ask | Remark):
            self._open = None
        match step:
            case Stop():
                self.stop()
            case GoHome():
                self.home()
            case Ask(question):
                self._answer(question)
            case Watch():
                self._halt()
                self._say(self._showing.begin())
            case Describe():
                self._say(self._showing.end())
            case Imitate():
                self._imitate()
            case Teach():
                self._learn(step)
            case Forget(name):
                if scene := self._last_scene:
                    self._say(forget(scene, name))
            case Translate(sentence):
                self._translate(sentence)
            case Remark(text, then):
                self._say(text)
                if then:
                    self._take(then)
            case Do(request, words):
                self._last, self._tried_again = request, False
                self._begin(self._policy.agree(request, words))
            case Say(text, asks):
                self._halt()
                self._open = asks
                self._memory.still = TOLD_TO_STOP if text == HOLDS["forbidden"] else text
                self._say(text)

    def _begin(self, task: str) -> None:
        """Give the policy a task; it takes effect at the next tick."""
        self._policy.drop_queued_actions()
        self._showing.stop()
        self._point = None
        self._task, self._response, self._reported = task, "", None
        self._moving = None
        self._memory.still = ""

    def _halt(self) -> bool:
        """End the movement where the arms are; whether there was one."""
        was_busy = self.busy
        self._showing.stop()
        if not was_busy:
            return False
        if self._memory.doing:
            self._memory.did = f"I stopped before I was done. I had said: {self._memory.doing}"
            self._memory.worked = None
        self._task, self._memory.doing = None, ""
        self._policy.drop_queued_actions()
        self._body.hold()
        return True

    def _unfinished(self) -> Request | None:
        """What is left of the request that is being carried out; None if none is."""
        execution = next(iter(self._policy.executions), None)
        if self._task in (None, HOME):
            return None
        if execution is None or execution.task != self._task:  # it has not begun
            return self._last
        return execution.request

    def _hear_policy(self) -> None:
        """Pass on what the policy says, and note what it means."""
        [said] = self._policy.responses
        [execution] = self._policy.executions
        [reported] = self._policy.reported
        if execution and execution.memory:
            self._look_at(execution.memory.thing)
        if reported is not self._reported:
            self._reported = reported
            if reported and reported.change is not None:
                self._memory.worked = reported.succeeded
        if not said or said == self._response:
            return
        self._response = said
        self._say(said)
        self._memory.doing = said

    def _finish(self) -> None:
        """Note how a task ended; try once more what did not move."""
        [execution] = self._policy.executions
        self._task, self._memory.doing = None, ""
        if execution is None:
            return
        if execution.change is not None or execution.movement:
            self._memory.did = self._response
            if self._again(execution):
                self._say(ONCE_MORE)
            return
        instruction = execution.instruction
        if instruction.goes_home:
            if self._showing.copies:
                self._memory.doing = AS_YOU_DID
                self._say(AS_YOU_DID)
            return
        self._memory.still = self._response
        request = instruction.request()
        # A question about one of several landmarks is none about the target.
        if request is None or request.actions[0].target.relation:
            return
        if self._response.endswith("?"):
            self._open = Open("which", request)
        elif (other := self._respelt(request.actions[0].target)) and (meant := instruction.request(other)):
            self._open = Open("whether", meant)
            self._say(did_you_mean(meant.actions[0]))

    def _respelt(self, target: Target) -> Target | None:
        """What is seen and has nearly the name of a target that is not seen; None if nothing has."""
        scene = self._last_scene
        if scene is None or scene.called_in_any_language(target.name, target.colour):
            return None
        return respelt(target, [thing.name for thing in scene.things])

    def _again(self, execution: Execution) -> bool:
        """Begin once more, if a thing was seen not to have moved, and it is the first time."""
        unmoved = execution.change is not None and execution.change.way == ""
        request = execution.request
        if self._tried_again or not unmoved or request is None:
            return False
        self._tried_again = True
        self._begin(self._policy.agree(request))
        return True

    def _answer(self, question: Question) -> None:
        """Answer a question from memory, or from a look; a movement goes on."""
        if question.kind in _OF_MEMORY:
            self._say(self._memory.answer(question))
            return
        scene = self._scene_or_say()
        if scene is None:
            return
        if question.name == IT:
            question = replace(question, name=self.looking_at.name if self.looking_at else "")
        text, thing = answer(question, scene)
        self._speak_of(thing)
        self._say(text)

    def _imitate(self) -> None:
        """Go home, to do again what was shown."""
        movement = self._showing.movement()
        if isinstance(movement, str):
            self._say(movement)
        else:
            self.home()
            self._showing.copy(movement)

    def _copy(self) -> None:
        """One step of what was shown."""
        if self._showing.act():
            self._memory.did, self._memory.doing, self._memory.worked = DONE_AS_YOU_DID, "", None
            self._say(DONE_AS_YOU_DID)

    def _learn(self, lesson: Teach) -> None:
        """Stop, and remember what a thing looks like that somebody shows."""
        self._halt()
        scene = self._scene_or_say()
        if scene is None:
            return
        said, thing = teach(scene, lesson, self._point, self.looking_at)
        if thing:
            self._speak_of(thing)
            self.look()
        self._say(said)

    @property
    def _last_scene(self) -> Scene | None:
        """What was seen at the last look; None before the first."""
        scenes = self._policy.sight.last
        return scenes[0] if scenes else None

    def _scene_or_say(self) -> Scene | None:
        """What is seen now; where the policy sees no objects, that is said."""
        scene = self._scene()
        if scene is None:
            self._say(NO_OBJECTS_SEEN)
        return scene

    def _scene(self) -> Scene | None:
        """What is seen now; None for a policy that sees no objects."""
        if not self._policy.visual.names_objects:
            return None
        self._body.look()
        return self._policy.scenes(self._body.batch(""))[0]

    def _translate(self, sentence: str) -> None:
        translate: Any = getattr(self._policy, "translate", None)
        if translate is None or not self._policy.config.was_trained_in("translate"):
            self._say(NO_TRANSLATION)
        else:
            self._say(translate([sentence])[0] if sentence else WHAT_TO_TRANSLATE)

    def _speak_of(self, thing: Thing | None) -> None:
        """Look at what was spoken of, which is "it" from then on; but not while a movement goes on."""
        if self.busy:
            return
        self._look_at(thing)
        if thing:
            self._policy.speak_of([target_of(thing.name)])

    def _look_at(self, thing: Thing | None) -> None:
        if thing is not self.looking_at:
            self.looking_at = thing
            self._expressions.look_at(thing)

    def _say(self, text: str) -> None:
        self._expressions.say(text)
        add(self.lines, "robot", text)
