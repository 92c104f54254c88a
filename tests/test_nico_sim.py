# SPDX-License-Identifier: Apache-2.0
"""The simulated robot through LeRobot's interface of robots, and through LeRobot's own commands."""

import json
import logging
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco.viewer
import numpy as np
import pytest
import torch
from lerobot.datasets import LeRobotDataset
from lerobot.robots import make_robot_from_config
from lerobot.scripts import lerobot_replay
from lerobot.utils.errors import DeviceAlreadyConnectedError, DeviceNotConnectedError
from lerobot.utils.feature_utils import hw_to_dataset_features

from clant_claeo.expert import plan
from clant_claeo.takes import OBJECTS, _features
from commands import run
from nico_tabletop.config_nico_sim import NicoSimConfig
from nico_tabletop.drawing import DrawingError
from nico_tabletop.env import TabletopEnv
from nico_tabletop.head import pose_towards
from nico_tabletop.nico_mjcf import HEAD_PITCH_DEG
from nico_tabletop.nico_sim import IDLE_OBSERVATIONS, NicoSim
from nico_tabletop.placement import SLOT_POSES
from nico_tabletop.robot import EYES, INITIAL_POSE_DEG, JOINT_NAMES, NICO_XML, joint_limits_deg
from nico_tabletop.scene import SPECTATOR
from nico_tabletop.simulation import JointTargetError
from nico_tabletop.tasks import ACTIONS, SLOTS, Action
from nico_tabletop.variation import Conditions

HEIGHT, WIDTH = 48, 64


def make_robot(folder: Path, **options: Any) -> NicoSim:
    config = NicoSimConfig(height=HEIGHT, width=WIDTH, calibration_dir=folder, **options)
    robot = make_robot_from_config(config)
    assert isinstance(robot, NicoSim)
    return robot


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[NicoSim]:
    with make_robot(tmp_path, arrangement="red, green,blue") as robot:
        yield robot


def targets(pose: np.ndarray = INITIAL_POSE_DEG) -> dict[str, float]:
    return {f"{name}.pos": float(angle) for name, angle in zip(JOINT_NAMES, pose, strict=True)}


def test_what_is_recorded_has_the_features_of_our_datasets(robot: NicoSim) -> None:
    recorded = hw_to_dataset_features(robot.observation_features, "observation")
    recorded |= hw_to_dataset_features(robot.action_features, "action")
    ours = _features(HEIGHT, WIDTH, video=True)
    del ours[OBJECTS]
    assert recorded.keys() == ours.keys()
    for key, feature in ours.items():
        assert recorded[key] | feature == recorded[key]  # which may say more, such as that it has no depth


def test_an_observation_is_what_the_features_say(robot: NicoSim) -> None:
    observation = robot.get_observation()
    assert list(observation) == list(robot.observation_features)
    image = observation.pop("eyes")
    assert (image.shape, image.dtype) == ((HEIGHT, WIDTH, 3), np.uint8)
    assert image.std() > 20
    home = INITIAL_POSE_DEG.clip(*joint_limits_deg().T)  # it lies 0.02 degrees beyond the elbows' limits
    assert list(observation.values()) == pytest.approx(home.tolist(), abs=1e-6)
    assert {type(angle) for angle in observation.values()} == {float}


def test_only_actions_move_the_world_on(robot: NicoSim) -> None:
    world = robot.simulation.data
    robot.get_observation()
    robot.get_observation()
    assert world.time == 0
    robot.send_action(targets())
    assert world.time == pytest.approx(0.1)


def test_an_action_is_cut_at_the_joints_limits_and_returned(robot: NicoSim) -> None:
    goal = INITIAL_POSE_DEG + np.linspace(-500, 500, len(JOINT_NAMES))
    sent = robot.send_action({name: torch.tensor(angle) for name, angle in targets(goal).items()})
    low, high = joint_limits_deg().T
    assert list(sent) == list(robot.action_features)
    assert list(sent.values()) == pytest.approx(goal.clip(low, high).tolist(), abs=1e-4)
    assert set(low) & set(sent.values())
    assert set(high) & set(sent.values())


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_an_action_that_is_not_finite_moves_nothing(robot: NicoSim, bad: float) -> None:
    with pytest.raises(JointTargetError, match="l_elbow_y"):
        robot.send_action(targets() | {"l_elbow_y.pos": bad})
    assert robot.simulation.data.time == 0


def test_an_action_for_other_joints_is_refused(robot: NicoSim) -> None:
    action = targets()
    action["l_finger.pos"] = action.pop("l_wrist_z.pos")
    with pytest.raises(ValueError, match=r"missing or unknown: l_finger\.pos, l_wrist_z\.pos$"):
        robot.send_action(action)


def express(robot: NicoSim) -> np.ndarray:
    """How the head moves in 1.2 s: poses (12, 2), degrees to the left and down."""
    poses = []
    for _ in range(12):
        robot.express()
        poses.append(robot.simulation.head_deg)
    return np.array(poses)


@pytest.mark.parametrize("back_cm", [0, 5])
def test_a_turned_head_is_seen_from_outside_alone(robot: NicoSim, back_cm: float) -> None:
    # A camera 5 cm farther back would see the head, if it were turned for it.
    robot.simulation.reset(("red", "green", "blue"), conditions=Conditions(camera_cm=(0, 0, back_cm)))

    def images(camera: str) -> np.ndarray:
        return robot.simulation.render(camera, 240, 320)

    eyes, outside = images(EYES), images(SPECTATOR)
    state = robot.simulation.data.qpos.copy()
    robot.look_at(0.1, 0.9)
    robot.nod()
    express(robot)
    assert (images(EYES) == eyes).all()
    assert (robot.simulation.data.qpos == state).all() and robot.simulation.data.time == 0
    assert 100 < (images(SPECTATOR) != outside).any(axis=2).sum() < 10_000  # the head, not the whole image
    robot.look_at(0.5, 0.5)
    express(robot)
    assert (images(SPECTATOR) == outside).all()


@pytest.mark.parametrize(("expression", "axis"), [("shake", 0), ("nod", 1)])
def test_the_head_goes_both_ways_and_ends_in_the_middle(robot: NicoSim, expression: str, axis: int) -> None:
    getattr(robot, expression)()
    poses = express(robot)
    assert poses[:, axis].max() > 10 and poses[:, axis].min() < -10
    assert not poses[:, 1 - axis].any() and not poses[9:].any()
    assert np.abs(np.diff(poses, axis=0)).max() < 15  # 150 degrees a second


@pytest.mark.parametrize(
    ("place", "signs"),
    [((0.1, 0.5), (1, 0)), ((0.9, 0.5), (-1, 0)), ((0.5, 0.1), (0, -1)), ((0.5, 0.9), (0, 1))],
)
def test_the_head_turns_to_a_place_in_the_image(
    robot: NicoSim, place: tuple[float, float], signs: tuple[int, int]
) -> None:
    robot.look_at(*place)
    poses = express(robot)
    towards = np.array(signs) != 0
    assert (np.sign(poses[:, towards]) == np.array(signs)[towards]).all()
    assert (np.abs(poses[-1, towards]) > 10).all() and (poses[9:] == poses[-1]).all()
    robot.look_at(0.5, 0.5)
    assert express(robot)[-1] == pytest.approx([0, 0], abs=1e-9)


def test_the_head_points_at_what_the_camera_sees_there(robot: NicoSim) -> None:
    # The ray from the camera through a place of its image, in the world.
    camera = robot.simulation.model.camera(EYES)
    ray = robot.simulation.data.camera(EYES).xmat.reshape(3, 3) @ [
        (2 * 0.2 - 1) * np.tan(np.deg2rad(camera.fovy[0]) / 2) * WIDTH / HEIGHT,
        (1 - 2 * 0.3) * np.tan(np.deg2rad(camera.fovy[0]) / 2),
        -1,
    ]
    yaw, pitch = pose_towards(0.2, 0.3, WIDTH / HEIGHT, camera.fovy[0])
    assert yaw == pytest.approx(np.rad2deg(np.arctan2(ray[1], ray[0])))
    down = np.rad2deg(np.arcsin(-ray[2] / np.linalg.norm(ray)))
    assert pitch == pytest.approx(down - HEAD_PITCH_DEG)


def test_the_head_stays_within_its_joints_limits(robot: NicoSim) -> None:
    joints = json.loads(NICO_XML.parents[1].joinpath("nico_kinematics.json").read_text("utf-8"))["joints"]
    limits = {joint["name"]: np.rad2deg([joint["lower"], joint["upper"]]) for joint in joints}
    for place in ((-9, -9), (9, 9)):
        robot.look_at(*place)
        robot.nod()
        for yaw, pitch in express(robot):
            assert limits["head_z"][0] <= yaw <= limits["head_z"][1]
            assert limits["head_y"][0] <= pitch + HEAD_PITCH_DEG <= limits["head_y"][1]


def test_a_head_that_shall_not_express_anything_stays_still(tmp_path: Path) -> None:
    with make_robot(tmp_path, expressive_head=False) as robot:
        robot.look_at(0.1, 0.1)
        robot.shake()
        assert not express(robot).any()


def test_a_table_laid_anew_finds_the_head_in_the_middle(robot: NicoSim) -> None:
    robot.look_at(0.1, 0.1)
    assert express(robot)[-1].all()
    robot.reset()
    assert not robot.simulation.head_deg.any() and not express(robot).any()


def test_it_works_while_it_is_connected(tmp_path: Path) -> None:
    robot = make_robot(tmp_path)
    for _ in range(2):
        assert not robot.is_connected
        for method in (
            robot.get_observation,
            lambda: robot.send_action(targets()),
            robot.express,
            robot.disconnect,
        ):
            with pytest.raises(DeviceNotConnectedError):
                method()
        robot.connect()
        assert robot.is_connected
        assert robot.is_calibrated
        robot.calibrate()
        robot.configure()
        with pytest.raises(DeviceAlreadyConnectedError):
            robot.connect()
        robot.disconnect()


@pytest.mark.parametrize("placement", ["slots", "free"])
def test_a_seed_shows_the_environments_scenes(tmp_path: Path, placement: str) -> None:
    env = TabletopEnv("PUSH-L", objects="household", placement=placement, height=HEIGHT, width=WIDTH)
    with make_robot(tmp_path, objects="household", placement=placement, seed=5) as robot:
        _, info = env.reset(seed=5)
        for _ in range(2):
            assert robot.simulation.arrangement == info["arrangement"]
            places = robot.simulation.object_positions()[:, :2]
            assert places == pytest.approx(np.array(info["poses"])[:, :2], abs=1e-6)
            robot.reset()
            _, info = env.reset()
    env.close()


def test_a_watched_robot_lays_the_table_anew_if_it_may(tmp_path: Path) -> None:
    for may in (False, True):
        with make_robot(tmp_path, reset_when_idle=may) as robot:
            first = robot.simulation.arrangement
            for _ in range(IDLE_OBSERVATIONS + 1):
                robot.get_observation()
            assert robot.simulation.arrangement == first  # nothing was done yet
            robot.send_action(targets(INITIAL_POSE_DEG + 5))
            for _ in range(IDLE_OBSERVATIONS - 1):
                robot.get_observation()
            assert robot.simulation.data.time > 0
            robot.get_observation()
            assert (robot.simulation.data.time == 0) is may
            assert (robot.simulation.arrangement != first) is may


@pytest.mark.parametrize("action", ACTIONS, ids=lambda action: action.name)
def test_it_says_what_was_done(tmp_path: Path, caplog: pytest.LogCaptureFixture, action: Action) -> None:
    names = ("red", "green", "blue")
    caplog.set_level(logging.INFO)
    with make_robot(tmp_path, arrangement=",".join(names)) as robot:
        for row in plan(action, SLOT_POSES):
            robot.send_action(targets(row))
    assert caplog.messages[0].endswith("red, green, blue")
    assert caplog.messages[-1] == f"What was done: {action.verb.name} {names[action.slot]}: perfect"


def test_it_says_when_it_was_none_of_the_actions(robot: NicoSim, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.INFO)
    robot.send_action(targets())
    robot.reset(["blue", "cyan", "red"])
    robot.simulation.data.joint("blue").qpos[0] += 0.1
    robot.simulation.data.joint("red").qpos[1] += 0.02
    robot.send_action(targets())
    robot.reset()
    said = [message for message in caplog.messages if message.startswith("What")]
    assert said[0] == "What was done: no object moved"
    assert said[1] == "What was done: none of the twelve actions; blue moved 10.0 cm, red moved 2.0 cm"
    assert robot.simulation.arrangement == ("red", "green", "blue")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"objects": "toys"}, "toys"),
        ({"placement": "somewhere"}, "slots, free"),
        ({"seed": -1}, "--robot.seed=-1"),
        ({"height": 2}, "height"),
    ],
)
def test_an_option_that_cannot_be_used_is_refused_at_once(options: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        NicoSimConfig(**options)


def test_an_arrangement_of_unknown_objects_is_refused(tmp_path: Path) -> None:
    robot = make_robot(tmp_path, arrangement="red,mug,blue")
    with pytest.raises(ValueError, match="three different objects out of blue, cyan"):
        robot.connect()
    assert not robot.is_connected


def test_without_a_screen_the_viewer_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(mujoco.viewer.glfw, "init", lambda: False)
    robot = make_robot(tmp_path, viewer=True)
    with pytest.raises(DrawingError, match="needs a screen"):
        robot.connect()
    assert not robot.is_connected


class FakeHandle:
    """MuJoCo's handle of a window, which somebody closes after a while."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, **_: bool) -> None:
        self.data, self.times, self.running = data, list[float](), True

    def is_running(self) -> bool:
        return self.running

    def sync(self) -> None:
        self.times.append(self.data.time)

    def close(self) -> None:
        self.running = False


def test_the_viewer_shows_each_action(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    handles = list[FakeHandle]()

    def launch(*given: Any, **options: bool) -> FakeHandle:
        handles.append(FakeHandle(*given, **options))
        return handles[-1]

    monkeypatch.setattr(mujoco.viewer.glfw, "init", lambda: True)
    monkeypatch.setattr(mujoco.viewer, "launch_passive", launch)
    with make_robot(tmp_path, viewer=True) as robot:
        [handle] = handles
        robot.send_action(targets())
        robot.send_action(targets())
        robot.reset()
        assert handle.times == pytest.approx([0.1, 0.2, 0.0])
        handle.running = False
        robot.send_action(targets())
        assert len(handle.times) == 3
        handle.running = True
    assert not handle.running


def test_the_documented_lines_of_python_run() -> None:
    text = (Path(__file__).parents[1] / "docs" / "robot.md").read_text(encoding="utf-8")
    [code] = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    names: dict[str, Any] = {}
    exec(code, names)
    assert names["sent"]["r_elbow_y.pos"] == -80
    assert names["observation"]["eyes"].shape == (240, 320, 3)
    assert not names["robot"].is_connected


# What follows runs LeRobot's own commands.
SMALL = ("--robot.height=120", "--robot.width=160")
RECORD = ("--dataset.fps=10", "--dataset.push_to_hub=false", "--dataset.streaming_encoding=true")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of the twelve actions and a policy that has hardly learnt anything from it."""
    folder = tmp_path_factory.mktemp("nico_sim")
    run(
        "owlxt5-dataset",
        *(f"--root={folder / 'clant'}", "--arrangements=1", "--height=120", "--width=160", "--workers=1"),
    )
    run(
        "lerobot-train",
        *("--config_path=configs/small.yaml", "--policy.type=owlxt5", "--policy.detector=embedded"),
        *("--policy.dim_model=32", "--policy.dim_feedforward=32", "--policy.dim_lstm=16"),
        *(f"--dataset.root={folder / 'clant'}", f"--output_dir={folder / 'train'}", "--steps=2"),
        *("--batch_size=4", "--num_workers=0"),
    )
    return folder


def rollout(folder: Path, strategy: str, *options: str) -> str:
    checkpoint = folder / "train" / "checkpoints" / "last" / "pretrained_model"
    return run(
        "lerobot-rollout",
        *(f"--strategy.type={strategy}", f"--policy.path={checkpoint}", "--policy.device=cpu"),
        *("--robot.type=nico_sim", *SMALL, "--fps=10", "--task=push red", "--play_sounds=false"),
        *("--return_to_initial_position=false", *options),
        HF_LEROBOT_HOME=str(folder / "home"),
    )


def scene(dataset: LeRobotDataset, episode: int) -> str:
    """The arrangement of an episode, as the robot's option takes it."""
    at = dataset.meta.episodes[episode]["dataset_from_index"]
    rows = dataset.hf_dataset.with_format(None)[at]["language_persistent"]
    [content] = [row["content"] for row in rows if row["style"] == "scene"]
    objects = json.loads(content)["objects"]
    return ",".join(objects[slot] for slot in SLOTS)


@pytest.mark.slow
def test_replaying_each_action_of_a_dataset_is_perfect(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(lerobot_replay, "init_logging", lambda: None)  # it would remove the test's handler
    monkeypatch.setattr(lerobot_replay, "precise_sleep", lambda _: None)
    caplog.set_level(logging.INFO)
    dataset = LeRobotDataset("local/clant", root=folder / "clant", video_backend="pyav")
    tasks = list[str]()
    for episode in range(len(ACTIONS)):
        robot = NicoSimConfig(
            arrangement=scene(dataset, episode), height=48, width=64, calibration_dir=tmp_path
        )
        source = lerobot_replay.DatasetReplayConfig("local/clant", episode, root=folder / "clant")
        caplog.clear()
        lerobot_replay.replay(lerobot_replay.ReplayConfig(robot, source, play_sounds=False))
        [task] = dataset.meta.episodes[episode]["tasks"]
        assert caplog.messages[-1] == f"What was done: {task}: perfect"
        tasks.append(task)
    assert len(set(tasks)) == len(ACTIONS)


@pytest.mark.slow
def test_the_command_lerobot_replay(folder: Path) -> None:
    dataset = LeRobotDataset("local/clant", root=folder / "clant", video_backend="pyav")
    output = run(
        "lerobot-replay",
        *("--robot.type=nico_sim", f"--robot.arrangement={scene(dataset, 3)}", "--play_sounds=false"),
        *("--dataset.repo_id=local/clant", f"--dataset.root={folder / 'clant'}", "--dataset.episode=3"),
        HF_LEROBOT_HOME=str(folder / "home"),
    )
    [task] = dataset.meta.episodes[3]["tasks"]
    assert f"What was done: {task}: perfect" in output


@pytest.mark.slow
def test_a_rollout_without_recording(folder: Path) -> None:
    output = rollout(folder, "base", "--duration=1", "--robot.objects=claeo", "--robot.placement=free")
    assert "Rollout finished" in output
    assert "What was done: " in output


@pytest.mark.slow
@pytest.mark.parametrize(
    ("strategy", "options", "episodes"),
    [
        (
            "episodic",
            (
                # LeRobot keeps no statistics of an episode of one image: a busy machine needs the time.
                *("--dataset.num_episodes=2", "--dataset.episode_time_s=5", "--dataset.reset_time_s=1"),
                *("--robot.reset_when_idle=true", "--strategy.reset_to_initial_position=false"),
            ),
            2,
        ),
        ("sentry", ("--duration=2",), 1),
    ],
)
def test_a_recorded_rollout_is_a_dataset_like_ours(
    folder: Path, strategy: str, options: tuple[str, ...], episodes: int
) -> None:
    root = folder / strategy
    place = (f"--dataset.repo_id=local/rollout_{strategy}", f"--dataset.root={root}")
    output = rollout(folder, strategy, *place, *RECORD, *options)
    assert output.count("On the table") == episodes
    recorded = LeRobotDataset(f"local/rollout_{strategy}", root=root, video_backend="pyav")
    ours = LeRobotDataset("local/clant", root=folder / "clant", video_backend="pyav")
    assert recorded.num_episodes == episodes
    assert (recorded.fps, recorded.meta.robot_type) == (ours.fps, "nico_sim")
    shared = recorded.features.keys() & ours.features.keys()
    assert {"observation.images.eyes", "observation.state", "action", "task_index"} <= shared
    assert recorded.features.keys() == shared
    for key in shared:
        for entry in ("dtype", "shape", "names"):
            assert recorded.features[key][entry] == ours.features[key][entry], (key, entry)
    frame = recorded[0]
    assert frame["task"] == "push red"
    assert frame["observation.state"].numpy() == pytest.approx(INITIAL_POSE_DEG, abs=0.1)
    assert frame["observation.images.eyes"].shape == (3, 120, 160)
    assert frame["observation.images.eyes"].std() > 0.1

    replayed = run(
        "lerobot-replay",
        *("--robot.type=nico_sim", "--play_sounds=false", f"--dataset.root={root}"),
        *(f"--dataset.repo_id=local/rollout_{strategy}", "--dataset.episode=0"),
        HF_LEROBOT_HOME=str(folder / "home"),
    )
    assert "What was done: " in replayed
