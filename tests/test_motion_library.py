# SPDX-License-Identifier: Apache-2.0
"""Tests of the rival motion_library: where it takes things to be, how it moves, and what it refuses."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import torch
from lerobot.configs import PreTrainedConfig
from lerobot.policies.factory import make_policy, make_pre_post_processors
from numpy.typing import NDArray

from lerobot_owlxt5.backbones.detections import Detections
from lerobot_owlxt5.commands.verbs import VERBS
from lerobot_owlxt5.configuration_motion_library import MotionLibraryConfig
from lerobot_owlxt5.modeling_motion_library import NO_SUCH_MOTION, MotionLibraryPolicy, out_of_reach
from lerobot_owlxt5.motion_library import ALIKE_DEG, EDGE, MotionLibrary
from lerobot_owlxt5.table_view import TableView
from nico_tabletop.configuration import ClantEnvConfig
from nico_tabletop.env import describe_objects
from nico_tabletop.objects import CUBE_HALF_WIDTH, read_objects
from nico_tabletop.placement import SLOT_POSES, Pose, draw_poses
from nico_tabletop.replay import replay
from nico_tabletop.robot import EYES, INITIAL_POSE_DEG, JOINT_NAMES
from nico_tabletop.scene import TABLE_HEIGHT, build_model
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import ACTIONS, Action

CUBES = ("red", "green", "blue")
ASPECT = 4 / 3


def make(**options: Any) -> tuple[MotionLibraryPolicy, Any, Any]:
    """The policy as `lerobot-eval --policy.type=motion_library` makes it, with the simulator's boxes."""
    config = MotionLibraryConfig(device="cpu", detector="ground_truth", understanding="none", **options)
    policy = make_policy(config, env_cfg=ClantEnvConfig())
    assert isinstance(policy, MotionLibraryPolicy)
    return policy, *make_pre_post_processors(config)


def observe(boxes: NDArray[np.float64], *tasks: str) -> dict[str, Any]:
    """What lerobot-eval hands over: NICO in its first pose, and the three cubes' boxes."""
    return {
        "observation.state": torch.from_numpy(INITIAL_POSE_DEG).float().expand(len(tasks), -1),
        "observation.objects": torch.from_numpy(describe_objects(boxes, CUBES)).expand(len(tasks), -1),
        "task": list(tasks),
    }


@pytest.fixture(scope="module")
def simulation() -> TabletopSimulation:
    return TabletopSimulation(read_objects("clant"))


@pytest.fixture
def boxes(simulation: TabletopSimulation) -> NDArray[np.float64]:
    simulation.reset(CUBES, SLOT_POSES)
    return simulation.object_boxes(ASPECT)


def test_the_cameras_numbers_are_those_of_the_world() -> None:
    model = build_model(())
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    camera, config = data.camera(EYES), MotionLibraryConfig()
    tilt = np.deg2rad(config.camera_tilt_deg)
    turned = [[0, np.sin(tilt), -np.cos(tilt)], [-1, 0, 0], [0, np.cos(tilt), np.sin(tilt)]]
    np.testing.assert_allclose(camera.xmat.reshape(3, 3), turned, atol=1e-4)
    np.testing.assert_allclose(camera.xpos - [0, 0, TABLE_HEIGHT], config.camera_place, atol=1e-4)
    assert model.camera(EYES).fovy[0] == config.camera_fovy_deg
    # Over all turns, a square reaches 4 / pi times half its width from its middle.
    assert config.object_depth == pytest.approx(CUBE_HALF_WIDTH * 4 / np.pi, abs=1e-4)


def test_cubes_are_taken_to_be_where_they_stand(simulation: TabletopSimulation) -> None:
    config = MotionLibraryConfig()
    view = TableView(config.camera_place, config.camera_tilt_deg, config.camera_fovy_deg, ASPECT)
    for number in range(20):
        poses = draw_poses(np.random.default_rng(number))
        simulation.reset(CUBES, poses)
        box = torch.from_numpy(simulation.object_boxes(ASPECT))[None]
        foot = 2 * Detections(box, torch.ones(1, 3)).foot(config.nadir) - 1
        [places] = view.table_places(foot, config.object_depth)
        # A cube that stands square is not as deep as one that stands across: up to 8 mm.
        np.testing.assert_allclose(places, [pose[:2] for pose in poses], atol=0.009)


def test_what_is_over_the_horizon_is_far_away() -> None:
    view = TableView((0.0, 0.0, 1.0), tilt_deg=10.0, fovy_deg=60.0, aspect=1.0)
    places = view.table_places(torch.tensor([[0.0, -0.9], [0.0, 0.9]]), 0.03)
    assert places[0, 0] > 1000 and 0 < places[1, 0] < 2
    library = MotionLibrary()
    assert not library.reaches(places[0])


@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_every_action_is_perfect_on_the_slots(
    simulation: TabletopSimulation, boxes: NDArray[np.float64], action: Action
) -> None:
    policy, preprocess, postprocess = make()
    batch = preprocess(observe(boxes, f"{action.verb.name} {CUBES[action.slot]}"))
    plan = postprocess(policy.predict_action_chunk(batch))[0]
    assert replay(simulation, action, plan.double().numpy()) == Outcome.PERFECT


def palms(rows: NDArray[np.float64], arm: str) -> NDArray[np.float64]:
    """Where the palm is at each step, (steps, 3), metres."""
    model = build_model(())
    data = mujoco.MjData(model)
    joints = [model.joint(name).qposadr[0] for name in JOINT_NAMES]
    places = []
    for row in rows:
        data.qpos[joints] = np.deg2rad(row)
        mujoco.mj_kinematics(model, data)
        places.append(data.body(f"{arm}_palm_11").xpos.copy())
    return np.array(places)


@pytest.mark.parametrize("verb", [action.verb for action in ACTIONS[:4]], ids=lambda verb: verb.name)
def test_between_places_of_the_grid_it_moves_like_the_expert(verb: Any) -> None:
    expert = pytest.importorskip(
        "clant_claeo.expert", reason="needs the extra `scripted`", exc_type=ImportError
    )
    table = pytest.importorskip("clant_claeo.motion_table")
    pose = Pose(0.366, -0.113)
    rows = table.stretch(expert.move(verb, pose, "right", turn_seconds=table.TURN_SECONDS)[1:], 63)
    found = MotionLibrary().joint_targets(verb.name, torch.tensor(pose[:2]))
    assert found is not None
    arm, targets = found
    ours = np.tile(INITIAL_POSE_DEG, (63, 1))
    ours[:, arm] = targets.numpy()
    assert np.linalg.norm(palms(ours, "right") - palms(rows, "right"), axis=1).max() < 0.02


def test_ways_to_hold_the_arm_are_not_mixed() -> None:
    library, mixed = MotionLibrary(), 0
    for x in np.linspace(0.318, 0.43, 8):
        for y in np.linspace(0.08, 0.21, 8):
            found = library.joint_targets("pull", torch.tensor([x, y]))
            assert found is not None
            row, column = int((x - 0.315) / 0.02), int((y + 0.08) / 0.02)
            corners = library.motions[[*VERBS].index("pull"), 1, row : row + 2, column : column + 2].float()
            off = (corners.flatten(0, 1) - found[1]).abs().amax(dim=(1, 2))
            assert off.min() <= ALIKE_DEG
            mixed += int(off.max() > 2 * ALIKE_DEG)
    assert mixed  # some cells have both ways


def test_it_refuses_what_it_cannot_do(boxes: NDArray[np.float64]) -> None:
    policy, preprocess, _ = make()
    boxes[0, [1, 3]] -= 0.3  # far behind the table's middle
    batch = preprocess(observe(boxes, "push red", "push green", "push yellow", "paint the green cube"))
    plan = policy.predict_action_chunk(batch)
    moves = (plan != batch["observation.state"][:, None].clamp(-1, 1)).any(dim=(1, 2)).tolist()
    assert moves == [False, True, False, False]
    reach, push, absent, paint = policy.responses
    assert reach == out_of_reach("red cube") and paint == NO_SUCH_MOTION
    assert push == "I will push the green cube." and absent.startswith("I cannot see a yellow cube.")


def test_places_up_to_the_edge_count_and_those_beyond_do_not() -> None:
    library = MotionLibrary()
    near = float(library.x[0])
    assert library.reaches(torch.tensor([near - EDGE + 1e-3, 0.1]))
    assert not library.reaches(torch.tensor([near - EDGE - 1e-3, 0.1]))


def test_a_saved_checkpoint_moves_the_same(boxes: NDArray[np.float64], tmp_path: Path) -> None:
    policy, *processors = make()
    assert not [*policy.parameters()]
    policy.save_pretrained(tmp_path)
    for processor in processors:
        processor.save_pretrained(tmp_path)
    config = PreTrainedConfig.from_pretrained(tmp_path)
    config.pretrained_path = tmp_path
    again = make_policy(config, env_cfg=ClantEnvConfig())
    policy.model.motions.zero_()  # what is loaded is the checkpoint's
    policy = make()[0]
    actions = []
    for each, (preprocess, postprocess) in (
        (policy, processors),
        (again, make_pre_post_processors(config, str(tmp_path))),
    ):
        batch = preprocess(observe(boxes, "pull red", "slide-to-left blue"))
        actions.append(torch.stack([postprocess(each.select_action(batch)) for _ in range(90)]))
    assert torch.equal(*actions)
    assert actions[0].std(dim=0).amax() > 10


@pytest.mark.parametrize("option", [{"aim_nearer": 0.0175}, {"object_point": "centre"}])
def test_where_it_aims_has_one_option(option: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"aims by --policy\.object_depth"):
        MotionLibraryConfig(**option)


def test_it_cannot_be_trained() -> None:
    policy, *_ = make()
    for train in (policy.get_optim_params, lambda: policy({})):
        with pytest.raises(ValueError, match="nothing to learn"):
            train()
