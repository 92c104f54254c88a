# SPDX-License-Identifier: Apache-2.0
"""LeRobot's environment types `clant` and `claeo`: `lerobot-eval --env.type=claeo`."""

from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import gymnasium as gym
from lerobot.configs import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.envs.utils import _LazyAsyncVectorEnv
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE

from .distractors import check_distractors
from .drawing import check_image_size
from .env import TabletopEnv, check_episode_length
from .objects import read_objects
from .placement import find_placement
from .record import EPISODES
from .robot import EYES, JOINT_NAMES
from .simulation import CONTROL_HZ
from .tasks import ACTIONS, EPISODE_STEPS, SLOTS, find_action
from .variation import Variation
from .words import CANONICAL, check_words


@dataclass
class TabletopEnvConfig(EnvConfig):
    """What both environment types share; a type presets the objects.

    Attributes:
        task: CLANT's action names, separated by commas, such as `PUSH-L,SLIDE-M-R`; all twelve when unset.
            The task id of an action is its place in CLANT's order, whatever is chosen.
        placement: `slots` (objects stand on CLANT's three slots), `free` (anywhere in reach, at any yaw) or
            `mixed` (now so, now so).
        observation_height: Rows of the eyes' image.
        observation_width: Columns of the eyes' image.
        objects: Objects on the table: the name of a shipped set (`clant`, `claeo`, `household`) or the path
            of a YAML file (docs/objects.md).
        words: What is said, one of `words.WORDS`, such as `polite` or `absent`.
        distractors: So many further objects of the set stand on the table, out of the way.
        variation: How much each reset may differ from the paper's setting, such as `variation.arms_deg=5`.
        episode_length: Steps of an episode.
        output_dir: Folder for `episodes.jsonl`, which says what became of each episode; give it the value of
            `--output_dir`, as LeRobot tells an environment nothing of it.
    """

    task: str | None = None
    placement: str = "slots"
    fps: int = CONTROL_HZ
    observation_height: int = 240
    observation_width: int = 320
    objects: str = "clant"
    words: str = CANONICAL
    distractors: int = 0
    variation: Variation = field(default_factory=Variation)
    episode_length: int = EPISODE_STEPS
    output_dir: str | None = None
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(
        default_factory=lambda: {
            ACTION: ACTION,
            f"pixels/{EYES}": f"{OBS_IMAGES}.{EYES}",
            "agent_pos": OBS_STATE,
        }
    )

    def __post_init__(self) -> None:
        joints = (len(JOINT_NAMES),)
        image = (self.observation_height, self.observation_width, 3)
        self.features = {
            ACTION: PolicyFeature(FeatureType.ACTION, joints),
            f"pixels/{EYES}": PolicyFeature(FeatureType.VISUAL, image),
            "agent_pos": PolicyFeature(FeatureType.STATE, joints),
        }

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of `TabletopEnv` that are the same for all tasks."""
        return {
            "objects": self.objects,
            "height": self.observation_height,
            "width": self.observation_width,
            "placement": self.placement,
            "words": self.words,
            "distractors": self.distractors,
            "variation": self.variation,
            "episode_length": self.episode_length,
            "record": None if self.output_dir is None else str(Path(self.output_dir) / EPISODES),
        }

    def create_envs(
        self, n_envs: int, use_async_envs: bool = False
    ) -> dict[str, dict[int, gym.vector.VectorEnv]]:
        """One vector environment per action: {objects: {task id: environments}}.

        LeRobot calls the outer key a task group and files results under it: the name of the set of objects,
        or that of the YAML file without its ending.

        Raises:
            ValueError: If `task` names an unknown action, `placement` or `words` are unknown, images, `fps`
                or `episode_length` cannot be had, the objects cannot be used, or there are not enough of them
                for `distractors` and `words`.
            OSError: If nothing can be written to `output_dir`.
        """
        # Asynchronous environments would find out in their workers.
        check_image_size(self.observation_height, self.observation_width)
        if self.fps != CONTROL_HZ:
            raise ValueError(f"the world runs at {CONTROL_HZ} frames per second; got --env.fps={self.fps}")
        check_episode_length(self.episode_length)
        find_placement(self.placement)
        count = len(read_objects(self.objects))
        check_distractors(self.distractors, count, self.placement, self.variation.shift_cm)
        check_words(self.words, count, len(SLOTS) + self.distractors)
        if self.output_dir is not None:
            Path(self.output_dir).mkdir(parents=True, exist_ok=True)
            (Path(self.output_dir) / EPISODES).write_text("", encoding="utf-8")
        chosen = [find_action(name) for name in self.task.split(",")] if self.task else ACTIONS
        envs: dict[int, Any] = {}
        for action in chosen:
            makers = [partial(TabletopEnv, action=action.name, **self.gym_kwargs)] * n_envs
            # LeRobot's lazy vector environment starts its workers when the task's turn comes.
            asynchronous = use_async_envs and n_envs > 1
            envs[ACTIONS.index(action)] = (_LazyAsyncVectorEnv if asynchronous else gym.vector.SyncVectorEnv)(
                makers
            )
        return {Path(self.objects).stem: envs}


@EnvConfig.register_subclass("clant")
@dataclass
class ClantEnvConfig(TabletopEnvConfig):
    """CLANT's coloured cubes, unless `objects` names others."""


@EnvConfig.register_subclass("claeo")
@dataclass
class ClaeoEnvConfig(TabletopEnvConfig):
    """CLAEO's everyday objects, unless `objects` names others."""

    objects: str = "claeo"
