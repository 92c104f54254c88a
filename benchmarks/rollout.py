# SPDX-License-Identifier: Apache-2.0
"""Drives the world with a policy, without lerobot-eval, and draws only what the policy looks at.

Drawing an image takes ten times as long as a step of the arms. A policy looks at two or three an episode.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import mujoco
import numpy as np
import torch
from cells import DISPLACED_AT, Cell, Episode
from lerobot.utils.constants import OBS_IMAGES, OBS_STATE

from lerobot_owlxt5.commands.happened import Change
from lerobot_owlxt5.commands.verbs import VERBS
from lerobot_owlxt5.configuration_owlxt5 import OBS_OBJECTS
from lerobot_owlxt5.executing_policy import ExecutingPolicy
from lerobot_owlxt5.object_point import ObjectPoint
from nico_tabletop.env import describe_objects
from nico_tabletop.robot import EYES, INITIAL_POSE_DEG
from nico_tabletop.scoring import judge
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import EPISODE_STEPS, Action

SIZE = (240, 320)
"""Rows and columns of the eyes' image, as in the environments."""
MOST_STEPS = 250
"""After so many steps a command is judged, if the policy has not reported before."""
CAMERA = f"{OBS_IMAGES}.{EYES}"
# Weak arms go such a share of the way from the initial pose: two thirds of the release's movements fail then.
_LEAST_SHARE, _LARGEST_SHARE = 0.3, 0.85
_DIRECTIONS = 36

Processor = Callable[[Any], Any]


@dataclass(frozen=True)
class Told:
    """What became of a command.

    Attributes:
        task: In CLANT's words.
        reward: 1 for perfect, 0.5 for successful, 0 for a failure.
        reported: Whether the policy has carried out a movement and said what happened. Otherwise it refused,
            or did not come to an end.
        claims: Whether it said that it succeeded, without more than that the object fell over.
        said: The last of its `responses`.
    """

    task: str
    reward: float
    reported: bool
    claims: bool
    said: str


@dataclass(frozen=True)
class Times:
    """Seconds that `select_action` takes, with the processors, in one command from home to the report.

    Attributes:
        first: Look and plan.
        detector: What an image takes in the detector alone; None if there is none.
        later: Mean of those that do not look.
        last: Look again and report.
    """

    first: float
    detector: float | None
    later: float
    last: float


def claims_success(said: str, verb: str, name: str) -> bool:
    """Whether a response says that all went as it should; that the object fell over may be added."""
    way = VERBS[verb].way
    return said in {Change(way, fell=fell).report(verb, name) for fell in (False, True)}


def as_batch(observation: Mapping[str, Any], task: str) -> dict[str, Any]:
    """The environment's observation as a batch of one, as the preprocessor takes it."""
    image = torch.from_numpy(observation["pixels"][EYES].copy()).permute(2, 0, 1)[None].float() / 255
    return {
        CAMERA: image,
        OBS_STATE: torch.from_numpy(observation["agent_pos"])[None],
        OBS_OBJECTS: torch.from_numpy(observation["objects"])[None],
        "task": [task],
    }


class Rollout:
    """One world, and the policy that acts in it.

    Args:
        policy: Whose `config.replan_every` is set for each episode.
        processors: Its preprocessor and postprocessor.
        simulation: The world.
    """

    def __init__(
        self,
        policy: ExecutingPolicy,
        processors: tuple[Processor, Processor],
        simulation: TabletopSimulation,
    ) -> None:
        self._policy, self._simulation = policy, simulation
        self._preprocess, self._postprocess = processors
        self._seen: dict[str, Any] = {}
        self.times: list[Times] = []

    def play(self, cell: Cell, episode: Episode) -> list[Told]:
        """Play an episode of a cell; what became of each command that is judged."""
        self._simulation.reset(episode.arrangement, episode.poses, episode.conditions)
        self._policy.reset()
        self._policy.config.replan_every = cell.replan_every
        random = np.random.default_rng(episode.seed)
        if episode.first:
            self._tell(episode.first, random, EPISODE_STEPS, stops=False)
        share = random.uniform(_LEAST_SHARE, _LARGEST_SHARE) if cell.weak else 1.0
        return [
            self._tell(action, random, MOST_STEPS, displaced_cm=cell.displaced_cm, share=share)
            for action in episode.commands
        ]

    def _tell(
        self,
        action: Action,
        random: np.random.Generator,
        steps: int,
        *,
        stops: bool = True,
        displaced_cm: float = 0.0,
        share: float = 1.0,
    ) -> Told:
        """Give a command and see what becomes of it, until it `stops` with the report or after some steps."""
        simulation, policy = self._simulation, self._policy
        name = simulation.arrangement[action.slot]
        task = f"{action.verb.name} {name}"
        start = simulation.object_positions()
        is_over, seconds, looked = False, list[float](), list[bool]()
        detector: float | None = None
        for step in range(steps):
            if displaced_cm and step == DISPLACED_AT:
                displace(simulation, action.slot, displaced_cm, random)
                start = simulation.object_positions()
            [looks] = policy.looks([task])
            observation = self._observe(task, looks)
            began = time.perf_counter()
            target = self._postprocess(policy.select_action(self._preprocess(observation)))
            seconds.append(time.perf_counter() - began)
            detector = self._time_of_detector(observation) if step == 0 else detector
            looked.append(looks)
            target = INITIAL_POSE_DEG + share * (target[0].double().cpu().numpy() - INITIAL_POSE_DEG)
            [is_over] = policy.is_done
            if is_over and stops:
                break
            simulation.step(target)
        self._note_times(seconds, looked, detector)
        reward = judge(action, start, simulation.object_positions()).reward
        [said] = policy.responses
        claims = claims_success(said, action.verb.name, name)
        return Told(task, reward, is_over and policy.movement_steps[0] > 0, claims, said)

    def _observe(self, task: str, looks: bool) -> dict[str, Any]:
        """An observation as the environment gives it, with an old image if the policy does not look."""
        simulation = self._simulation
        if looks:
            boxes = simulation.object_boxes(SIZE[1] / SIZE[0])
            objects = describe_objects(boxes, simulation.arrangement)
            self._seen = {"pixels": {EYES: simulation.render(EYES, *SIZE)}, "objects": objects}
        joints = simulation.joint_positions_deg.astype(np.float32)
        return as_batch({**self._seen, "agent_pos": joints}, task)

    @torch.no_grad()
    def _time_of_detector(self, observation: dict[str, Any]) -> float | None:
        if not self._policy.visual.names_objects:
            return None
        batch, began = self._preprocess(observation), time.perf_counter()
        cast(ObjectPoint, self._policy.visual).detector.look(batch)
        return time.perf_counter() - began

    def _note_times(self, seconds: list[float], looked: list[bool], detector: float | None) -> None:
        # Who goes home first, is interrupted or plans again looks at other times, and more or less often.
        if looked[0] and looked[-1] and sum(looked) == 2 < len(looked):
            self.times.append(Times(seconds[0], detector, float(np.mean(seconds[1:-1])), seconds[-1]))


def displace(
    simulation: TabletopSimulation, slot: int, distance_cm: float, random: np.random.Generator
) -> None:
    """Move an object aside, in a random direction.

    It touches neither hand nor other object there, if there is such a direction.
    """
    data = simulation.data
    joint = data.joint(simulation.arrangement[slot])
    place = joint.qpos[:2].copy()
    angles = random.uniform(0, 2 * np.pi) + np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
    for angle in random.permutation(angles):
        joint.qpos[:2] = place + distance_cm / 100 * np.array([np.cos(angle), np.sin(angle)])
        mujoco.mj_forward(simulation.model, data)
        if not _touches_more_than_the_table(simulation, slot):
            return


def _touches_more_than_the_table(simulation: TabletopSimulation, slot: int) -> bool:
    model, touching = simulation.model, simulation.data.contact.geom
    body = model.body(simulation.arrangement[slot]).id
    its_own = (model.geom_bodyid[touching] == body).any(axis=1)
    with_table = (touching == model.geom("table").id).any(axis=1)
    return bool((its_own & ~with_table).any())
