# SPDX-License-Identifier: Apache-2.0
"""What a dataset build does when something dies, fills up or is called again."""

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from filelock import FileLock
from lerobot.datasets import LeRobotDataset

from clant_claeo import takes
from clant_claeo.builder import BuildError, build_dataset
from clant_claeo.cli import DatasetConfig, _demonstrations, _shard
from clant_claeo.demonstrations import Demonstration
from commands import ENVIRONMENT, run
from nico_tabletop.objects import read_objects
from nico_tabletop.placement import SLOT_POSES
from nico_tabletop.robot import INITIAL_POSE_DEG
from nico_tabletop.scoring import Outcome
from nico_tabletop.tasks import find_action

pytestmark = pytest.mark.slow  # starts builds and kills them

SMALL = ("--arrangements=1", "--shard=1/3", "--height=48", "--width=64")
COMMAND = ("owlxt5-dataset", "--objects=claeo", *SMALL)
FULL = "Encoder thread for observation.images.eyes failed: [Errno 28] No space left on device: 'x.mp4'"


def tables(root: Path) -> dict[Path, bytes]:
    """All of a dataset but its videos and its card."""
    files = [
        *root.glob("data/**/*.*"),
        *(file for file in root.glob("meta/**/*.*") if file.name != "build.json"),
    ]
    assert len(files) == 5  # data, episodes, tasks, info, stats
    return {file.relative_to(root): file.read_bytes() for file in files}


def demonstrations(count: int = 5) -> list[Demonstration]:
    """Short ones, in which the left arm moves a little and no object does."""
    random = np.random.default_rng(3)
    made = []
    for index in range(count):
        joints = INITIAL_POSE_DEG + random.normal(0, 2, (4 + index, 10)) * (np.arange(4 + index) > 0)[:, None]
        action = find_action(("PUSH-L", "PULL-M", "SLIDE-R-L")[index % 3])
        verb = action.verb
        words = (f"{verb.name} ball", f"{verb.synonym} ball", f"{verb.name} sphere", "roll")
        split: takes.Split = "test" if index in (0, 3) else "train"
        names, sentences = ("mug", "ball", "can"), ("Yes.", "Ja.")
        made.append(Demonstration(action, names, SLOT_POSES, joints, words, sentences, split))
    return made


def build(root: Path, acted: Sequence[Demonstration] = (), **options: Any) -> None:
    given = {"keep_failures": True, "height": 48, "width": 64, "video": True, "recipe": {"objects": "claeo"}}
    objects = options.pop("objects", read_objects("claeo"))
    build_dataset(acted or demonstrations(), objects, "local/x", root, **given | options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An uninterrupted build by one worker."""
    root = tmp_path_factory.mktemp("whole") / "data"
    build(root)
    assert LeRobotDataset("local/x", root=root).meta.info.splits == {"train": "0:3", "test": "3:5"}
    assert [path.name for path in root.parent.iterdir()] == ["data"]
    return root


def failing(monkeypatch: pytest.MonkeyPatch, calls: int, error: Exception) -> None:
    """After so many episodes, saving one fails."""
    save: Callable[..., None] = LeRobotDataset.save_episode
    left = iter(range(calls))

    def save_or_fail(self: LeRobotDataset) -> None:
        if next(left, None) is None:
            raise error
        save(self)

    monkeypatch.setattr(LeRobotDataset, "save_episode", save_or_fail)


def test_two_workers_write_the_same_tables(whole: Path, tmp_path: Path):
    build(tmp_path / "data", workers=2)
    assert tables(tmp_path / "data") == tables(whole)


def test_a_full_disk_is_named_and_the_build_goes_on(
    whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    with monkeypatch.context() as patch:
        failing(patch, 2, RuntimeError(FULL))
        with pytest.raises(BuildError, match=r"the disk is full.*2 of 5 episodes are complete"):
            build(tmp_path / "data")
    assert not (tmp_path / "data").exists()
    failing(monkeypatch, 3, AssertionError("a complete episode was made again"))
    build(tmp_path / "data")
    assert tables(tmp_path / "data") == tables(whole)


def test_a_half_built_folder_is_no_data_set_and_keeps_to_its_recipe(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    failing(monkeypatch, 1, RuntimeError(FULL))
    with pytest.raises(BuildError):
        build(tmp_path / "data")
    unfinished = tmp_path / "data.unfinished"
    with pytest.raises(Exception, match=r"(?i)offline|local/x"):
        LeRobotDataset("local/x", root=unfinished)
    with pytest.raises(BuildError, match=r"objects was claeo, is now clant.*or delete that folder"):
        build(tmp_path / "data", recipe={"objects": "clant"})
    other = tuple(replace(item, scale=0.9) for item in read_objects("claeo"))
    with pytest.raises(BuildError, match="look of the objects was"):
        build(tmp_path / "data", objects=other)
    with (
        FileLock(unfinished / "lock"),
        pytest.raises(BuildError, match="another process is building"),
    ):
        build(tmp_path / "data")


def test_a_build_that_made_nothing_is_in_nobodys_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with monkeypatch.context() as patch:
        failing(patch, 0, RuntimeError("the encoder does not take this size"))
        with pytest.raises(RuntimeError, match="does not take"):
            build(tmp_path / "data", demonstrations(1), recipe={"height": 121})
    build(tmp_path / "data", demonstrations(1), recipe={"height": 120})
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_a_video_that_lost_frames_is_no_take(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(takes, "check_videos", lambda folder, frames: check(folder, frames + 1))
    with pytest.raises(OSError, match=r"5 frames instead of 6"):
        build(tmp_path / "data")


check = takes.check_videos


def test_a_demonstration_that_fails_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("nico_tabletop.replay.judge", lambda *_: Outcome.FAILURE)
    with pytest.raises(BuildError, match="no demonstration succeeded"):
        build(tmp_path / "none", keep_failures=False)
    outcomes = iter([Outcome.PERFECT, Outcome.FAILURE, Outcome.SUCCESSFUL, Outcome.FAILURE, Outcome.PERFECT])
    monkeypatch.setattr("nico_tabletop.replay.judge", lambda *_: next(outcomes))
    build(tmp_path / "some", keep_failures=False)
    dataset = LeRobotDataset("local/x", root=tmp_path / "some")
    assert dataset.num_episodes == 3
    assert dataset.meta.info.splits == {"train": "0:2", "test": "2:3"}
    assert dataset[dataset.num_frames - 1]["observation.images.eyes"].shape == (3, 48, 64)


def test_many_takes_are_joined_in_rounds(whole: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("clant_claeo.builder._JOINED_AT_ONCE", 2)  # 5 takes, 3 groups, 2 groups, 1 dataset
    build(tmp_path / "data")
    one, other = (LeRobotDataset("local/x", root=root) for root in (whole, tmp_path / "data"))
    assert len(one) == len(other)
    for index in range(len(one)):
        ours, theirs = one[index], other[index]
        for key in ("observation.images.eyes", "observation.state", "action", "timestamp", "index"):
            assert (ours[key] == theirs[key]).all(), (index, key)
        assert ours["task"] == theirs["task"]


@pytest.mark.parametrize("video", [True, False], ids=["video", "images"])
def test_shards_join_into_the_whole_with_lerobots_merge(tmp_path: Path, video: bool):
    roots = [tmp_path / f"part-{part}" for part in (1, 2)]
    for part, root in enumerate(roots, 1):
        build(root, shard=(part, 2), video=video)
    build(tmp_path / "whole", video=video)
    assert LeRobotDataset("local/x", root=roots[0]).meta.info.splits == {"train": "0:2"}
    run(
        "lerobot-edit-dataset",
        *("--operation.type=merge", "--new_repo_id=local/x", f"--new_root={tmp_path / 'merged'}"),
        *("--operation.repo_ids=['local/1','local/2']", f"--operation.roots={[str(root) for root in roots]}"),
    )
    merged, whole = (LeRobotDataset("local/x", root=tmp_path / name) for name in ("merged", "whole"))
    assert len(merged) == len(whole)
    for index in range(len(whole)):
        ours, theirs = merged[index], whole[index]
        assert ours.keys() == theirs.keys()
        for key in ours:
            assert np.all(np.asarray(ours[key]) == np.asarray(theirs[key])), (index, key)


@pytest.mark.parametrize("shard", ["0/2", "3/2", "2", "a/b", "1/", "-1/2"])
def test_a_shard_that_is_none_is_refused(shard: str):
    with pytest.raises(ValueError, match=r"--shard must be i/n .* such as 2/4"):
        _shard(shard)


def test_a_build_survives_the_death_of_its_processes(tmp_path: Path):
    """First workers are killed, then the command itself; the third run ends as an unbroken one does."""
    root = tmp_path / "data"
    command = [Path(sys.executable).parent / COMMAND[0], *COMMAND[1:], f"--root={root}", "--workers=2"]
    made = tmp_path / "data.unfinished/takes"

    def start_and_wait_for(pattern: str, count: int) -> tuple[subprocess.Popen[str], list[psutil.Process]]:
        job = subprocess.Popen(
            command, env=ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        while len(list(made.glob(pattern))) < count:
            assert job.poll() is None, "the build ended before anything could be killed"
            time.sleep(0.02)
        return job, psutil.Process(job.pid).children(recursive=True)

    job, children = start_and_wait_for("*.partial", 1)
    workers = [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    assert len(workers) == 2
    for worker in workers:
        worker.send_signal(signal.SIGKILL)
    output, _ = job.communicate(timeout=120)
    assert job.returncode == 1
    assert "a worker process died while making episode" in output.splitlines()[-1]
    assert "Traceback" not in output

    job, children = start_and_wait_for("[0-9]????", 1)
    job.kill()
    job.communicate()
    gone, alive = psutil.wait_procs(children, timeout=60)
    assert not alive
    assert len(gone) >= 2
    assert not root.exists()

    run(*COMMAND, f"--root={root}", "--workers=1")
    same = _demonstrations(DatasetConfig(objects="claeo", arrangements=1))
    build(tmp_path / "unbroken", same, keep_failures=False, shard=(1, 3))
    assert tables(root) == tables(tmp_path / "unbroken")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "unbroken"]
