# SPDX-License-Identifier: Apache-2.0
"""The dataset builder, through its command."""

import json
import pickle
import shlex
from dataclasses import replace
from itertools import islice, permutations
from pathlib import Path

import draccus
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from lerobot.datasets import LeRobotDataset
from lerobot.datasets.io_utils import write_table_one_row_group_per_episode

from clant_claeo.builder import build_dataset
from clant_claeo.card import read_build
from clant_claeo.cli import DatasetConfig
from clant_claeo.demonstrations import from_release, scripted
from clant_claeo.follow_up import begin
from clant_claeo.release import Release
from clant_claeo.sentences import named_thing
from commands import run, run_anyway
from nico_tabletop.configuration import ClantEnvConfig
from nico_tabletop.env import NAME_BYTES
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import SLOT_POSES, OutOfReachError, Pose
from nico_tabletop.replay import replay
from nico_tabletop.robot import INITIAL_POSE_DEG, JOINT_NAMES
from nico_tabletop.scoring import Outcome
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import ACTIONS, VERBS
from nico_tabletop.variation import Conditions, Variation
from test_release import replace_line, write_release

pytestmark = pytest.mark.slow  # starts builds

SMALL = ("--arrangements=1", "--height=48", "--width=64", "--workers=1")


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> LeRobotDataset:
    root = tmp_path_factory.mktemp("data") / "of claeo"
    output = run("owlxt5-dataset", "--objects=claeo", f"--root={root}", *SMALL)
    assert "12 perfect" in output
    assert str(root) in output.splitlines()[-2]
    training = "lerobot-train --policy.type=owlxt5 --policy.push_to_hub=false --dataset.repo_id=local/claeo"
    episodes = '--dataset.episodes="[$(seq -s, 0 8)]"'  # the train split
    assert output.splitlines()[-1] == f"Next: {training} '--dataset.root={root}' {episodes}"
    assert f"{training} {episodes} --output_dir=" in (root / "README.md").read_text(encoding="utf-8")
    return LeRobotDataset("local/claeo", root=root, video_backend="pyav")


def language(dataset: LeRobotDataset, frame: int) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    rows = dataset.hf_dataset[frame]["language_persistent"]
    for row in sorted(rows, key=lambda row: row["role"] == "assistant"):  # question before answer
        found.setdefault(row["style"], []).append(row["content"])
    return found


def test_frames_and_features(built: LeRobotDataset):
    assert built.fps == 10
    assert built.num_episodes == 12
    assert built.meta.robot_type == "nico"
    item = built[0]
    assert item["observation.images.eyes"].shape == (3, 48, 64)
    assert item["observation.images.eyes"].std() > 0.05
    assert item["observation.state"].shape == item["action"].shape == (10,)
    assert built.features["action"]["names"] == [f"{name}.pos" for name in JOINT_NAMES]


def test_an_action_is_the_next_state(built: LeRobotDataset):
    episode = np.array(built.hf_dataset["episode_index"])
    state, action = (np.stack(built.hf_dataset[key]) for key in ("observation.state", "action"))
    inside = np.flatnonzero(episode[1:] == episode[:-1])
    np.testing.assert_array_equal(action[inside], state[inside + 1])
    last = np.setdiff1d(np.arange(len(episode)), inside)
    np.testing.assert_array_equal(action[last], state[last])


def test_test_episodes_come_last(built: LeRobotDataset):
    train, test = (built.meta.info.splits[split] for split in ("train", "test"))
    assert (train, test) == ("0:9", "9:12")


def test_language_rows_say_what_happens(built: LeRobotDataset):
    for start in built.meta.episodes["dataset_from_index"]:
        rows = language(built, start)
        task = built[start]["task"]
        assert rows["task_aug"][0] == task
        assert len(set(rows["task_aug"])) == 4
        english, german = rows["translation"]
        assert english != german
        [scene] = map(json.loads, rows["scene"])
        assert scene["outcome"] == "perfect"
        assert list(scene["objects"]) == ["left", "middle", "right"]
        objects = built.hf_dataset[start]["observation.objects"].numpy().reshape(3, 4 + NAME_BYTES)
        seen = [bytes(row[4:].astype(np.uint8)).rstrip(b"\0").decode() for row in objects]
        assert seen == list(scene["objects"].values())
        assert any(task.endswith(name) for name in seen)


def test_the_boxes_of_the_first_and_the_last_frame_are_those_of_the_images(built: LeRobotDataset):
    for episode in built.meta.episodes:
        start, end = episode["dataset_from_index"], episode["dataset_to_index"]
        boxes = json.loads(language(built, start)["scene"][0])["boxes"]
        target = built[start]["task"].split(" ", 1)[1]
        for when, frame in (("first", start), ("last", end - 1)):
            projected = built.hf_dataset[frame]["observation.objects"].numpy().reshape(3, -1)[:, :4]
            seen = np.array(list(boxes[when].values()))
            pixel = np.array([1 / 64, 1 / 48])
            # What is seen is never more than the whole; hands hide parts.
            assert (seen[:, :2] >= projected[:, :2] - pixel).all()
            assert (seen[:, 2:] <= projected[:, 2:] + pixel).all()
        assert boxes["first"][target] != boxes["last"][target]


def test_scripted_demonstrations_are_split_like_the_release():
    found = list(scripted("clant"))
    assert len(found) == 1440
    for action in ACTIONS:
        mine = [demonstration.split for demonstration in found if demonstration.action == action]
        assert (mine.count("train"), mine.count("test")) == (90, 30)


@pytest.mark.parametrize("objects", ["clant", "claeo"])
def test_scripted_sentences_are_about_the_objects_on_the_table(objects: str):
    one, again, other = (list(scripted(objects, seed=seed)) for seed in (1, 1, 2))
    sentences = [demonstration.translation for demonstration in one]
    assert sentences == [demonstration.translation for demonstration in again]
    assert sentences != [demonstration.translation for demonstration in other]
    assert len({*sentences}) > 500
    for demonstration, (english, german) in zip(one, sentences, strict=True):
        assert any(name in english.lower() for name in demonstration.arrangement)
        assert english[0].isupper() and german[0].isupper()
        assert english.endswith("?") == german.endswith("?")


@pytest.mark.parametrize(
    ("name", "german"),
    [
        ("red", "den roten Würfel"),
        ("empty wine bottle", "die leere Weinflasche"),
        ("toy car", "das Spielzeugauto"),
        ("zorble", "das zorble"),  # unknown: the same word
    ],
)
def test_an_objects_name_in_german(name: str, german: str):
    assert named_thing(name).german("accusative") == german


def test_free_placement_gives_every_demonstration_poses_of_its_own():
    one, again, other = (list(scripted("claeo", "free", seed)) for seed in (1, 1, 2))
    assert [d.poses for d in one] == [d.poses for d in again]
    assert len({pose for d in one + other for pose in d.poses}) == 3 * 2 * 1440
    lazy = pickle.dumps(one[0])
    assert len(lazy) < 2000  # the trajectory is planned where it is needed
    np.testing.assert_array_equal(pickle.loads(lazy).joints, again[0].joints)


def test_the_command_places_objects_freely(tmp_path: Path):
    root = tmp_path / "free"
    free = ("--objects=clant", "--placement=free", "--seed=3", f"--root={root}", *SMALL)
    output = run("owlxt5-dataset", *free)
    dataset = LeRobotDataset("local/clant", root=root, video_backend="pyav")
    assert f"Rejected and not written: {12 - dataset.num_episodes} of 12 demonstrations" in output
    starts = dataset.hf_dataset[list(dataset.meta.episodes["dataset_from_index"])]["observation.objects"]
    card = (root / "README.md").read_text()
    assert "pretrained_model --env.type=clant --env.placement=free\n" in card
    boxes = np.stack(starts).reshape(-1, 3, 4 + NAME_BYTES)[:, :, :4]
    assert len(np.unique(boxes[:, 0], axis=0)) == dataset.num_episodes


def test_conditions_are_drawn_per_demonstration_and_leave_the_poses_alone():
    plain = list(scripted("claeo", "free", 3))
    varied, again, other = (
        list(scripted("claeo", "free", seed, Variation(arms_deg=5, light=0.5))) for seed in (3, 3, 4)
    )
    assert [d.poses for d in varied] == [d.poses for d in plain]
    assert [d.translation for d in varied] == [d.translation for d in plain]
    assert {d.conditions for d in plain} == {Conditions()}
    assert [d.conditions for d in varied] == [d.conditions for d in again]
    assert len({d.conditions for d in varied + other}) == 2 * 1440
    np.testing.assert_array_equal(varied[0].joints[0], varied[0].conditions.start_pose_deg)
    assert (varied[0].joints[0] != plain[0].joints[0]).any()


def test_the_command_varies_what_is_seen_and_where_it_starts(tmp_path: Path):
    root = tmp_path / "varied"
    varied = ("--variation.arms_deg=5", "--variation.shift_cm=1", "--variation.light=0.5")
    run("owlxt5-dataset", *varied, "--variation.table=true", "--variation.jpeg=60", f"--root={root}", *SMALL)
    dataset = LeRobotDataset("local/clant", root=root, video_backend="pyav")
    starts = list(dataset.meta.episodes["dataset_from_index"])
    demonstrations = {
        demonstration.task: demonstration
        for demonstration in scripted("clant", variation=Variation(5, 1, light=0.5, table=True, jpeg=60))
        if demonstration.arrangement == ("blue", "cyan", "green")
    }
    for start in starts:
        demonstration = demonstrations[dataset[start]["task"]]
        [scene] = map(json.loads, language(dataset, start)["scene"])
        assert scene["conditions"].keys() == {"arms_deg", "shift_cm", "light", "table", "jpeg"}
        assert scene["conditions"] == json.loads(json.dumps(demonstration.conditions.facts()))
        state = dataset.hf_dataset[start]["observation.state"].numpy()
        np.testing.assert_allclose(state, demonstration.conditions.start_pose_deg, atol=1e-5)
    brightness = [float(dataset[start]["observation.images.eyes"].mean()) for start in starts]
    assert max(brightness) > 1.2 * min(brightness)
    build = read_build(root)
    assert build is not None
    _, *words = shlex.split(build.command)
    typed = draccus.parse(DatasetConfig, args=words)
    assert typed.variation == Variation(5, 1, light=0.5, table=True, jpeg=60)
    evaluation = [word.removeprefix("--env.") for word in shlex.split(build.environment)[1:]]
    assert (
        draccus.parse(ClantEnvConfig, args=[f"--{word}" for word in evaluation]).variation == typed.variation
    )
    assert f"pretrained_model {build.environment}\n" in (root / "README.md").read_text(encoding="utf-8")


def test_a_share_of_the_demonstrations_follows_another_movement():
    plain = list(islice(scripted("claeo", "free", 3), 360))
    some, again = (list(islice(scripted("claeo", "free", 3, follow_ups=0.25), 360)) for _ in range(2))
    assert [d.before for d in some] == [d.before for d in again]
    assert [d.poses for d in some] == [d.poses for d in plain]
    following = [d for d in some if d.before]
    assert len(following) == pytest.approx(len(some) / 4, rel=0.15)
    assert {(d.before, d.action.verb) for d in following} == set(permutations(VERBS, 2))
    assert not any(d.before for d in plain)


def test_a_push_may_begin_where_a_pull_left_its_object_between_the_fingers():
    demonstration = next(scripted("clant"))
    assert demonstration.action.name == "PUSH-L"
    simulation = TabletopSimulation(read_objects("clant"))
    pulled = begin(simulation, replace(demonstration, before=VERBS[1]))
    near, *others = pulled.poses
    assert SLOT_POSES[0].x - 0.08 < near.x < SLOT_POSES[0].x - 0.03
    np.testing.assert_allclose(
        [pose[:2] for pose in others], [pose[:2] for pose in SLOT_POSES[1:]], atol=1e-3
    )
    np.testing.assert_allclose(pulled.joints[0], INITIAL_POSE_DEG, atol=3)
    simulation.reset(pulled.arrangement, pulled.poses, pulled.conditions)
    assert replay(simulation, pulled.action, pulled.joints) is Outcome.PERFECT
    beyond = replace(demonstration, before=VERBS[1], poses=(Pose(0.6, 0.2), *SLOT_POSES[1:]))
    with pytest.raises(OutOfReachError, match="PULL-L"):
        begin(simulation, beyond)


def test_the_command_records_what_came_before(tmp_path: Path):
    root = tmp_path / "followed"
    run("owlxt5-dataset", "--follow_ups=1", "--shard=1/4", f"--root={root}", *SMALL)
    dataset = LeRobotDataset("local/clant", root=root, video_backend="pyav")
    for start in dataset.meta.episodes["dataset_from_index"]:
        [scene] = map(json.loads, language(dataset, start)["scene"])
        assert scene["before"] in {verb.name for verb in VERBS} - {dataset[start]["task"].split()[0]}
        assert scene["conditions"].keys() == {"arms_deg"}
    build = read_build(root)
    assert build is not None
    assert build.follow_ups == 1 and "--follow_ups=1.0" in build.command
    assert "the movement that it follows (`before`)" in (root / "README.md").read_text(encoding="utf-8")


def test_the_releases_images_may_vary_and_its_movements_not(clant_release: Release):
    varied = list(from_release(clant_release, variation=Variation(light=0.5, noise=5)))
    assert len({demonstration.conditions for demonstration in varied}) == 1440
    for variation in (Variation(arms_deg=5), Variation(shift_cm=1)):
        with pytest.raises(ValueError, match=r"variation\.shift_cm need --source=scripted"):
            next(from_release(clant_release, variation=variation))


def test_demonstrations_that_fail_are_not_written(tmp_path: Path):
    good = next(scripted("clant"))
    unreachable = replace(good, poses=(Pose(0.6, 0.2), *good.poses[1:]))
    fails = replace(good, recorded=np.tile(INITIAL_POSE_DEG, (40, 1)))
    outcomes = build_dataset(
        [unreachable, good, fails],
        read_objects("clant"),
        "local/clant",
        tmp_path / "data",
        height=48,
        width=64,
        video=False,
        keep_failures=False,
        recipe={},
    )
    assert outcomes == {Outcome.PERFECT: 1, Outcome.FAILURE: 2}
    dataset = LeRobotDataset("local/clant", root=tmp_path / "data")
    assert dataset.num_episodes == 1 and dataset.num_frames == len(good.joints)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--placement=free", "--source=/nowhere"), "--placement=free needs --source=scripted"),
        (("--placement=anywhere",), "placement must be one of slots, free, mixed; got 'anywhere'"),
        (("--follow_ups=2",), "--follow_ups is a share from 0 to 1; got 2"),
    ],
)
def test_places_and_shares_that_cannot_be_are_refused(tmp_path: Path, options: tuple[str, ...], message: str):
    done = run_anyway("owlxt5-dataset", f"--root={tmp_path / 'data'}", *options)
    assert done.returncode == 1
    assert message in done.stdout
    assert "Traceback" not in done.stdout


def test_the_release_is_copied_exactly(clant_dir: Path, tmp_path: Path):
    root = tmp_path / "clant"
    run("owlxt5-dataset", f"--source={clant_dir}", f"--root={root}", *SMALL)
    assert "12 of 12 episodes equal" in run("python", "benchmarks/exactness.py", f"--dataset_root={root}")
    path = root / "data/chunk-000/file-000.parquet"
    table = pq.read_table(path)
    values = table["action"].to_pylist()
    values[100][3] += 0.01
    changed = table.set_column(
        table.column_names.index("action"), "action", pa.array(values, table["action"].type)
    )
    write_table_one_row_group_per_episode(changed, path)
    done = run_anyway("python", "benchmarks/exactness.py", f"--dataset_root={root}")
    assert done.returncode == 1
    assert "episode 1: action" in done.stdout


def test_claeo_keeps_the_releases_trajectories(clant_release: Release):
    cubes, novel = (list(from_release(clant_release, objects)) for objects in ("clant", "claeo"))
    assert all(one.joints is other.joints for one, other in zip(cubes, novel, strict=True))
    stand_in = {
        cube: thing
        for one, other in zip(cubes, novel, strict=True)
        for cube, thing in zip(one.arrangement, other.arrangement, strict=True)
    }
    assert len(set(stand_in.values())) == 6
    assert {demonstration.task for demonstration in novel} >= {"push ball", "slide-to-left empty wine bottle"}


@pytest.mark.parametrize(
    ("line", "text", "message"),
    [(5, "0 -20 0 nan 0 0 20 0 100 0", "nan"), (5, "0 -20 0", "3 joint angles instead of 10")],
)
def test_a_bad_release_gives_one_error_and_no_data_set(tmp_path: Path, line: int, text: str, message: str):
    source = write_release(tmp_path / "CLANT")
    replace_line(source / "behavior_train/target0007.txt", line, text)
    root = tmp_path / "out" / "clant"
    done = run_anyway("owlxt5-dataset", f"--source={source}", f"--root={root}")
    assert done.returncode == 1
    assert f"behavior_train/target0007.txt, line {line}" in done.stdout
    assert message in done.stdout
    assert "Traceback" not in done.stdout
    assert not root.parent.exists()


def test_an_existing_folder_is_left_alone(built: LeRobotDataset):
    before = sorted(built.root.rglob("*"))
    done = run_anyway("owlxt5-dataset", "--objects=claeo", f"--root={built.root}", *SMALL)
    assert done.returncode == 1
    assert "exists already" in done.stdout.splitlines()[-1]
    assert sorted(built.root.rglob("*")) == before
