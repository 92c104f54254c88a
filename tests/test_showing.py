# SPDX-License-Identifier: Apache-2.0
"""Somebody moves the robot's arms: it tells what was done, and does it again."""

from types import SimpleNamespace
from typing import Any

import pytest
import torch
from lerobot.policies.factory import make_pre_post_processors
from lerobot.utils.constants import ACTION, OBS_STATE
from torch import Tensor

from lerobot_owlxt5 import OWLxT5Policy
from lerobot_owlxt5.commands.happened import retell
from lerobot_owlxt5.commands.replies import NOTHING_KNOWN, NOTHING_MOVED
from lerobot_owlxt5.conversation.conversation import DONE_AS_YOU_DID
from lerobot_owlxt5.conversation.rules import plan_by_rules
from lerobot_owlxt5.conversation.showing import NOTHING_SHOWN, NOTHING_TO_IMITATE, WATCHING, Showing
from lerobot_owlxt5.conversation.steps import Describe, Imitate, Situation, Watch
from lerobot_owlxt5.data.windows import recover_actions
from lerobot_owlxt5.modeling_crossmodal import CrossmodalPolicy
from lerobot_owlxt5.motion_library import MotionLibrary
from lerobot_owlxt5.trained import find_policy, is_there
from stage import Scene, Stage, Turn

STEPS = 6


class Arms:
    """Stands in for a `Body`: it is wherever somebody has put it."""

    def __init__(self) -> None:
        self.angle = 0.0

    def look(self) -> None:
        pass

    def observation(self, task: str) -> dict[str, Any]:
        return {OBS_STATE: torch.full((1, 2), self.angle), "task": [task]}

    def batch(self, task: str) -> dict[str, Any]:
        return self.observation(task)

    def preprocess(self, batch: dict[str, Any]) -> dict[str, Any]:
        return batch


class Watcher(CrossmodalPolicy):
    """Stands in for a policy: it keeps what it is shown."""

    def __init__(self) -> None:
        torch.nn.Module.__init__(self)
        self.config = SimpleNamespace(max_episode_steps=STEPS, was_trained_in=lambda mode: True)  # type: ignore[assignment]
        self.visual = SimpleNamespace(names_objects=True)  # type: ignore[assignment]

    def scenes(self, batch: dict[str, Any]) -> list[Any]:
        return [SimpleNamespace(things=[SimpleNamespace(name="mug"), SimpleNamespace(name="mug")])]

    def describe(self, batch: dict[str, Any], labels: Any = None) -> list[str]:
        self.shown, self.labels = batch, labels
        return ["push mug"]

    def repeat_action(self, batch: dict[str, Any]) -> Tensor:
        assert batch["task"] == ["push mug"]
        return recover_actions(batch[ACTION], batch["action_is_pad"])[0]


def shown(angles: list[float]) -> tuple[Watcher, Showing, list[str]]:
    policy, arms = Watcher(), Arms()
    showing = Showing(policy, arms)  # type: ignore[arg-type]
    said = [showing.begin()]
    for angle in angles:
        arms.angle = angle
        said += [showing.watch()]
    return policy, showing, said


def test_it_watches_from_the_first_movement_on() -> None:
    policy, showing, said = shown([0.0, 0.5, 3.0, 6.0, 7.0])
    assert (said, showing.goes_on) == ([WATCHING, "", "", "", "", ""], True)
    assert showing.end() == "You pushed the mug."
    actions, length = recover_actions(policy.shown[ACTION], policy.shown["action_is_pad"])
    assert (length.item(), actions[0, :3, 0].tolist()) == (3, [3.0, 6.0, 7.0])
    assert policy.shown[OBS_STATE][0, :, 0].tolist() == [0.5, 7.0]  # before the movement, and after it
    assert policy.labels == ["mug"]
    again = showing.movement()
    assert isinstance(again, Tensor)
    assert again[:, 0].tolist() == [3.0, 6.0, 7.0, 7.0, 7.0, 7.0]


def test_it_says_by_itself_when_it_cannot_watch_longer() -> None:
    _, showing, said = shown([5.0 * step for step in range(1, STEPS + 1)])
    assert said[-2:] == ["", "You pushed the mug."]
    assert not showing.goes_on


def test_nothing_was_shown() -> None:
    _, showing, _ = shown([0.2, 0.4])
    assert showing.movement() == NOTHING_TO_IMITATE
    assert showing.end() == NOTHING_SHOWN
    assert showing.movement() == NOTHING_TO_IMITATE
    assert showing.end() == NOTHING_SHOWN


@pytest.mark.parametrize(
    ("described", "said"),
    [
        ("slide-to-left mustard bottle", "You slid the mustard bottle to the left."),
        ("push red", "You pushed the red cube."),
        (NOTHING_MOVED, "You moved nothing, as far as I saw."),
        (NOTHING_KNOWN, "I cannot tell what you moved."),
        ("", "I cannot tell what you moved."),
        ("mug", "I cannot tell what you moved."),
    ],
)
def test_what_was_described_is_retold(described: str, said: str) -> None:
    assert retell(described) == said


def test_the_words_for_it() -> None:
    situation = Situation(lambda words: pytest.fail("these words are not for the understanding"))
    assert plan_by_rules("Watch me!", situation) == Watch()
    assert plan_by_rules("schau mir zu", situation) == Watch()
    assert plan_by_rules("do it as I did, please", situation) == Imitate()
    watching = Situation(situation.understand, watching=True)
    assert plan_by_rules("done", watching) == Describe()
    assert plan_by_rules("ich bin fertig", watching) == Describe()


@pytest.mark.slow
@pytest.mark.skipif(not is_there(), reason="the package has no trained policy: python -m owlxt5_policy.ship")
def test_the_trained_policy_tells_what_it_was_shown_and_does_it_again() -> None:
    policy = OWLxT5Policy.from_pretrained(find_policy())
    stage = Stage(policy, make_pre_post_processors(policy.config, str(find_policy())))
    things = ["mug", "white chess piece", "can"]
    robot = stage.set(Scene("claeo", things))
    stage.say(Turn("watch me"))
    place = torch.from_numpy(robot.simulation.object_positions()[0, :2]).float()
    library = MotionLibrary()
    motion = library.joint_targets("push", place)
    assert motion is not None
    arm, targets = motion
    for target in targets:
        pose = library.rest.clone()
        pose[arm] = target
        robot.send_action(dict(zip(robot.action_features, pose.tolist(), strict=True)))
        stage.conversation.tick()
    if stage.conversation.watching:  # the movement may be as long as it can watch
        stage.conversation.hear("done")
    assert stage.conversation.lines[-1].text == "You pushed the mug."
    robot.reset(things)
    answers, moved = stage.say(Turn("now you"))
    assert answers[-1] == DONE_AS_YOU_DID
    assert moved == "mug away"
    robot.disconnect()
