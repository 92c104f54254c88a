# SPDX-License-Identifier: Apache-2.0
"""What `nico_tabletop.report` makes of an evaluation."""

import json
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from black_images import black_images
from nico_tabletop import report
from nico_tabletop.configuration import ClaeoEnvConfig
from nico_tabletop.robot import INITIAL_POSE_DEG


@pytest.fixture(scope="module")
def evaluated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What lerobot-eval leaves of two episodes in which the robot holds still, and one of another action."""
    folder = tmp_path_factory.mktemp("evaluated")
    config = ClaeoEnvConfig(
        task="PUSH-L",
        objects="household",
        output_dir=str(folder),
        observation_height=48,
        observation_width=64,
    )
    (group, envs), *_ = config.create_envs(n_envs=2).items()
    done = [False]
    with black_images():
        envs[0].reset(seed=[7, 8])
        while not all(done):
            _, _, _, done, _ = envs[0].step(np.tile(INITIAL_POSE_DEG.astype(np.float32), (2, 1)))
    envs[0].close()
    write(folder, group, {"PUSH-L": [0.0, 0.0]}, ["outputs/there/videos/household_0/eval_episode_0.mp4"])
    video = folder / "videos" / "household_0" / "eval_episode_0.mp4"
    video.parent.mkdir(parents=True)
    with av.open(str(video), "w") as container:
        stream = container.add_stream("h264", rate=10, width=480, height=360, pix_fmt="yuv420p")
        container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((360, 480, 3), np.uint8))))
        container.mux(stream.encode())
    return folder


def write(folder: Path, group: str, rewards: dict[str, list[float]], videos: list[str]) -> None:
    tasks = [
        {"task_group": group, "task_id": 0, "metrics": {"sum_rewards": each, "video_paths": videos}}
        for each in rewards.values()
    ]
    (folder / "eval_info.json").write_text(json.dumps({"per_task": tasks}))


def run(monkeypatch: pytest.MonkeyPatch, capsys: Any, *paths: Path, image: Path) -> str:
    monkeypatch.setattr("sys.argv", ["report", *map(str, paths), f"--image={image}"])
    monkeypatch.setenv("COLUMNS", "200")
    report.main()
    return capsys.readouterr().out


def test_each_failure_has_its_objects_its_command_and_its_kind(
    evaluated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    image = tmp_path / "outcomes.png"
    text = run(monkeypatch, capsys, evaluated / "eval_info.json", image=image)
    lines = [line for line in text.splitlines() if line.startswith("household PUSH-L")]
    for seed, line in zip((7, 8), lines, strict=True):
        assert f"seed {seed}, “push " in line
        assert line.endswith("failure, refused")
    assert "?" not in text
    assert Image.open(image).size == (1280, 266)  # the video is found although it was written elsewhere


def test_a_record_of_another_run_is_not_believed(
    evaluated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "episodes.jsonl").write_text((evaluated / "episodes.jsonl").read_text())
    write(tmp_path, "household", {"PUSH-L": [0.0, 1.0]}, [])
    text = run(monkeypatch, capsys, tmp_path / "eval_info.json", image=tmp_path / "outcomes.png")
    assert "refused" not in text.split("┡")[1]
    assert "Why episodes failed (?) is not recorded: run lerobot-eval with --env.output_dir" in text
    assert "No image" in text


def test_two_evaluations_of_the_same_objects_are_both_reported(
    evaluated: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, "household", {"PUSH-L": [1.0, 1.0, 0.5]}, [])
    paths = evaluated / "eval_info.json", tmp_path / "eval_info.json"
    text = run(monkeypatch, capsys, *paths, image=tmp_path / "outcomes.png")
    totals = [line.split("│")[3].strip() for line in text.splitlines() if "│ all " in line]
    assert totals == ["2", "3"]


@pytest.mark.parametrize(
    "content", ["", "[]", '{"per_task": [{"task_id": 99, "metrics": {"sum_rewards": []}}]}']
)
def test_what_is_no_evaluation_is_named(
    content: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "eval_info.json"
    file.write_text(content)
    monkeypatch.setattr("sys.argv", ["report", str(file), f"--image={tmp_path / 'outcomes.png'}"])
    with pytest.raises(SystemExit, match=r"is no eval_info\.json of lerobot-eval"):
        report.main()
