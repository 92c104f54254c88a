# SPDX-License-Identifier: Apache-2.0
import os
import subprocess
import sys
from functools import partial

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from black_images import black_images
from nico_tabletop.configuration import ClantEnvConfig
from nico_tabletop.env import NAME_BYTES, TabletopEnv
from nico_tabletop.nico_mjcf import nico_mjcf
from nico_tabletop.objects import read_objects
from nico_tabletop.replay import replay
from nico_tabletop.robot import EYES, INITIAL_POSE_DEG, JOINT_NAMES, NICO_XML, joint_limits_deg
from nico_tabletop.scene import SCENE_XML, SPECTATOR, TABLE_HEIGHT
from nico_tabletop.simulation import JointTargetError, TabletopSimulation
from nico_tabletop.tasks import EPISODE_STEPS, find_action

CUBES = ("red", "green", "blue")


@pytest.fixture(scope="module")
def cubes() -> TabletopSimulation:
    return TabletopSimulation(read_objects("clant"))


# The fast tier replays with one set: a shape changes nothing but the looks (test_objects.py).
@pytest.mark.parametrize("objects", ["clant", pytest.param("claeo", marks=pytest.mark.slow)])
def test_replaying_the_original_trajectories_is_perfect(clant_release, objects: str):
    simulation = TabletopSimulation(read_objects(objects))
    names = tuple(simulation.objects)[:3]
    for action, sample in {sample.action: sample for sample in clant_release.samples}.items():
        simulation.reset(names)
        assert replay(simulation, find_action(action), sample.joints) == "perfect", action


def test_the_same_calls_give_the_same_numbers_bit_for_bit(cubes: TabletopSimulation):
    def rollout() -> tuple[bytes, bytes]:
        targets = np.random.default_rng(7).normal(INITIAL_POSE_DEG, 20, (15, len(JOINT_NAMES)))
        cubes.reset(CUBES)
        for target in targets:
            cubes.step(target)
        return cubes.data.qpos.tobytes(), cubes.render(EYES, 48, 64).tobytes()

    assert rollout() == rollout()


def test_servos_follow_a_target_and_stop_at_the_limits(cubes: TabletopSimulation):
    cubes.reset(CUBES)
    goal = INITIAL_POSE_DEG * 0.8 + 5
    for _ in range(10):
        cubes.step(goal)
    assert np.abs(cubes.joint_positions_deg - goal).max() < 0.5
    for _ in range(40):
        cubes.step(np.full(len(JOINT_NAMES), 1000.0))
    assert (cubes.joint_positions_deg <= joint_limits_deg()[:, 1] + 0.5).all()


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_target_that_is_not_finite_names_the_joint(cubes: TabletopSimulation, bad: float):
    cubes.reset(CUBES)
    target = INITIAL_POSE_DEG.copy()
    target[3] = bad
    with pytest.raises(JointTargetError, match="r_elbow_y"):
        cubes.step(target)


def test_the_file_of_the_robot_is_what_its_kinematics_give():
    assert NICO_XML.read_text(encoding="utf-8") == nico_mjcf()


def test_mujoco_opens_the_scene_by_itself():
    model = mujoco.MjModel.from_xml_path(str(SCENE_XML))
    assert tuple(model.actuator(index).name for index in range(model.nu)) == JOINT_NAMES
    assert {model.camera(index).name for index in range(model.ncam)} == {EYES, SPECTATOR}
    assert model.nq == len(JOINT_NAMES), "nothing but the arms moves"
    np.testing.assert_allclose(np.rad2deg(model.jnt_range), joint_limits_deg(), rtol=1e-12)
    table = model.geom("table")
    assert table.pos[2] + table.size[2] == pytest.approx(TABLE_HEIGHT, abs=1e-9)


def test_an_arrangement_of_unknown_or_repeated_objects_is_refused(cubes: TabletopSimulation):
    for arrangement in [("red", "red", "blue"), ("red", "green"), ("red", "green", "teapot")]:
        with pytest.raises(ValueError, match="three different objects"):
            cubes.reset(arrangement)


@pytest.mark.parametrize("objects", ["clant", "claeo"])
def test_projected_and_segmented_boxes_agree(objects: str):
    simulation = TabletopSimulation(read_objects(objects))
    height, width = 240, 320
    size = np.array([width, height, width, height])
    for names in (tuple(simulation.objects)[:3], tuple(simulation.objects)[3:]):
        simulation.reset(names)
        whole = simulation.object_boxes(width / height) * size
        seen = simulation.segmented_boxes(EYES, height, width) * size
        # A hand may hide a part of the outer objects at rest; nothing hides the middle one.
        assert (whole[:, :2] <= seen[:, :2] + 1).all()
        assert (whole[:, 2:] >= seen[:, 2:] - 1).all()
        assert np.abs(whole[1] - seen[1]).max() <= 2, names[1]
    image = simulation.render(EYES, height, width)
    assert image.std() > 20, "what is drawn after a segmentation is an image again"


def test_an_object_that_is_not_seen_has_no_segmented_box(cubes: TabletopSimulation):
    cubes.reset(CUBES)
    cubes.data.joint("red").qpos[:3] = [-1.0, 0.0, 0.7]  # behind the robot
    mujoco.mj_forward(cubes.model, cubes.data)
    boxes = cubes.segmented_boxes(EYES, 48, 64)
    assert (boxes[0] == -1).all()
    assert (boxes[1:] > 0).all()


# Actions are joint targets in degrees, as the robot and the datasets have them.
@pytest.mark.filterwarnings("error", "ignore:.*symmetric and normalized")
@pytest.mark.parametrize("name", ["nico_tabletop/Clant-v0", "nico_tabletop/Claeo-v0"])
def test_the_registered_environments_pass_gymnasiums_checker(name: str):
    env = gym.make(name, action="PULL-R", height=48, width=64)
    check_env(env.unwrapped)
    env.close()


def test_another_render_mode_is_refused():
    with pytest.raises(ValueError, match="render_mode must be rgb_array; got 'ansi'"):
        TabletopEnv("PUSH-L", render_mode="ansi")


def draw(**environment: str) -> str:
    """What a program says that asks for an image."""
    code = """if True:
        import nico_tabletop
        env = nico_tabletop.TabletopEnv("PUSH-L", height=48, width=64)
        env.reset(seed=0)
        print("drawn")
    """
    usual = {key: value for key, value in os.environ.items() if key != "MUJOCO_GL"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=False, env=usual | environment
    )
    return (done.stdout + done.stderr).strip()


@pytest.mark.slow
@pytest.mark.parametrize("environment", [{"DISPLAY": ":99"}, {"DISPLAY": ":99", "MUJOCO_GL": ""}])
def test_a_dead_screen_is_not_asked(environment: dict[str, str]):
    assert draw(**environment) == "drawn"


@pytest.mark.slow
@pytest.mark.parametrize("library", ["nonsense", "off", "glfw"])
def test_where_nothing_can_be_drawn_one_sentence_says_so(library: str):
    """The world is there all the same: planning needs no image."""
    last = draw(MUJOCO_GL=library, DISPLAY=":99").splitlines()[-1]
    assert f"DrawingError: MuJoCo cannot draw with MUJOCO_GL={library} (" in last
    assert "set MUJOCO_GL to egl, osmesa or glfw" in last


@pytest.mark.parametrize(("height", "width"), [(0, 64), (48, -1), (48, 1921), (10**9, 64)])
def test_an_image_that_cannot_be_drawn_is_refused_before_anything_is_made(height: int, width: int):
    with pytest.raises(ValueError, match=r"of an image must lie between 16 and 1920; got"):
        TabletopEnv("PUSH-L", height=height, width=width)
    with pytest.raises(ValueError, match=r"of an image must lie between 16 and 1920; got"):
        ClantEnvConfig(observation_height=height, observation_width=width).create_envs(1)


def test_the_world_has_one_pace():
    with pytest.raises(ValueError, match=r"10 frames per second; got --env\.fps=0"):
        ClantEnvConfig(fps=0).create_envs(1)


@pytest.mark.slow
def test_gymnasium_makes_the_environments_without_lerobot():
    code = """if True:
        import sys
        import gymnasium
        import nico_tabletop

        for objects in ("Clant", "Claeo"):
            env = gymnasium.make(f"nico_tabletop/{objects}-v0", action="PUSH-L", height=48, width=64)
            assert isinstance(env.unwrapped, nico_tabletop.TabletopEnv)
            env.reset(seed=0)
            print(env.unwrapped.task_description, gymnasium.spec(env.spec.id).to_json() != "")
        print("lerobot" in sys.modules)
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["push yellow True", "push empty wine bottle True", "False"]


def test_an_episode_ends_with_its_outcome_and_names_its_task():
    env = TabletopEnv("SLIDE-M-R", "claeo", height=48, width=64)
    observation, info = env.reset(options={"arrangement": ("can", "ball", "mug")})
    assert (env.task, env.task_description) == ("SLIDE-M-R", "slide-to-right ball")
    assert info["arrangement"] == ("can", "ball", "mug")
    objects = observation["objects"].reshape(3, 4 + NAME_BYTES)
    names = [bytes(row[4:].astype(np.uint8)).rstrip(b"\0").decode() for row in objects]
    assert names == ["can", "ball", "mug"]
    with black_images():
        for step in range(EPISODE_STEPS):
            _, reward, terminated, truncated, info = env.step(INITIAL_POSE_DEG.astype(np.float32))
            assert (terminated, truncated) == (False, step == EPISODE_STEPS - 1)
    assert (reward, info) == (0.0, {"is_success": False, "outcome": "failure", "failure": "refused"})
    env.close()


def test_an_episode_is_judged_by_the_task_that_it_is_given():
    env = TabletopEnv("PUSH-L", "claeo", height=48, width=64)
    for seed in range(5):
        _, info = env.reset(seed=seed, options={"task": "move-sideways-to-left cup"})  # two synonyms
        slot = info["arrangement"].index("mug")
        assert env.task == ("SLIDE-L-L", "SLIDE-M-L", "SLIDE-R-L")[slot]
        assert env.task_description == "slide-to-left mug"
    env.reset(seed=0)
    assert env.task == "PUSH-L"  # of this environment, when no task is given
    with pytest.raises(ValueError, match=r"no task is called 'lift mug'.*push.*mug.*such as 'push mustard"):
        env.reset(options={"task": "lift mug"})
    with pytest.raises(ValueError, match="the task 'push mug' needs a mug"):
        env.reset(options={"task": "push mug", "arrangement": ("can", "ball", "mustard bottle")})
    env.close()


def test_a_video_shows_the_command():
    env = TabletopEnv("PUSH-L", "claeo", height=48, width=64)
    _, info = env.reset(seed=0)
    simulation = TabletopSimulation(read_objects("claeo"))
    simulation.reset(info["arrangement"], info["poses"])
    scene = simulation.render(SPECTATOR, 360, 480)
    changed = (env.render() != scene).any(axis=(1, 2))
    assert changed[:40].any() and not changed[40:].any()
    simulation.close()
    env.close()


def test_a_seed_draws_the_same_scene_and_seeds_differ():
    env = TabletopEnv("PUSH-L", "clant", height=48, width=64)
    drawn = [env.reset(seed=seed)[1]["arrangement"] for seed in [*range(8), *range(8)]]
    assert drawn[:8] == drawn[8:]
    assert len(set(drawn[:8])) > 4
    env.close()


@pytest.mark.slow
def test_vector_environments_agree():
    makers = [partial(TabletopEnv, "PUSH-R", height=48, width=64)] * 2
    results = []
    for envs in (gym.vector.SyncVectorEnv(makers), gym.vector.AsyncVectorEnv(makers, context="forkserver")):
        observation, _ = envs.reset(seed=[3, 4])
        for _ in range(3):
            observation, *_ = envs.step(np.stack([INITIAL_POSE_DEG.astype(np.float32) + 3] * 2))
        results.append((observation["agent_pos"], observation["pixels"][EYES], envs.call("task_description")))
        envs.close()
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_the_world_needs_no_torch():
    code = "import sys, nico_tabletop.env; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
