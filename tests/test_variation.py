# SPDX-License-Identifier: Apache-2.0
"""The world under other conditions than the paper's: what each option does, and that nothing of it stays."""

from dataclasses import fields, replace

import draccus
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from black_images import black_images
from nico_tabletop.configuration import ClaeoEnvConfig
from nico_tabletop.env import TabletopEnv
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import SLOT_POSES, Pose, draw_poses
from nico_tabletop.robot import EYES, INITIAL_POSE_DEG, joint_limits_deg
from nico_tabletop.scene import SPECTATOR
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.starts import CrowdedError, draw_conditions, hands_are_clear
from nico_tabletop.variation import Conditions, Variation

CUBES = ("red", "green", "blue")
SIZE = (96, 128)
EVERYTHING = Variation(5, 2, 1, 2, 0.3, True, 8, 1, 50)
SEEDS = st.integers(0, 2**63)


@pytest.fixture(scope="module")
def cubes() -> TabletopSimulation:
    return TabletopSimulation(read_objects("clant"))


def seen(cubes: TabletopSimulation, conditions: Conditions | None = None) -> NDArray[np.float64]:
    cubes.reset(CUBES, conditions=conditions)
    return cubes.render(EYES, *SIZE).astype(float)


def middles(cubes: TabletopSimulation, **conditions: object) -> NDArray[np.float64]:
    """Middles of the boxes in the eyes' image, shape (3, 2), in pixels."""
    cubes.reset(CUBES, conditions=Conditions(**conditions))
    boxes = cubes.object_boxes(SIZE[1] / SIZE[0])
    drawn = cubes.segmented_boxes(EYES, *SIZE)
    assert np.abs(boxes[1] - drawn[1]).max() < 0.03, "the boxes are those of the camera that draws"
    return (boxes[:, :2] + boxes[:, 2:]) / 2 * SIZE[::-1]


@given(SEEDS)
def test_a_draw_keeps_within_the_variation(seed: int) -> None:
    drawn = EVERYTHING.draw(np.random.default_rng(seed))
    assert drawn == EVERYTHING.draw(np.random.default_rng(seed))
    assert np.abs(drawn.arms_deg).max() <= 5
    assert np.hypot(*np.transpose(drawn.shift_cm)).max() <= 2.001  # rounded
    assert np.linalg.norm(drawn.camera_cm) <= 1.001
    assert np.abs(drawn.camera_deg).max() <= 2
    assert 0.3 <= drawn.light <= 1.5
    assert drawn.table is not None and min(drawn.table) > 0.3 and max(drawn.table) <= 1
    assert 0 <= drawn.noise <= 8 and 0 <= drawn.blur <= 1 and 50 <= drawn.jpeg <= 95


@given(SEEDS)
def test_off_is_off_and_what_is_on_does_not_depend_on_the_rest(seed: int) -> None:
    assert Variation().draw(np.random.default_rng(seed)).facts() == {}
    whole = EVERYTHING.draw(np.random.default_rng(seed))
    for name, value in EVERYTHING.options().items():
        alone = Variation(**{name: value}).draw(np.random.default_rng(seed))
        assert getattr(alone, name) == getattr(whole, name)
        assert alone.facts().keys() <= {name, *(["seed"] if name == "noise" else [])}


def test_the_options_are_named_as_in_the_conditions_that_they_draw() -> None:
    names = {field.name for field in fields(Variation)}
    assert names == {field.name for field in fields(Conditions)} - {"seed"} == EVERYTHING.options().keys()


@pytest.mark.parametrize(
    ("option", "value"),
    [("arms_deg", -1), ("shift_cm", 7), ("light", 0), ("light", 2), ("jpeg", 96), ("noise", float("nan"))],
)
def test_a_variation_out_of_range_is_refused(option: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"variation\.{option} must lie .* got {value}"):
        Variation(**{option: value})


@pytest.mark.parametrize(
    "wrong", [{"arms_deg": (1.0,)}, {"shift_cm": (1.0, 2.0)}, {"light": -1}, {"jpeg": 100}]
)
def test_conditions_that_cannot_be_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=f"conditions: .*{next(iter(wrong))}"):
        Conditions(**wrong)


def test_the_arms_start_elsewhere_and_stay_there(cubes: TabletopSimulation) -> None:
    off = (3.0, -4, 5, -6, 7, -8, 9, 10, 4, 3)  # both elbows beyond their limits
    cubes.reset(CUBES, conditions=Conditions(arms_deg=off))
    expected = np.clip(INITIAL_POSE_DEG + off, *joint_limits_deg().T)
    np.testing.assert_allclose(cubes.joint_positions_deg, expected, atol=1e-9)
    for _ in range(5):
        cubes.step(Conditions(arms_deg=off).start_pose_deg)
    np.testing.assert_allclose(cubes.joint_positions_deg, expected, atol=0.5)
    np.testing.assert_array_equal(Conditions().start_pose_deg, INITIAL_POSE_DEG)


def test_objects_stand_off_their_places(cubes: TabletopSimulation) -> None:
    shift = ((3.0, -1.0), (0.0, 2.0), (1.0, 1.0))
    conditions = Conditions(shift_cm=shift)
    cubes.reset(CUBES, conditions=conditions)
    slots = np.array([pose[:2] for pose in SLOT_POSES])
    np.testing.assert_allclose(cubes.object_positions()[:, :2], slots + np.array(shift) / 100)
    np.testing.assert_allclose(cubes.object_poses(), conditions.shifted(SLOT_POSES), atol=1e-12)


def test_object_poses_have_the_yaw(cubes: TabletopSimulation) -> None:
    poses = draw_poses(np.random.default_rng(0))
    cubes.reset(CUBES, poses)
    np.testing.assert_allclose(cubes.object_poses(), poses)


def test_the_camera_moves_in_its_own_frame(cubes: TabletopSimulation) -> None:
    at_first = middles(cubes)
    to_the_right, up, nearer = (
        middles(cubes, camera_cm=tuple(move)) - at_first for move in ((2, 0, 0), (0, 2, 0), (0, 0, -2))
    )
    assert (to_the_right[:, 0] < -2).all() and np.abs(to_the_right[:, 1]).max() < 1
    assert (up[:, 1] > 2).all() and np.abs(up[:, 0]).max() < 1
    assert nearer[0, 0] < -1 < 1 < nearer[2, 0], "what is nearer is larger"


def test_the_camera_turns_about_its_axes(cubes: TabletopSimulation) -> None:
    at_first = middles(cubes)
    up, left, rolled = (
        middles(cubes, camera_deg=tuple(turn)) - at_first for turn in ((3, 0, 0), (0, 3, 0), (0, 0, 3))
    )
    assert (up[:, 1] > 2).all()
    assert (left[:, 0] > 2).all()
    assert rolled[0, 1] < -1 < 1 < rolled[2, 1], "the image turns clockwise"


def test_light_and_table_change_what_is_seen_by_all_cameras(cubes: TabletopSimulation) -> None:
    at_first = seen(cubes)
    assert seen(cubes, Conditions(light=0.5)).mean() < 0.6 * at_first.mean()
    assert seen(cubes, Conditions(light=1.2)).mean() > 1.05 * at_first.mean()
    white = seen(cubes, Conditions(table=(1.0, 1.0, 1.0)))
    corner = np.s_[20:30, :20]  # nothing but table
    assert white[corner].min() > 250 and at_first[corner].max() < 250
    cubes.reset(CUBES)
    bystander = cubes.render(SPECTATOR, *SIZE)
    cubes.reset(CUBES, conditions=Conditions(table=(1.0, 1.0, 1.0)))
    assert (cubes.render(SPECTATOR, *SIZE) != bystander).any()


def test_a_cheap_camera_blurs_adds_noise_and_compresses(cubes: TabletopSimulation) -> None:
    at_first = seen(cubes)
    edges = np.abs(np.diff(at_first, axis=0)).max()
    assert np.abs(np.diff(seen(cubes, Conditions(blur=3)), axis=0)).max() < edges / 2
    bright = (at_first > 30) & (at_first < 225)
    noise = (seen(cubes, Conditions(noise=5, seed=1)) - at_first)[bright]
    assert noise.std() == pytest.approx(5, abs=0.3) and abs(noise.mean()) < 0.3
    compressed = np.abs(seen(cubes, Conditions(jpeg=10)) - at_first).mean()
    assert compressed > 1.5 * np.abs(seen(cubes, Conditions(jpeg=95)) - at_first).mean() > 0
    cubes.reset(CUBES)
    bystander = cubes.render(SPECTATOR, *SIZE)
    cubes.reset(CUBES, conditions=Conditions(noise=5, blur=2, jpeg=10))
    np.testing.assert_array_equal(cubes.render(SPECTATOR, *SIZE), bystander)


def test_noise_comes_with_seed_and_step(cubes: TabletopSimulation) -> None:
    def images(seed: int) -> list[bytes]:
        cubes.reset(CUBES, conditions=Conditions(noise=5, seed=seed))
        found = [cubes.render(EYES, *SIZE).tobytes()]
        assert cubes.render(EYES, *SIZE).tobytes() == found[0], "how often one looks changes nothing"
        cubes.step(INITIAL_POSE_DEG)
        return [*found, cubes.render(EYES, *SIZE).tobytes()]

    assert images(1) == images(1)
    assert len({*images(1), *images(2)}) == 4


def test_the_next_reset_puts_all_of_it_back(cubes: TabletopSimulation) -> None:
    def whole() -> list[bytes]:
        cubes.reset(CUBES)
        cubes.step(INITIAL_POSE_DEG + 3)
        images = [cubes.render(camera, *SIZE).tobytes() for camera in (EYES, SPECTATOR)]
        return [*images, cubes.data.qpos.tobytes(), cubes.object_boxes(4 / 3).tobytes()]

    at_first = whole()
    cubes.reset(CUBES, conditions=EVERYTHING.draw(np.random.default_rng(0)))
    cubes.render(EYES, *SIZE)
    assert whole() == at_first


@pytest.mark.parametrize("number", range(20))
def test_no_hand_starts_in_an_object(cubes: TabletopSimulation, number: int) -> None:
    variation = Variation(arms_deg=10, shift_cm=4)
    conditions = draw_conditions(variation, SLOT_POSES, np.random.default_rng(number))
    assert hands_are_clear(SLOT_POSES, conditions)
    cubes.reset(CUBES, conditions=conditions)
    before = cubes.object_positions()
    for _ in range(5):
        cubes.step(conditions.start_pose_deg)
    np.testing.assert_allclose(cubes.object_positions(), before, atol=1e-3)


def test_hands_in_objects_are_noticed_and_a_start_without_room_is_refused() -> None:
    in_the_hand = (Pose(0.28, 0.15), *SLOT_POSES[1:])
    assert not hands_are_clear(in_the_hand, Conditions())
    with pytest.raises(CrowdedError, match=r"no start was found .* lower variation\.arms_deg"):
        draw_conditions(Variation(arms_deg=0.1), in_the_hand, np.random.default_rng(0))


def test_a_seed_draws_the_same_start_and_scenes_do_not_depend_on_what_varies() -> None:
    plain, varied = (
        TabletopEnv("PUSH-L", "claeo", *SIZE, placement="free", variation=variation)
        for variation in (None, EVERYTHING)
    )
    for seed in (3, None, None, 3):
        _, usual = plain.reset(seed=seed)
        observation, info = varied.reset(seed=seed)
        assert (info["arrangement"], info["poses"]) == (usual["arrangement"], usual["poses"])
        assert usual["conditions"] == Conditions() != info["conditions"]
        if seed:
            first = observation["pixels"][EYES].tobytes(), info["conditions"]
    again, info = varied.reset(seed=3)
    assert (again["pixels"][EYES].tobytes(), info["conditions"]) == first
    assert varied.reset()[1]["conditions"] != info["conditions"]
    given, _ = plain.reset(options=info)  # exactly this start
    for one, other in ((given["pixels"][EYES], again["pixels"][EYES]), (given["objects"], again["objects"])):
        np.testing.assert_array_equal(one, other)
    plain.close()
    varied.close()


def test_a_robot_that_stays_where_it_starts_holds_still() -> None:
    env = TabletopEnv("PUSH-L", "clant", *SIZE, episode_length=3)
    conditions = Conditions(arms_deg=(6.0, *INITIAL_POSE_DEG[1:] * 0))
    for target, failure in ((conditions.start_pose_deg, "refused"), (INITIAL_POSE_DEG, "missed")):
        env.reset(seed=0, options={"conditions": conditions})
        with black_images():
            for _ in range(3):
                *_, done, info = env.step(target.astype(np.float32))
        assert done and info["failure"] == failure
    env.close()


def test_a_kept_start_is_where_the_last_episode_ended() -> None:
    env = TabletopEnv("PUSH-L", "claeo", *SIZE, episode_length=2, variation=replace(EVERYTHING, arms_deg=0))
    with pytest.raises(ValueError, match="there was none: reset without it first"):
        env.reset(options={"keep": True})
    _, before = env.reset(seed=1, options={"arrangement": ("can", "ball", "mug")})
    for _ in range(2):
        observation, *_, done, _ = env.step((INITIAL_POSE_DEG + 2).astype(np.float32))
    assert done
    kept, info = env.reset(options={"keep": True, "task": "pull ball"})
    for key in ("agent_pos", "objects"):
        np.testing.assert_array_equal(kept[key], observation[key])
    np.testing.assert_array_equal(kept["pixels"][EYES], observation["pixels"][EYES])
    assert (env.task, env.task_description) == ("PULL-M", "pull ball")
    assert info["arrangement"] == before["arrangement"]
    shifted = before["conditions"].shifted(before["poses"])
    np.testing.assert_allclose(info["conditions"].shifted(info["poses"]), shifted, atol=1e-3)
    np.testing.assert_allclose(info["conditions"].start_pose_deg, kept["agent_pos"], atol=0.05)
    assert info["conditions"].light == before["conditions"].light
    with pytest.raises(ValueError, match="the task 'push mustard bottle' needs a mustard bottle"):
        env.reset(options={"keep": True, "task": "push mustard bottle"})
    with pytest.raises(ValueError, match="leave out poses and conditions"):
        env.reset(options={"keep": True, "poses": SLOT_POSES, "conditions": Conditions()})
    env.close()


@pytest.mark.slow
def test_a_second_command_is_judged_from_where_the_first_left_the_object() -> None:
    plan = pytest.importorskip("clant_claeo.expert", reason="needs the extra `scripted`").plan
    env = TabletopEnv("PUSH-L", "clant", *SIZE)

    def act(joints: NDArray[np.float64]) -> dict[str, object]:
        with black_images():
            for step in range(90):
                *_, info = env.step(joints[min(step + 1, len(joints) - 1)].astype(np.float32))
        return info

    _, first = env.reset(seed=0, options={"arrangement": CUBES})
    assert act(plan(env.action, first["poses"]))["outcome"] == "perfect"
    _, second = env.reset(options={"keep": True, "task": "pull red"})
    assert act(np.tile(INITIAL_POSE_DEG, (2, 1)))["failure"] == "missed"  # home, which touches nothing
    env.reset(options={"keep": True, "task": "pull red"})
    assert act(plan(env.action, second["poses"]))["outcome"] == "perfect"
    _, third = env.reset(options={"keep": True})
    start, pushed, pulled = (info["poses"][0].x for info in (first, second, third))
    assert pushed > start + 0.03 and pulled < pushed - 0.03
    assert abs(pulled - start) < 0.03, "judged from the first place, the pull would only undo the push"
    env.close()


def test_lerobots_configuration_passes_variation_and_length_on() -> None:
    words = ["--task=PUSH-L", "--variation.arms_deg=5", "--variation.table=true", "--episode_length=7"]
    size = [f"--observation_height={SIZE[0]}", f"--observation_width={SIZE[1]}"]
    config = draccus.parse(ClaeoEnvConfig, args=[*words, *size])
    [envs] = config.create_envs(n_envs=2)["claeo"].values()
    _, info = envs.reset(seed=[0, 1])
    one, other = info["conditions"]
    assert one.facts().keys() == {"arms_deg", "table"} and one != other
    assert envs.call("_max_episode_steps") == (7, 7)
    envs.close()


def test_an_episode_without_a_step_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one step; got episode_length=0"):
        TabletopEnv("PUSH-L", episode_length=0)
    with pytest.raises(ValueError, match="at least one step; got episode_length=-1"):
        ClaeoEnvConfig(episode_length=-1).create_envs(1)
