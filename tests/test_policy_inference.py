# SPDX-License-Identifier: Apache-2.0
"""The policy on a robot, and the modes that speak."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from lerobot.datasets import LeRobotDataset
from lerobot.policies.factory import make_pre_post_processors

from lerobot_owlxt5.backbones.detections import Candidates, Detector
from lerobot_owlxt5.commands.answer import Action, Request, Target
from lerobot_owlxt5.commands.instruction import TaskReader
from lerobot_owlxt5.commands.replies import GOING_HOME, NOTHING_KNOWN, NOTHING_MOVED, TOO_LONG
from lerobot_owlxt5.data.normalization import share_joint_range
from lerobot_owlxt5.data.start_pose import NEAR, start_tolerance
from lerobot_owlxt5.modeling_owlxt5 import OWLxT5Policy
from lerobot_owlxt5.object_point import ObjectPoint
from lerobot_owlxt5.scene import Thing
from lerobot_owlxt5.way_home import FASTEST
from policy_helpers import (
    ENDS,
    EYES,
    HORIZON,
    load_batch,
    make_grounding_dino,
    make_owlv2,
    make_policy,
    observe,
    record_prompts,
)

TASKS = ["push red", "Pull the ball!", "slide-to-left can", "dance wildly"]


def observe_finished() -> dict[str, Any]:
    """One episode that has ended."""
    return observe(["push red"]) | {
        "action": torch.zeros(1, 2 * HORIZON - 1, 10),
        "action_is_pad": torch.arange(2 * HORIZON - 1)[None] < HORIZON,
    }


def test_a_plan_is_made_once_and_its_end_held(t5: Path) -> None:
    policy = make_policy(t5)
    torch.nn.init.constant_(policy.model.core.decoder.stop.bias, -100.0)
    batch = observe(TASKS)
    plan = policy.predict_action_chunk(batch)
    assert plan.shape == (4, HORIZON, 10)
    assert torch.isfinite(plan).all()
    assert plan.abs().max() <= 1
    policy.reset()
    with torch.inference_mode():
        actions = [policy.select_action(batch)]
        # A camera that shows something else in the middle of a movement must change nothing.
        actions += [policy.select_action(observe(TASKS, [["", "", ""]] * 4)) for _ in range(9 * HORIZON)]
    carried_out = torch.stack(actions, dim=1)
    assert torch.equal(carried_out[:, :HORIZON], plan)
    # Those who moved are where they began, and the others have never left it.
    torch.testing.assert_close(carried_out[:, -1], batch["observation.state"])


@pytest.mark.parametrize("task", ["", "  ", "?"])
def test_an_empty_command_moves_nothing_even_if_it_was_trained(t5: Path, task: str) -> None:
    policy = make_policy(t5, tasks=[task])
    batch = observe([task])
    plan = policy.predict_action_chunk(batch)
    assert (plan == batch["observation.state"][:, None]).all()
    assert policy.responses == ["What should I do?"]


def test_a_new_task_gets_a_new_plan_and_the_other_environment_goes_on(t5: Path) -> None:
    policy = make_policy(t5, tasks=["push red", "pull ball", "push mug"])
    torch.nn.init.constant_(policy.model.core.decoder.stop.bias, -100.0)
    before, after = observe(["push red", "pull ball"]), observe(["push red", "push mug"])
    going_on, new = policy.predict_action_chunk(before)[0], policy.predict_action_chunk(after)[1]
    assert not torch.equal(new, policy.predict_action_chunk(before)[1])
    for _ in range(3):
        policy.select_action(before)
    assert policy.responses == ["I will push the red cube.", "I will pull the ball."]
    for step in range(3):
        action = policy.select_action(after)
        torch.testing.assert_close(action, torch.stack([going_on[3 + step], new[step]]))
    assert policy.responses == ["I will push the red cube.", "I will push the mug."]
    # Other environments than before.
    alone = observe(["push red"])
    first = policy.predict_action_chunk(alone)[:, 0]
    assert torch.equal(policy.select_action(alone), first)
    policy.select_action(alone)
    policy.drop_queued_actions()
    assert policy.responses == []
    assert torch.equal(policy.select_action(alone), first)


def test_a_plan_begins_where_those_of_the_training_data_do(t5: Path) -> None:
    policy = make_policy(t5, tasks=["push red"])
    batch = observe(["push red", "push red", "Don't push the ball!"])
    policy.rest_pose = batch["observation.state"][0].clone()
    policy.rest_tolerance = torch.linspace(0.1, 1.0, 10)
    batch["observation.state"] = policy.rest_pose + 0.99 * policy.rest_tolerance * torch.ones(3, 1)
    batch["observation.state"][1, 4] += 0.1
    plan = policy.predict_action_chunk(batch)
    assert policy.responses == ["I will push the red cube.", GOING_HOME, "I hold still."]
    way = plan[1] - policy.rest_pose
    assert (way.diff(dim=0).abs() <= FASTEST + 1e-6).all()
    assert (way.diff(dim=0).abs().sum(dim=1)[:2] > 0).all()
    assert way[-1].abs().max() < way[0].abs().max()
    assert not torch.equal(plan[0, 0], batch["observation.state"][0].clamp(-1, 1))


def test_first_poses_that_vary_are_all_near() -> None:
    poses = np.array([[0.0, -0.3], [0.0, 0.3]])
    # The first joint hardly moves: what is 0.2 for the second one is 20 for the first.
    assert start_tolerance(poses, np.array([1.0, 100.0])) == pytest.approx([0.8, 0.34])


def test_a_checkpoint_from_before_holds_still_in_doubt(t5: Path) -> None:
    policy = make_policy(t5)
    weights = {key: value for key, value in policy.state_dict().items() if key != "rest_tolerance"}
    policy.load_state_dict(weights)
    assert torch.equal(policy.rest_tolerance, torch.full((10,), NEAR))


@pytest.mark.parametrize(
    ("verb", "prompt"),
    [
        ("push", "push blue"),
        ("pull", "pull blue"),
        ("slide-to-left", "Slide the mug to the left."),
        ("slide-to-right", "slide to right blue"),
    ],
)
@given(target=st.builds(Target, st.text("abc left", max_size=9), st.sampled_from(["", "red"])))
def test_no_word_of_a_name_turns_a_movement(verb: str, prompt: str, target: Target) -> None:
    """The detector looks for the name, the robot speaks of it, and the prompt has another one."""
    reader = TaskReader(
        ("push blue", "pull red", "pull blue", "Slide the mug to the left."), names_objects=True
    )
    instruction = reader.read_answer(Request((Action(verb, target),)), sure=True, before=Target("ball"))
    assert instruction.prompt == f"execute: {prompt}" or target == Target()
    assert instruction.target == target or target == Target()


def test_a_text_that_is_too_long_reaches_no_model(t5: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = make_policy(t5, tasks=["push red"])
    asked = record_prompts(policy, monkeypatch)
    batch = observe(["push " + 20_000 * "e", "push red"])
    plan = policy.predict_action_chunk(batch)
    assert policy.responses == [TOO_LONG, "I will push the red cube."]
    assert torch.equal(plan[0], batch["observation.state"][0].expand(HORIZON, -1))
    assert max(map(len, asked)) < 30
    for give in (policy.translate, lambda texts: policy.describe(observe_finished(), labels=texts)):
        with pytest.raises(ValueError, match=r"at most 500 characters, but 'eee.*has 501: shorten it"):
            give([501 * "e"])
        with pytest.raises(ValueError, match="must be given as a list of texts, and is 'mug'"):
            give("mug")


@pytest.mark.parametrize("make", [make_owlv2, make_grounding_dino])
def test_a_name_that_the_detector_cannot_read_is_not_looked_for(
    t5: Path, tmp_path: Path, make: Callable[[Path], Path]
) -> None:
    name = " ".join(20 * ["mug"])
    policy = make_policy(t5, detector=str(make(tmp_path)), score_threshold=0.0, tasks=[f"push the {name}"])
    batch = observe([f"push the {name}"])
    assert torch.equal(policy.select_action(batch), batch["observation.state"])
    assert policy.responses == [f"I cannot look for a name as long as '{name}': use fewer words."]
    with pytest.raises(ValueError, match="cannot look for a name as long as 'mug mug"):
        policy.describe(observe_finished(), labels=[name])


def test_what_cannot_be_done_is_said_and_not_guessed(t5: Path) -> None:
    policy = make_policy(t5)
    assert policy.responses == []
    batch = observe(TASKS)
    plan = policy.predict_action_chunk(batch)
    assert policy.responses[:3] == [
        "I will push the red cube.",
        "I will pull the ball.",
        "I cannot see a can. I see a cube, a ball and a mug.",
    ]
    assert policy.responses[3].startswith(("I hold still", "Should I"))
    held = (plan == batch["observation.state"][:, None]).all(dim=(1, 2))
    assert held.tolist() == [False, False, True, True]
    policy.reset()
    assert policy.responses == []


def test_a_trained_task_without_a_known_verb_is_carried_out(t5: Path) -> None:
    policy = make_policy(t5, tasks=["dance wildly"])
    batch = observe(["dance wildly"])
    assert not torch.equal(policy.predict_action_chunk(batch)[:, 0], batch["observation.state"])
    assert policy.responses == ["I will do it."]


def test_a_batch_acts_as_its_samples_do_alone(t5: Path) -> None:
    policy = make_policy(t5)
    batch = observe(TASKS)
    together = policy.predict_action_chunk(batch)
    for sample in range(len(TASKS)):
        alone = policy.predict_action_chunk({key: value[sample : sample + 1] for key, value in batch.items()})
        assert torch.allclose(together[sample], alone[0], atol=1e-6)


def test_a_joint_outside_the_trained_range_is_no_trouble(t5: Path) -> None:
    batch = observe(TASKS)
    batch["observation.state"] *= 1e6
    plan = make_policy(t5).predict_action_chunk(batch)
    assert plan.abs().max() <= 1


@pytest.fixture(scope="module")
def policy(t5: Path) -> OWLxT5Policy:
    return make_policy(t5)


@pytest.mark.slow
@given(data=st.data())
@settings(max_examples=25)
def test_an_action_is_within_what_its_joint_was_trained_on(
    policy: OWLxT5Policy, dataset: LeRobotDataset, data: st.DataObject
) -> None:
    """And so within the joint's limits, wherever the robot and the objects are."""
    any_number = st.floats(-1e9, 1e9, width=32)
    state, boxes = (data.draw(st.lists(any_number, min_size=n, max_size=n)) for n in (10, 12))
    preprocess, postprocess = make_pre_post_processors(policy.config, dataset_stats=dataset.meta.stats)
    batch = observe(["push red"])
    batch["observation.state"] = torch.tensor([state])
    batch["observation.objects"].unflatten(1, (3, 28))[..., :4] = torch.tensor(boxes).view(3, 4)
    plan = postprocess(policy.predict_action_chunk(preprocess(batch)))
    trained = share_joint_range(dataset.meta.stats)["action"]
    assert plan.isfinite().all()
    assert (plan.numpy() >= trained["min"] - 1e-3).all()
    assert (plan.numpy() <= trained["max"] + 1e-3).all()


def test_a_robot_with_other_joints_does_not_act(t5: Path) -> None:
    policy = make_policy(t5)
    batch = observe(TASKS)
    batch["observation.state"] = batch["observation.state"][:, :7]
    with pytest.raises(ValueError, match="has 7 numbers, and the policy was trained on 10 joints"):
        policy.select_action(batch)


@pytest.mark.parametrize("task", [None, [None], ["push red", "pull red"], "push red"])
def test_a_robot_without_a_task_is_told_what_is_missing(t5: Path, task: object) -> None:
    batch = observe(["push red"]) | {"task": task}
    with pytest.raises(ValueError, match=r"'task' must be a list with one command for each of the 1 samples"):
        make_policy(t5).select_action(batch)
    del batch["task"]
    with pytest.raises(ValueError, match="and is None"):
        make_policy(t5).select_action(batch)
    del batch["observation.state"]
    with pytest.raises(ValueError, match=r"lacks 'observation\.state'"):
        make_policy(t5).select_action(batch)


@pytest.mark.parametrize("number", [float("nan"), float("inf")])
def test_a_robot_without_a_pose_does_not_act(t5: Path, number: float) -> None:
    policy = make_policy(t5)
    batch = observe(TASKS)
    batch["observation.state"][2, 7] = number
    with pytest.raises(ValueError, match="environment 2 is not finite at joint 7"):
        policy.select_action(batch)


def test_a_diverged_checkpoint_does_not_act(t5: Path) -> None:
    policy = make_policy(t5)
    with torch.no_grad():
        policy.model.core.fc.weight.fill_(float("nan"))
        policy.model.core.decoder.initial.weight.fill_(float("nan"))
    with pytest.raises(FloatingPointError, match="load an earlier one"):
        policy.select_action(observe(TASKS))


def test_the_plan_depends_on_where_the_object_is(t5: Path) -> None:
    policy = make_policy(t5, tasks=["push red"])
    left, right = (
        policy.predict_action_chunk(observe(["push red"], [names]))
        for names in (["red", "a", "b"], ["a", "b", "red"])
    )
    assert not torch.allclose(left, right)


@pytest.mark.parametrize(
    ("options", "point"),
    [
        ({}, (-0.4, 0.1)),
        ({"object_point": "foot"}, (-0.4, 0.6)),
        ({"object_point": "foot", "nadir": 1.05}, (-0.2, 0.6)),
    ],
)
def test_the_point_of_an_object_is_the_middle_of_its_box_or_its_foot(
    t5: Path, options: dict[str, object], point: tuple[float, float]
) -> None:
    batch = observe(["push red"])
    batch["observation.objects"][0, :4] = torch.tensor([0.2, 0.3, 0.4, 0.8])
    assert torch.allclose(
        make_policy(t5, **options).visual.encode(batch, ["red"]).features, torch.tensor([[point]])
    )


def test_the_robot_aims_nearer_than_it_sees_the_foot(t5: Path) -> None:
    batch, thing = observe(["push red", "push red"]), Thing("red cube", torch.tensor([0.2, 0.3, 0.4, 0.8]))
    visual = make_policy(t5, object_point="foot", aim_nearer=0.05).visual
    assert isinstance(visual, ObjectPoint)
    features = visual.features(batch, [thing, None])
    assert torch.allclose(features, torch.tensor([[[-0.4, 0.7]], [[0.0, 0.0]]]))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"aim_nearer": 0.1}, "--policy.aim_nearer=0.1 belongs to --policy.object_point=foot"),
        ({"object_point": "foot", "aim_nearer": -0.1}, "from 0 to 1"),
        ({"object_point": "top"}, "--policy.object_point is centre or foot, not 'top'"),
        ({"nadir": 1.1}, "--policy.nadir=1.1 belongs to --policy.object_point=foot"),
        ({"object_point": "foot", "nadir": 0.9}, "at more than 1"),
    ],
)
def test_points_that_there_are_not(t5: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_policy(t5, **options)


def test_owlv2_that_sees_nothing_keeps_the_robot_still(t5: Path, tmp_path: Path) -> None:
    policy = make_policy(t5, detector=str(make_owlv2(tmp_path)), score_threshold=1.0, tasks=["push ball"])
    batch = observe(["push ball"])
    assert torch.equal(policy.select_action(batch), batch["observation.state"])
    assert policy.responses == ["I cannot see a ball. I see nothing that I know."]


def test_describe_asks_for_the_object_that_moved(
    t5: Path, dataset: LeRobotDataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    policy = make_policy(t5, tasks=["push red", "push green", "push blue", "push cyan"])
    asked = record_prompts(policy, monkeypatch)
    batch = load_batch(dataset.root, [0, 10, 26], lambda batch: batch, finished=ENDS)
    assert batch[EYES].ndim == 5
    texts = policy.describe(batch)
    assert asked == [f"describe: {task.split()[-1]}" for task in batch["task"]]
    assert len(texts) == 3
    batch["observation.objects"][:, 1] = batch["observation.objects"][:, 0]
    assert policy.describe(batch) == ["nothing moved"] * 3
    assert policy.describe(batch, labels=["mug"]) == ["I know none of the objects that I see."] * 3


class Proposals(Detector):
    """Looks twice, at an episode's first and last image, and proposes what it is given."""

    threshold = 0.3

    def __init__(self, *candidates: Candidates) -> None:
        self._next = iter(candidates)

    def can_read(self, names: object) -> bool:
        return True

    def propose(self, observation: object, names: object) -> Candidates:
        return next(self._next)


@pytest.mark.parametrize(
    ("places", "before", "after", "expected"),
    [
        pytest.param((0.5, 0.505), (0.4, 0.8), (0.0, 0.1), "blue", id="better label for one object"),
        pytest.param((0.5, 0.505), (0.8, 0.4), (0.1, 0.0), "cyan", id="the other one better"),
        pytest.param((0.2, 0.5), (0.9, 0.4), (0.8, 0.1), "blue", id="the other at rest"),
        pytest.param((0.2, 0.5), (0.9, 0.4), (0.4, 0.1), "blue", id="the other partly hidden"),
        pytest.param((0.2, 0.5), (0.9, 0.16), (0.9, 0.0), "blue", id="a weak score will do"),
        pytest.param((0.2, 0.5), (0.9, 0.14), (0.9, 0.0), "nothing moved", id="too weak a score"),
        pytest.param((0.2, 0.5), (0.9, 0.4), (0.6, 0.3), "nothing moved", id="both still there"),
        pytest.param(
            (0.2, 0.5), (0.14, 0.14), (0.0, 0.0), "I know none of the objects that I see.", id="both too weak"
        ),
    ],
)
def test_describe_takes_what_is_gone_from_its_place(
    t5: Path,
    monkeypatch: pytest.MonkeyPatch,
    places: tuple[float, float],
    before: tuple[float, float],
    after: tuple[float, float],
    expected: str,
) -> None:
    box = torch.tensor([[[x, 0.5, x, 0.5] for x in places]])
    first, there, elsewhere = (torch.diag(torch.tensor(each))[None] for each in (before, after, (0.2, 0.2)))
    last = Candidates(torch.cat([box, box + 0.3], dim=1), torch.cat([there, elsewhere], dim=1))
    policy = make_policy(t5)
    monkeypatch.setattr(policy.visual, "detector", Proposals(Candidates(box, first), last))
    asked = record_prompts(policy, monkeypatch)
    batch = observe_finished()
    texts = policy.describe(batch, labels=["cyan", "blue"])
    if expected in ("cyan", "blue"):
        assert asked == [f"describe: {expected}"]
        assert not {*texts} & {NOTHING_MOVED, NOTHING_KNOWN}
    else:
        assert texts == [expected]


@pytest.mark.parametrize(
    ("box", "score", "moved"),
    [
        pytest.param((0.5, 0.4, 0.6, 0.5), 0.2, True, id="beside its place"),
        pytest.param((0.5, 0.4, 0.6, 0.5), 0.1, True, id="beside its place, behind a hand"),
        pytest.param((0.46, 0.4, 0.56, 0.5), 0.2, True, id="a bit aside"),
        pytest.param((0.44, 0.4, 0.54, 0.5), 0.1, False, id="a bit aside, behind a hand"),
        pytest.param((0.5, 0.4, 0.6, 0.5), 0.04, False, id="not seen"),
        pytest.param((0.4, 0.4, 0.43, 0.5), 0.9, False, id="the arm leaves a part of it to see"),
    ],
)
def test_a_hidden_place_is_not_an_empty_one(
    t5: Path, monkeypatch: pytest.MonkeyPatch, box: tuple[float, ...], score: float, moved: bool
) -> None:
    """The only object is seen well in the first image, not at its place in the last, and so elsewhere."""
    first = Candidates(torch.tensor([[[0.4, 0.4, 0.5, 0.5]]]), torch.tensor([[[0.9]]]))
    last = Candidates(torch.tensor([[box]]), torch.tensor([[[score]]]))
    policy = make_policy(t5)
    monkeypatch.setattr(policy.visual, "detector", Proposals(first, last))
    assert (policy.describe(observe_finished(), labels=["red"]) != ["nothing moved"]) == moved


def test_describe_needs_to_know_what_to_look_for(t5: Path) -> None:
    policy = make_policy(t5)
    batch = observe_finished()
    with pytest.raises(ValueError, match="labels"):
        policy.describe(batch)


def test_repeat_action_and_translate(t5: Path, dataset: LeRobotDataset) -> None:
    policy = make_policy(t5)
    batch = load_batch(dataset.root, [0, 10], lambda batch: batch, finished=ENDS)
    assert policy.repeat_action(batch).shape == (2, HORIZON, 10)
    texts = policy.translate(["The Commission met.", "Good morning"], batch)
    assert len(texts) == 2
    assert all(isinstance(text, str) for text in texts)


def test_a_mode_that_was_never_trained_is_refused_by_name(t5: Path, dataset: LeRobotDataset) -> None:
    policy = make_policy(t5, trained_modes=["execute"])
    policy.select_action(observe(["push red"]))
    batch = load_batch(dataset.root, [0], lambda batch: batch, finished=ENDS)
    for mode, ask in (
        ("translate", lambda: policy.translate(["The mug is here."])),
        ("describe", lambda: policy.describe(batch)),
        ("repeat_action", lambda: policy.repeat_action(batch)),
    ):
        with pytest.raises(ValueError, match=rf"never trained in the mode '{mode}', only in \['execute'\]"):
            ask()
    policy.config.trained_modes = ["describe"]
    policy.reset()
    with pytest.raises(ValueError, match="never trained in the mode 'execute'"):
        policy.select_action(observe(["push red"]))
