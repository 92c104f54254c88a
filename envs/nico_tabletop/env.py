# SPDX-License-Identifier: Apache-2.0
"""One CLANT action as a Gymnasium environment."""

import textwrap
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from .distractors import Distractor, check_distractors, draw_distractors
from .drawing import check_image_size
from .objects import NAME_BYTES, read_objects
from .placement import Pose, find_placement
from .record import Episode, add_episode
from .robot import EYES, INITIAL_POSE_DEG, JOINT_NAMES, joint_limits_deg
from .scene import SPECTATOR
from .scoring import Outcome, judge, why_it_failed
from .simulation import CONTROL_HZ, TabletopSimulation
from .starts import draw_conditions
from .tasks import EPISODE_STEPS, SLOTS, Action, arrangements, find_action, find_task
from .variation import Conditions, Variation
from .words import CANONICAL, Command, canonical, check_words, draw_command

DESCRIPTION_SIZE = len(SLOTS) * (4 + NAME_BYTES)
"""Length of what `describe_objects` returns."""

HELD_STILL_DEG = 1.0
"""A robot that is never told to move any joint farther than this from where it was at reset holds still."""

_LINE = 52  # letters across the bystander's image


def describe_objects(boxes: NDArray[np.float64], names: tuple[str, ...]) -> NDArray[np.float32]:
    """The simulator's ground truth about the objects as one vector.

    Args:
        boxes: Shape (3, 4), see `TabletopSimulation.object_boxes`.
        names: The objects on the left, middle and right slot.

    Returns:
        Shape (84,), float32: for each object its box x0, y0, x1, y1 and the 24 bytes of its name in UTF-8,
        padded with zeros.
    """
    letters = [list(name.encode()[:NAME_BYTES].ljust(NAME_BYTES, b"\0")) for name in names]
    return np.concatenate([boxes, np.array(letters)], axis=1).astype(np.float32).ravel()


def check_episode_length(steps: int) -> None:
    """Check that an episode has a step.

    Raises:
        ValueError: If it has none.
    """
    if steps < 1:
        raise ValueError(f"an episode has at least one step; got episode_length={steps}")


class TabletopEnv(gym.Env[dict[str, Any], NDArray[np.float32]]):
    """NICO shall push, pull or slide one of three objects; each reset draws which objects stand where.

    Observation:
        pixels/eyes: uint8 (height, width, 3), the image between NICO's eyes.
        agent_pos: float32 (10,), measured joint angles, degrees.
        objects: float32 (84,), *ground truth* for upper bounds, see `describe_objects`.

    Action: float32 (10,), joint targets in degrees, one per 0.1 s, in the order of `robot.JOINT_NAMES`.
    Targets beyond the joint limits are clipped; NaN and infinity raise `JointTargetError`.

    An episode ends after `episode_length` steps. Then `info` has `is_success`, `outcome` and, if it failed,
    `failure` (`scoring.Failure`), and the reward is 1 for a perfect, 0.5 for a successful outcome.

    `reset(options={"arrangement": (left, middle, right)})` names the objects instead of drawing them, and
    `options={"poses": ((x, y, yaw), …)}` says how they stand, see `placement.Pose`. Reset's info has both.
    `options={"task": "push mug"}` judges this episode by a task in CLANT's words in place of `action`; an
    arrangement that is drawn has its object. Such a task is said as it is, whatever `words` are.

    `options={"conditions": Conditions(…)}` says exactly how arms, camera, light and so on differ from the
    paper's setting, instead of drawing it from `variation`, and `options={"distractors": ((name, pose), …)}`
    which further objects there are. Reset's info has both: with arrangement and poses of the same info they
    give the same start again.

    What is said is `task_description`, and the episode is judged by it: with `words="counterfactual"` by the
    object that it names, with `words="absent"` it is perfect to hold still and a failure to move. A seed
    draws the same scene, whatever is said.

    `options={"keep": True, "task": "pull mug"}` goes on from where objects and arms are, with a new task that
    is judged from there.

    Attributes:
        simulation: The table, the robot and the objects.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": CONTROL_HZ}  # noqa: RUF012  Gymnasium's own attribute

    def __init__(
        self,
        action: str,
        objects: str = "clant",
        height: int = 240,
        width: int = 320,
        placement: str = "slots",
        words: str = CANONICAL,
        distractors: int = 0,
        render_mode: str = "rgb_array",
        record: str | Path | None = None,
        variation: Variation | None = None,
        episode_length: int = EPISODE_STEPS,
    ) -> None:
        """Make the environment; what draws it is made with the first image.

        Args:
            action: CLANT's name of the action, such as `PUSH-L`.
            objects: Name of a shipped set of objects (`objects.SHIPPED`) or path of a YAML file.
            height: Rows of the eyes' image.
            width: Columns of the eyes' image.
            placement: `slots` (CLANT's three places), `free` (drawn anew in each reset, `draw_poses`) or
                `mixed` (each in half of the resets).
            words: Kind of what is said, see `words.WORDS`.
            distractors: So many further objects of the set stand on the table, drawn anew in each reset.
            render_mode: Gymnasium's; `rgb_array` is the only one.
            record: File to which each finished episode is added, see `record.Episode`.
            variation: How much each reset may differ from the paper's setting; None: not at all.
            episode_length: Steps of an episode.

        Raises:
            ValueError: If there is no such action, placement, kind of words or render mode, the image is too
                small or too large, an episode has no step, the objects cannot be used, or they are too few.
        """
        check_episode_length(episode_length)
        if render_mode not in self.metadata["render_modes"]:
            raise ValueError(f"render_mode must be rgb_array; got {render_mode!r}")
        self.render_mode = render_mode
        self._own_action = self.action = find_action(action)
        self.command = Command("", self.action)
        self._objects = objects
        self._record = None if record is None else Path(record)
        self._draw_poses = find_placement(placement)
        check_image_size(height, width)
        self._size = (height, width)
        self._variation = variation or Variation()
        self._max_episode_steps = episode_length
        items = read_objects(objects)
        check_distractors(distractors, len(items), placement, self._variation.shift_cm)
        check_words(words, len(items), len(SLOTS) + distractors)
        self._words, self._distractors = words, distractors
        self._names = {word: item.name for item in items for word in (item.name, *item.synonyms)}
        self.simulation = TabletopSimulation(items)
        self._step = 0
        limits = joint_limits_deg().astype(np.float32)
        self.action_space = spaces.Box(limits[:, 0], limits[:, 1], dtype=np.float32)
        self.observation_space = spaces.Dict(
            {
                "pixels": spaces.Dict({EYES: spaces.Box(0, 255, (height, width, 3), dtype=np.uint8)}),
                "agent_pos": spaces.Box(-360.0, 360.0, (len(JOINT_NAMES),), dtype=np.float32),
                "objects": spaces.Box(-1.0, 255.0, (DESCRIPTION_SIZE,), dtype=np.float32),
            }
        )

    @property
    def task(self) -> str:
        """CLANT's name of the environment's action, or of that of reset's options."""
        return self.action.name

    @property
    def task_description(self) -> str:
        """What is said in this episode: in CLANT's words `push red` or `slide-to-left ball`."""
        return self.command.text

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Place three objects and return to the initial pose; see the class for observation and options.

        Raises:
            ValueError: If an option cannot be met.
        """
        super().reset(seed=seed)
        options = options or {}
        task = options.get("task")
        verb, target = find_task(task, self._names) if task else (None, None)
        # From generators of their own: a seed draws the same scenes, whatever varies and whatever is said.
        random = self.np_random.spawn(1)[0]
        for_distractors, for_words = random.spawn(2)
        if options.get("keep"):
            start = self._kept_start(options)
        else:
            start = self._new_start(options, target, random, for_distractors)
        arrangement = self.simulation.arrangement
        if target is not None and target not in arrangement:
            raise ValueError(f"the task {task!r} needs a {target}, but there are {list(arrangement)}")
        self.action = self._own_action if verb is None else Action(arrangement.index(target), verb)
        if target is not None:
            self.command = canonical(self.action, target)
        else:
            further = [name for name, _ in start["distractors"]]
            objects = self.simulation.objects
            self.command = draw_command(self._words, self.action, objects, arrangement, further, for_words)
        self._seed, self._scene = seed, start
        self._held_still = True
        self._start = self._positions()
        self._start_pose = self.simulation.joint_positions_deg
        self._step = 0
        return self._observation(), {"arrangement": arrangement, **start}

    def _new_start(
        self,
        options: dict[str, Any],
        target: str | None,
        for_conditions: np.random.Generator,
        for_distractors: np.random.Generator,
    ) -> dict[str, Any]:
        """Place the objects and the arms anew; poses, conditions and distractors, for reset's info."""
        arrangement = options.get("arrangement")
        if arrangement is None:
            choices = arrangements(tuple(self.simulation.objects))
            choices = [each for each in choices if target is None or target in each]
            arrangement = choices[self.np_random.integers(len(choices))]
        poses = options.get("poses")
        if poses is None:
            poses = self._draw_poses(self.np_random)
        poses = tuple(Pose(*pose) for pose in poses)
        conditions = options.get("conditions")
        if conditions is None:
            conditions = draw_conditions(self._variation, poses, for_conditions)
        distractors = options.get("distractors")
        if distractors is None:
            left = [name for name in self.simulation.objects if name not in arrangement]
            shifted = conditions.shifted(poses)
            distractors = draw_distractors(self._distractors, left, shifted, for_distractors)
        distractors = tuple(Distractor(name, Pose(*pose)) for name, pose in distractors)
        self.simulation.reset(arrangement, poses, conditions, distractors)
        return {"poses": poses, "conditions": conditions, "distractors": distractors}

    def _kept_start(self, options: dict[str, Any]) -> dict[str, Any]:
        """Leave objects and arms where they are; poses, conditions and distractors, for reset's info."""
        if given := [
            name
            for name in ("arrangement", "poses", "conditions", "distractors")
            if options.get(name) is not None
        ]:
            raise ValueError(f"reset with keep goes on from what is there: leave out {' and '.join(given)}")
        if not self.simulation.arrangement:
            raise ValueError(
                "reset with keep goes on from an episode, and there was none: reset without it first"
            )
        arms = self.simulation.joint_positions_deg - INITIAL_POSE_DEG
        conditions = replace(
            self.simulation.conditions, arms_deg=tuple(arms.tolist()), shift_cm=Conditions().shift_cm
        )
        return {
            "poses": self.simulation.object_poses(),
            "conditions": conditions,
            "distractors": self.simulation.present_distractors(),
        }

    def _positions(self) -> NDArray[np.float64]:
        """Of the three objects, then of the distractors, shape (objects, 3), metres."""
        simulation = self.simulation
        return np.concatenate([simulation.object_positions(), simulation.distractor_positions()])

    def step(self, action: NDArray[np.float32]) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Follow the joint targets for 0.1 s; see the class for observation, reward and info."""
        self.simulation.step(action)
        self._held_still &= bool(np.abs(action - self._start_pose).max() <= HELD_STILL_DEG)
        self._step += 1
        if self._step < self._max_episode_steps:
            return self._observation(), 0.0, False, False, {"is_success": False}
        end, asked = self._positions(), self.command.action
        if asked is None:
            outcome = Outcome.PERFECT if self._held_still else Outcome.FAILURE
        else:
            outcome = judge(asked, self._start, end)
        info: dict[str, Any] = {"is_success": outcome.reward > 0, "outcome": str(outcome)}
        if outcome is Outcome.FAILURE:
            info["failure"] = str(why_it_failed(asked, self._start, end, held_still=self._held_still))
        if self._record is not None:
            add_episode(
                self._record,
                Episode(
                    seed=self._seed,
                    objects=self._objects,
                    arrangement=self.simulation.arrangement,
                    action=self.task,
                    task=self.task_description,
                    outcome=info["outcome"],
                    failure=info.get("failure", ""),
                    reward=outcome.reward,
                    words=self._words,
                    asked=None if asked is None else asked.name,
                    poses=self._scene["poses"],
                    conditions=self._scene["conditions"].facts(),
                    distractors=self._scene["distractors"],
                ),
            )
        return self._observation(), outcome.reward, False, True, info

    def _observation(self) -> dict[str, Any]:
        height, width = self._size
        boxes = self.simulation.object_boxes(width / height)
        return {
            "pixels": {EYES: self.simulation.render(EYES, height, width)},
            "agent_pos": self.simulation.joint_positions_deg.astype(np.float32),
            "objects": describe_objects(boxes, self.simulation.arrangement),
        }

    def render(self) -> NDArray[np.uint8]:
        """The scene as a bystander sees it, with the command in it, uint8 (360, 480, 3)."""
        image = Image.fromarray(self.simulation.render(SPECTATOR, 360, 480))
        ImageDraw.Draw(image).text(
            (8, 6),
            textwrap.fill(self.task_description, _LINE),
            "white",
            ImageFont.load_default(18),
            stroke_width=2,
            stroke_fill="black",
        )
        return np.asarray(image)

    def close(self) -> None:
        """Free what draws the world."""
        self.simulation.close()
