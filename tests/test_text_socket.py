# SPDX-License-Identifier: Apache-2.0
"""LeRobot's text queries: asked in the middle of a rollout, answered without a difference to the movement."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import torch
from torch import Tensor

from lerobot_owlxt5.commands.replies import ABILITIES, NO_OBJECTS_SEEN
from lerobot_owlxt5.configuration_motion_library import MotionLibraryConfig
from lerobot_owlxt5.executing_policy import ExecutingPolicy
from lerobot_owlxt5.modeling_motion_library import MotionLibraryPolicy
from lerobot_owlxt5.sighting import without_objects
from lerobot_owlxt5.text_query import AS_A_TASK
from nico_tabletop.configuration import ClantEnvConfig
from policy_helpers import make_config, make_policy, object_features, observe

SEES = "I see a cube, a ball and a mug."
IT = "slide it to the left"


@dataclass
class Session:
    """What `lerobot-rollout --interactive` does with a policy: RolloutController and its sync engine.

    Its commands are methods here; `start` stands for the reset before a run. A tick is one turn of the
    control loop: an action, then the answer to what was asked.
    """

    policy: ExecutingPolicy
    observation: dict[str, Any]
    task: str
    answers: list[str] = field(default_factory=list)
    changed: bool = False
    query: tuple[str, str] | None = None

    def start(self) -> None:
        self.policy.reset()
        self.changed = False

    def subtask(self, text: str) -> None:
        self.changed |= text != self.task
        self.task = text

    def vqa(self, text: str) -> None:
        assert self.policy.supports_text_generation()
        self.query = ("vqa", text)

    def autosteer(self, goal: str) -> None:
        assert self.policy.supports_text_generation()
        self.query = ("next_subtask", goal)

    @torch.inference_mode()
    def tick(self) -> Tensor:
        if self.changed:
            self.policy.drop_queued_actions()
        self.changed = False
        action = self.policy.select_action(self.observation | {"task": [self.task]})
        if self.query:
            (kind, text), self.query = self.query, None
            asked = {"task": [self.task], "query_kind": kind, "query_text": text}
            answer = self.policy.generate_text(self.observation | asked)
            assert isinstance(answer, str)
            assert answer.strip()
            self.answers.append(answer)
            if kind == "next_subtask":
                self.subtask(answer)
        # The arms follow.
        self.observation = self.observation | {"observation.state": action.clone()}
        return action


@pytest.fixture(params=["owlxt5", "motion_library"])
def session(request: pytest.FixtureRequest, t5: Path) -> Session:
    observation = observe(["push ball"])
    if request.param == "owlxt5":
        policy: ExecutingPolicy = make_policy(t5, understanding="embedded")
        # No movement stops early.
        torch.nn.init.constant_(policy.model.core.decoder.stop.bias, -100.0)
    else:
        config = MotionLibraryConfig(device="cpu", detector="ground_truth")
        features = make_config(t5)
        config.input_features, config.output_features = features.input_features, features.output_features
        policy = MotionLibraryPolicy(config, env_cfg=ClantEnvConfig())
        observation["observation.state"] = policy.rest_pose[None].clone()
        within_reach = object_features(["red", "ball", "mug"], (0.35, 0.5, 0.65))
        observation["observation.objects"] = torch.from_numpy(within_reach)[None]
    session = Session(policy, observation, "push ball")
    session.start()
    return session


def test_questions_do_not_disturb_the_movement(session: Session) -> None:
    begin = session.observation
    undisturbed = [session.tick() for _ in range(8)]
    session.observation = begin
    session.start()
    actions = []
    for question in ("what do you see?", "what can you do?", "pull the mug", IT):
        session.vqa(question)
        actions += [session.tick(), session.tick()]
    torch.testing.assert_close(torch.cat(actions), torch.cat(undisturbed), rtol=0, atol=0)
    assert session.policy.responses == ["I will push the ball."]
    assert session.answers == [
        SEES,
        ABILITIES,
        f"{AS_A_TASK} I will pull the mug.",
        f"{AS_A_TASK} I will slide the ball to the left.",
    ]


def test_what_is_not_understood_or_not_seen_is_no_answer_to_act_on(session: Session) -> None:
    session.vqa("push the banana")
    session.tick()
    assert session.answers == [f"{AS_A_TASK} I cannot see a banana. {SEES}"]
    # The robot moves: that it holds still would be false without what comes before.
    session.vqa("don't push the mug")
    session.tick()
    assert session.answers[-1] == f"{AS_A_TASK} I hold still."


def test_a_new_instruction_in_the_middle_of_a_movement_takes_effect(session: Session) -> None:
    for _ in range(5):
        before = session.tick()
    session.subtask("pull the mug")
    session.vqa("what do you see?")
    after = session.tick()
    assert session.answers == [SEES]
    assert session.policy.responses[0].endswith(("I will pull the mug.", "I move my arms back first."))
    assert not torch.equal(before, after)
    for _ in range(100):
        if session.policy.responses == ["I will pull the mug."]:
            break
        session.tick()
    assert session.policy.responses == ["I will pull the mug."]


def test_autosteer_carries_out_a_goal_wish_by_wish(session: Session) -> None:
    goal = "push the ball and then pull the mug"
    session.autosteer(goal)
    session.tick()
    assert session.task == goal
    for _ in range(100):
        session.tick()
        if session.policy.responses[0].startswith("I will push the ball"):
            break
    assert session.policy.responses == ["I will push the ball, and then pull the mug."]
    # Asked again, it stays with it.
    session.autosteer(goal)
    session.tick()
    assert not session.changed


def test_before_a_start_the_task_itself_is_asked(session: Session) -> None:
    assert session.policy.generate_text(session.observation | {"task": ["what do you see?"]}) == SEES
    assert session.policy.responses == []


def test_one_robot_and_one_text(t5: Path) -> None:
    policy = make_policy(t5)
    with pytest.raises(ValueError, match="ask for each alone"):
        policy.generate_text(observe(["push red", "push ball"]))
    with pytest.raises(ValueError, match="must be one text"):
        policy.generate_text(observe(["push red"]) | {"query_text": 3})


def test_a_policy_that_sees_no_objects_claims_nothing(t5: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = make_policy(t5, understanding="embedded")
    monkeypatch.setattr(policy, "_look", lambda _, searches, __: ([*map(without_objects, searches)], None))
    answer = policy.generate_text(observe(["what do you see?"]))
    assert answer == f"{AS_A_TASK} {NO_OBJECTS_SEEN}"
