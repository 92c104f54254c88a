# SPDX-License-Identifier: Apache-2.0
"""Plays: what somebody says to a robot, what it must answer, and what it must move.

    scene: claeo, mug, ball, can    the objects' set, and what stands left, in the middle and right; anew
    poses: 0.4 0.1 0, ...           where they stand (x, y, yaw; metres, degrees), behind `scene`
    > push the mug                  somebody says this
    > [points at the mug]           or points at it
    wait 15                         only so many control periods pass; else as many as the robot needs
    < I will push the mug.          it answers this, and nothing else, in this order
    moved: mug away                 what has moved since the last `>`; `nothing` is checked without a word

Lines with # are comments.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from lerobot.lerobot_types import RobotAction, RobotObservation

from lerobot_owlxt5.configuration_motion_library import MotionLibraryConfig
from lerobot_owlxt5.conversation import Conversation
from lerobot_owlxt5.conversation.body import Processor
from lerobot_owlxt5.conversation.rules import plan_by_rules
from lerobot_owlxt5.conversation.steps import Planner
from lerobot_owlxt5.executing_policy import ExecutingPolicy
from nico_tabletop.config_nico_sim import NicoSimConfig
from nico_tabletop.configuration import ClantEnvConfig
from nico_tabletop.nico_sim import NicoSim

MOST_STEPS = 600
MOVED = 0.01
"""What moved by more, metres, has moved; less is a touch."""


@dataclass
class Turn:
    """What somebody says, and what must follow."""

    says: str
    answers: list[str] = field(default_factory=list)
    wait: int = MOST_STEPS
    moved: str = "nothing"


@dataclass
class Scene:
    """What stands on the table, and what is said there."""

    objects: str
    arrangement: list[str]
    poses: list[list[float]] | None = None
    turns: list[Turn] = field(default_factory=list)


@dataclass
class Play:
    """Scenes one after another."""

    name: str
    scenes: list[Scene]

    @property
    def moves(self) -> bool:
        """Whether something moves in it, which takes time."""
        return any(turn.moved != "nothing" for scene in self.scenes for turn in scene.turns)

    @property
    def turns(self) -> int:
        """How often somebody says something."""
        return sum(len(scene.turns) for scene in self.scenes)


def read_play(path: Path) -> Play:
    """Read a play's file."""
    play = Play(path.stem, [])
    for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        scene = play.scenes[-1] if play.scenes else None
        turn = scene.turns[-1] if scene and scene.turns else None
        if line.startswith("scene: "):
            objects, *arrangement = line.removeprefix("scene: ").split(", ")
            play.scenes.append(Scene(objects, arrangement))
        elif line.startswith("poses: ") and scene:
            poses = line.removeprefix("poses: ").split(", ")
            scene.poses = [[float(each) for each in pose.split()] for pose in poses]
        elif line[0] == ">" and scene:
            scene.turns.append(Turn(line[1:].strip()))
        elif line.startswith("< ") and turn:
            turn.answers.append(line[2:])
        elif line.startswith("wait ") and turn:
            turn.wait = int(line[5:])
        elif line.startswith("moved: ") and turn:
            turn.moved = line[7:]
        else:
            raise ValueError(f"{path.name}, line {number}: {line!r} is no line of a play here")
    return play


class Watched(NicoSim):
    """The simulated robot, with a count of its images and actions, and a list of what its head expressed."""

    looks = 0
    actions = 0

    def __init__(self, config: NicoSimConfig) -> None:
        super().__init__(config)
        self.expressed: list[str] = []

    def get_observation(self) -> RobotObservation:
        self.looks += 1
        return super().get_observation()

    def send_action(self, action: RobotAction) -> RobotAction:
        self.actions += 1
        return super().send_action(action)

    def look_at(self, x: float, y: float) -> None:
        self.expressed.append("look left" if x < 0.4 else "look right" if x > 0.6 else "look ahead")
        super().look_at(x, y)

    def nod(self) -> None:
        self.expressed.append("nod")
        super().nod()

    def shake(self) -> None:
        self.expressed.append("shake")
        super().shake()


class Stage:
    """A world and a robot with a policy."""

    def __init__(self, policy: ExecutingPolicy, processors: tuple[Processor, Processor]) -> None:
        self._policy, self._processors = policy, processors

    def set(self, scene: Scene, planner: Planner = plan_by_rules) -> Watched:
        """Lay the table, and begin a conversation."""
        robot = Watched(NicoSimConfig(objects=scene.objects))
        robot.connect()
        robot.reset(scene.arrangement, scene.poses)
        self.robot, self.simulation = robot, robot.simulation
        self.conversation = Conversation(robot, self._policy, self._processors, planner)
        return robot

    def say(self, turn: Turn) -> tuple[list[str], str]:
        """Say something; what is answered, and what has moved then."""
        lines, before = self.conversation.lines, self.simulation.object_positions()
        start = len(lines) + 1
        if pointed := re.fullmatch(r"\[points at the (.+)\]", turn.says):
            start -= 1
            box = self.simulation.object_boxes(4 / 3)[self.simulation.arrangement.index(pointed[1])]
            self.conversation.point(*((box[:2] + box[2:]) / 2).tolist())
        else:
            self.conversation.hear(turn.says)
        for _ in range(turn.wait):
            if not self.conversation.busy:
                break
            self.conversation.tick()
        return [line.text for line in lines[start:]], self._moved(before)

    def _moved(self, before: np.ndarray) -> str:
        after, moved = self.simulation.object_positions(), []
        for name, (x, y) in zip(self.simulation.arrangement, (after - before)[:, :2], strict=True):
            if abs(x) > MOVED or abs(y) > MOVED:
                far = "away" if x > 0 else "closer"
                moved.append(f"{name} {far if abs(x) > abs(y) else 'left' if y > 0 else 'right'}")
        return ", ".join(moved) or "nothing"


def make_stage() -> Stage:
    """With motion_library, which needs no training, and the embedded detector."""
    from lerobot.policies.factory import make_policy, make_pre_post_processors

    config = MotionLibraryConfig(device="cpu", detector="embedded", understanding="embedded")
    policy = make_policy(config, env_cfg=ClantEnvConfig())
    assert isinstance(policy, ExecutingPolicy)
    return Stage(policy, make_pre_post_processors(config))


def perform(stage: Stage, scenes: Sequence[Scene]) -> str:
    """Play scenes as they go, whatever they expect: a file of a play."""
    lines: list[str] = []
    for scene in scenes:
        robot = stage.set(scene)
        lines += [f"scene: {', '.join([scene.objects, *scene.arrangement])}"]
        if scene.poses:
            lines += [f"poses: {', '.join(' '.join(f'{each:g}' for each in pose) for pose in scene.poses)}"]
        lines += [""]
        for turn in scene.turns:
            answers, moved = stage.say(turn)
            lines += [f"> {turn.says}"] + ([f"wait {turn.wait}"] if turn.wait != MOST_STEPS else [])
            lines += [f"< {answer}" for answer in answers]
            lines += [f"moved: {moved}"] if moved != "nothing" else []
        robot.disconnect()
        lines += [""]
    return "\n".join(lines)
