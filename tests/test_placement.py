# SPDX-License-Identifier: Apache-2.0
"""Tests of free placement: the poses, and the environments that draw them."""

from itertools import combinations, pairwise

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given
from hypothesis import strategies as st

from nico_tabletop.configuration import ClaeoEnvConfig
from nico_tabletop.env import NAME_BYTES, TabletopEnv
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import (
    CLEARANCE,
    FARTHEST,
    NEAREST,
    SLOT_POSES,
    Pose,
    draw_poses,
    find_placement,
    half_width,
)
from nico_tabletop.robot import INITIAL_POSE_DEG
from nico_tabletop.simulation import TabletopSimulation

seeds = st.integers(0, 2**63)


@given(seeds)
def test_free_poses_lie_in_the_region_and_apart(seed: int) -> None:
    poses = draw_poses(np.random.default_rng(seed))
    for pose in poses:
        assert NEAREST <= pose.x <= FARTHEST
        assert abs(pose.y) <= half_width(pose.x)
        assert -180 <= pose.yaw <= 180
    assert all(np.hypot(a.x - b.x, a.y - b.y) >= CLEARANCE for a, b in combinations(poses, 2))
    assert all(left.y - right.y >= 0.108 for left, right in pairwise(poses))


@given(seeds)
def test_a_seed_draws_the_same_poses(seed: int) -> None:
    assert draw_poses(np.random.default_rng(seed)) == draw_poses(np.random.default_rng(seed))


def test_mixed_poses_are_the_slots_or_free() -> None:
    drawn = [find_placement("mixed")(np.random.default_rng(seed)) for seed in range(200)]
    assert sum(poses == SLOT_POSES for poses in drawn) == pytest.approx(100, abs=25)
    assert len({*drawn}) > 75


def test_the_slots_lie_in_the_region() -> None:
    assert all(NEAREST <= x <= FARTHEST and abs(y) <= half_width(x) for x, y, _ in SLOT_POSES)


@pytest.mark.parametrize("objects", ["clant", "claeo"])
def test_the_eyes_see_every_object_at_the_ends_of_the_region(objects: str) -> None:
    simulation = TabletopSimulation(read_objects(objects))
    names = list(simulation.objects)
    for arrangement in (names[:3], names[3:]):
        for turn in range(3):
            for x in (NEAREST, FARTHEST):
                for yaw in (0.0, 45.0):
                    left, right = (Pose(x, side * half_width(x), yaw) for side in (1, -1))
                    simulation.reset(arrangement[turn:] + arrangement[:turn], (left, SLOT_POSES[1], right))
                    boxes = simulation.object_boxes(4 / 3)
                    assert (boxes > 0).all() and (boxes < 1).all()


@pytest.mark.parametrize("number", range(5))
def test_objects_stay_where_they_are_put(number: int) -> None:
    simulation = TabletopSimulation(read_objects("clant"))
    poses = draw_poses(np.random.default_rng(number))
    simulation.reset(("red", "green", "blue"), poses)
    np.testing.assert_array_equal(simulation.object_positions()[:, :2], [pose[:2] for pose in poses])
    for _ in range(10):
        simulation.step(INITIAL_POSE_DEG)
    np.testing.assert_allclose(simulation.object_positions()[:, :2], [p[:2] for p in poses], atol=5e-4)
    turn = simulation.data.body("green").xmat.reshape(3, 3)[:2, 0]
    assert np.rad2deg(np.arctan2(turn[1], turn[0])) == pytest.approx(poses[1].yaw, abs=0.5)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized")
def test_the_environment_passes_gymnasiums_checker() -> None:
    env = gym.make("nico_tabletop/Claeo-v0", action="SLIDE-M-L", height=48, width=64, placement="free")
    check_env(env.unwrapped, skip_render_check=True)  # test_world.py has it
    env.close()


def test_a_seed_draws_the_same_scene_and_each_reset_another() -> None:
    env = TabletopEnv("PUSH-L", "claeo", height=48, width=64, placement="free")
    drawn = [env.reset(seed=seed)[1]["poses"] for seed in (1, None, 1, None)]
    assert drawn[:2] == drawn[2:]
    assert drawn[0] != drawn[1]
    env.close()


def test_the_slots_are_drawn_as_ever_and_poses_may_be_given() -> None:
    env = TabletopEnv("PUSH-M", "claeo", height=48, width=64)
    observation, info = env.reset(seed=0)
    assert info["poses"] == SLOT_POSES
    again, info = env.reset(options={"arrangement": info["arrangement"], "poses": info["poses"]})
    np.testing.assert_array_equal(observation["objects"], again["objects"])
    given = ((0.4, 0.2, 30.0), (0.4, 0.0, 0.0), (0.36, -0.18, 10.0))
    moved, info = env.reset(options={"arrangement": info["arrangement"], "poses": given})
    assert info["poses"] == given
    boxes = (objects["objects"].reshape(3, 4 + NAME_BYTES)[:, :4] for objects in (again, moved))
    assert (np.abs(np.subtract(*boxes)).max(axis=1) > 0.02).all()
    with pytest.raises(ValueError, match="each of the three objects needs a pose; got 2"):
        env.reset(options={"poses": given[:2]})
    env.close()


def test_lerobots_configuration_passes_the_placement_on() -> None:
    config = ClaeoEnvConfig(task="PUSH-L", placement="free", observation_height=48, observation_width=64)
    [envs] = config.create_envs(n_envs=2)["claeo"].values()
    _, info = envs.reset(seed=[0, 1])
    assert info["poses"][0] != info["poses"][1]
    assert all(pose not in SLOT_POSES for poses in info["poses"] for pose in poses)
    envs.close()


def test_another_placement_is_refused() -> None:
    with pytest.raises(ValueError, match="placement must be one of slots, free, mixed; got 'anywhere'"):
        ClaeoEnvConfig(placement="anywhere").create_envs(n_envs=1)
    with pytest.raises(ValueError, match="placement must be one of slots, free, mixed"):
        TabletopEnv("PUSH-L", "clant", placement="anywhere")
