# SPDX-License-Identifier: Apache-2.0
"""A movement from its plan to its report: carried out, home again, looked at, and told as it was."""

from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from lerobot_owlxt5.commands.happened import Change
from lerobot_owlxt5.commands.verbs import AWAY, CLOSER, LEFT, RIGHT
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy
from lerobot_owlxt5.way_home import APPROACH_STEPS, FASTEST, straight, way_back, way_out
from policy_helpers import make_policy, observe

PLACES = {"red": 0, "ball": 1, "mug": 2}
OBJECT_NUMBERS = 28


def long_movements(policy: OWLxT5Policy) -> OWLxT5Policy:
    """The same, and no movement stops before the longest episode's end."""
    torch.nn.init.constant_(policy.model.core.decoder.stop.bias, -100.0)
    return policy


def at_home(t5: Path) -> tuple[OWLxT5Policy, dict[str, Any]]:
    """A policy of long movements, and a robot that is at home and told to push the red cube."""
    policy, batch = long_movements(make_policy(t5, tasks=["push red"])), observe(["push red"])
    policy.rest_pose = batch["observation.state"][0].clone()
    policy.rest_tolerance = torch.full((10,), 0.001)
    return policy, batch


def moved(batch: dict[str, Any], name: str, right: float, down: float) -> dict[str, Any]:
    """The same observation with an object elsewhere; shares of the image."""
    objects = batch["observation.objects"].clone()
    first = PLACES[name] * OBJECT_NUMBERS
    objects[:, first : first + 4] += torch.tensor([right, down, right, down])
    return batch | {"observation.objects": objects}


def carry_out(policy: OWLxT5Policy, before: dict[str, Any], after: dict[str, Any]) -> list[Tensor]:
    """All actions up to the one at which the report is there."""
    actions = [policy.select_action(before)]
    while policy.responses[0].startswith("I will") and len(actions) < 1000:
        actions.append(policy.select_action(after))
    return actions


TRIED = "I tried to push the red cube, but it"


@pytest.mark.parametrize(
    ("task", "name", "right", "down", "report"),
    [
        ("push red", "red", 0.0, -0.1, "I pushed the red cube."),
        ("push red", "red", 0.01, -0.02, "I pushed the red cube."),
        ("push red", "red", 0.0, 0.0, f"{TRIED} did not move."),
        ("push red", "red", 0.0, -0.004, f"{TRIED} did not move."),
        ("push red", "red", 0.05, -0.01, f"{TRIED} moved to the right."),
        ("push red", "ball", 0.0, -0.1, f"{TRIED} did not move, and the ball moved too."),
        ("pull ball", "ball", 0.0, 0.1, "I pulled the ball."),
        ("slide-to-left mug", "mug", -0.1, 0.0, "I slid the mug to the left."),
    ],
)
def test_it_says_what_it_sees_and_no_more(
    t5: Path, task: str, name: str, right: float, down: float, report: str
) -> None:
    policy = make_policy(t5)
    before = observe([task])
    carry_out(policy, before, moved(before, name, right, down))
    assert policy.responses == [report]
    # It was said once, and nothing moves any more.
    last = policy.select_action(before)
    assert policy.responses == [report]
    torch.testing.assert_close(last, before["observation.state"])


def test_what_is_not_seen_any_more_was_not_moved_for_all_it_knows(t5: Path) -> None:
    policy = make_policy(t5)
    carry_out(policy, observe(["push red"]), observe(["push red"], [["", "ball", "mug"]]))
    assert policy.responses == ["I tried to push the red cube, but I cannot see it any more."]


def test_one_thing_after_the_other(t5: Path) -> None:
    policy = make_policy(t5)
    before = observe(["push the red cube and then pull the ball"])
    pushed = moved(before, "red", 0.0, -0.1)
    carry_out(policy, before, pushed)
    assert policy.responses == ["I pushed the red cube. I will pull the ball."]
    pulled = moved(pushed, "ball", 0.0, 0.1)
    for _ in range(1000):
        policy.select_action(pulled)
    assert policy.responses == ["I pulled the ball."]


def test_the_arms_go_home_before_they_begin(t5: Path) -> None:
    policy = make_policy(t5, tasks=["push red"])
    batch = observe(["push red"])
    policy.rest_pose = batch["observation.state"][0].clone()
    policy.rest_tolerance = torch.full((10,), 0.05)
    here = policy.rest_pose + 0.4
    for _ in range(1000):
        action = policy.select_action(batch | {"observation.state": here[None]})
        assert policy.responses == ["I move my arms back first."]
        assert ((action[0] - here).abs() <= FASTEST + 1e-6).all()
        here = action[0]
        if torch.equal(here, policy.rest_pose):
            break
    policy.select_action(batch)
    assert policy.responses == ["I will push the red cube."]


def test_a_new_task_in_mid_movement_sends_the_arms_back_as_they_came(t5: Path) -> None:
    policy, batch = at_home(t5)
    way = [policy.select_action(batch)[0] for _ in range(4)]
    there = batch | {"observation.state": way[-1][None], "task": ["pull ball"]}
    back = [policy.select_action(there)[0]]
    assert policy.responses == ["I move my arms back first."]
    while policy.responses[0].startswith("I move"):
        back.append(policy.select_action(there | {"observation.state": back[-1][None]})[0])
    there_and_back = torch.stack([policy.rest_pose, *way])
    nearest = torch.cdist(torch.stack(back[:-1]), there_and_back).amin(dim=1)
    assert nearest[-1] == 0
    # No farther from the way than half of what its points are from each other.
    assert nearest.max() <= there_and_back.diff(dim=0).norm(dim=1).max() / 2 + 1e-5


def test_who_is_on_its_way_home_goes_on_with_it_whatever_is_asked(t5: Path) -> None:
    """It must not go back to the thing first."""
    ways = []
    for tasks in (["pull ball"], ["pull ball", "push mug"]):
        policy, batch = at_home(t5)
        way = [policy.select_action(batch)[0] for _ in range(6)]
        for step in range(1000):
            task = tasks[min(step, len(tasks) - 1)]
            there = batch | {"observation.state": way[-1][None], "task": [task]}
            way.append(policy.select_action(there)[0])
            if not policy.responses[0].startswith("I move"):
                break
        ways.append(torch.stack(way[:-1]))
    straight_home, asked_again = ways
    torch.testing.assert_close(asked_again[: len(straight_home)], straight_home)
    torch.testing.assert_close(asked_again[len(straight_home) :], asked_again[-1:].expand(1, -1))


def test_a_question_in_mid_movement_does_not_make_it_forget_how_the_arms_came(t5: Path) -> None:
    ways = []
    for tasks in (["pull ball"], ["push nothing that is there", "pull ball"]):
        policy, batch = at_home(t5)
        here, way = [policy.select_action(batch)[0] for _ in range(6)][-1], []
        for task in tasks:
            there = batch | {"observation.state": here[None], "task": [task]}
            way = [policy.select_action(there)[0]]
        while policy.responses[0].startswith("I move"):
            way.append(policy.select_action(there | {"observation.state": way[-1][None]})[0])
        ways.append(torch.stack(way[:-1]))
    at_once, after_a_question = ways
    torch.testing.assert_close(at_once[-1], after_a_question[-1])
    assert torch.cdist(after_a_question, at_once).amin(dim=1).max() < 0.02


def test_a_plan_that_is_over_by_now_is_not_passed_over_to(t5: Path) -> None:
    """As that of a rival whose thing is out of reach now."""
    policy = long_movements(make_policy(t5))
    for _ in range(5):
        policy.select_action(observe(["push red"]))
    [execution] = policy.executions
    assert execution is not None and execution.memory is not None
    path = execution.path.clone()
    execution.change_plan(execution.start.expand(12, -1), execution.memory)
    assert torch.equal(execution.path, path)
    execution.change_plan(torch.linspace(-1, 1, 12)[:, None].expand(-1, 10), execution.memory)
    assert not torch.equal(execution.path, path)
    assert execution.path.abs().max() <= max(1.0, path.abs().max())


def test_a_thing_that_is_moved_aside_is_followed(t5: Path) -> None:
    usual, follows = (long_movements(make_policy(t5, replan_every=every)) for every in (0, 2))
    before = observe(["push red"])
    aside = moved(before, "red", 0.1, 0.0)
    ways = {}
    for name, policy in (("usual", usual), ("follows", follows)):
        ways[name] = torch.stack([policy.select_action(before if s < 2 else aside)[0] for s in range(5)])
    assert torch.equal(ways["usual"][:2], ways["follows"][:2])
    assert not torch.equal(ways["usual"][2:], ways["follows"][2:])
    steps = ways["follows"].diff(dim=0).abs().max()
    assert steps <= 2 * ways["usual"].diff(dim=0).abs().max()


@pytest.mark.parametrize("way", [AWAY, CLOSER, LEFT, RIGHT, "", None])
def test_a_report_claims_success_only_if_it_was_seen(way: str | None) -> None:
    said = Change(way).report("push", "ball")
    assert (said == "I pushed the ball.") == (way == AWAY)
    assert "tried" in said or way == AWAY


@given(
    st.lists(st.lists(st.floats(-1, 1), min_size=3, max_size=3), min_size=2, max_size=60),
    st.sampled_from([way_back, way_out]),
)
def test_the_way_home_ends_where_the_way_began(points: list[list[float]], way: Any) -> None:
    movement = torch.tensor(points)
    back = way(movement)
    assert torch.equal(back[-1], movement[0])
    steps = torch.cat([movement[-1:], back]).diff(dim=0).abs()
    assert (steps <= movement.diff(dim=0).abs().amax(dim=0).clamp(min=FASTEST / 10) + 1e-5).all()


def test_the_way_home_spares_the_stroke() -> None:
    movement = torch.linspace(0, 1, 80)[:, None].repeat(1, 2)
    movement[40:, 1] = 0.9
    back, retraced = way_back(movement), way_out(movement)
    # Where the stroke began the other joint is on its straight way already.
    assert retraced[retraced[:, 0] > 0.6, 1].min() > 0.89
    assert back[(back[:, 0] - 0.6).abs().argmin(), 1] < 0.65
    assert torch.cdist(movement[APPROACH_STEPS:][:1], back).min() < 0.02


def test_a_way_to_where_one_is_is_short() -> None:
    assert len(straight(torch.zeros(3), torch.zeros(3))) == 1


def test_it_says_when_it_looks_and_when_it_is_done(t5: Path) -> None:
    policy, batch = long_movements(make_policy(t5, replan_every=5)), observe(["push red"])
    assert policy.is_done == [] and policy.looks(["push red"]) == [True]
    looked = list[int]()
    for step in range(1000):
        looks = policy.looks(["push red"])
        looked += [step] if looks[0] else []
        # A black image is as good where it does not look: else it would see that the cube is gone.
        blind = batch | {"observation.objects": torch.zeros_like(batch["observation.objects"])}
        policy.select_action(batch if looks[0] else blind)
        if policy.is_done[0]:
            break
    assert looked == [0, 5, 10, step]
    assert policy.responses == ["I tried to push the red cube, but it did not move."]
    assert policy.looks(["push red"]) == [False] and policy.looks(["pull red"]) == [True]
    policy.select_action(batch | {"task": ["pull red"]})
    assert policy.is_done == [False]
