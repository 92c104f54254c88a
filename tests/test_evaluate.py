# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-evaluate`: a policy that knows all, a tiny checkpoint through the command, and errors."""

import json
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from lerobot.datasets import LeRobotDataset

from commands import run
from lerobot_owlxt5.commands.parser import spoken
from lerobot_owlxt5.commands.prompts import MODES
from lerobot_owlxt5.data.windows import recover_actions
from lerobot_owlxt5.evaluation.cli import (
    EvaluateConfig,
    choose_episodes,
    has_other_movements,
    main,
    open_dataset,
)
from lerobot_owlxt5.evaluation.report import Row
from lerobot_owlxt5.evaluation.scoring import accepted_descriptions, score_policy
from lerobot_owlxt5.processor_owlxt5 import make_owlxt5_pre_post_processors
from policy_helpers import HORIZON, make_config, make_dataset, make_owlv2, make_policy, make_t5

pytestmark = pytest.mark.slow  # starts commands

AS_TRAINED = {
    "execute": ["dataset"],
    "repeat action": ["dataset"],
    "describe": ["dataset"],
    "translate": ["vs. T5 alone", "vs. dataset"],
    "T5 alone": ["vs. dataset"],
}
REWORDED = AS_TRAINED | {
    "execute": ["dataset", "synonyms", "polite", "typos"],
    "describe": ["dataset", "synonyms", "full names", "typos"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of seven episodes, the last three of them a test split, and a tiny checkpoint."""
    folder = tmp_path_factory.mktemp("evaluate")
    dataset = make_dataset(folder / "data", episodes=7)
    info = folder / "data" / "meta" / "info.json"
    info.write_text(json.dumps(json.loads(info.read_text()) | {"splits": {"train": "0:4", "test": "4:7"}}))
    policy = make_policy(make_t5(folder / "t5", folder / "data"), tasks=list(dataset.meta.tasks.index))
    policy.save_pretrained(folder / "checkpoint")
    for processor in make_owlxt5_pre_post_processors(policy.config, dataset.meta.stats):
        processor.save_pretrained(folder / "checkpoint")
    return folder


def arguments(folder: Path, **options: Any) -> list[str]:
    """The command's options; dots are written as two underscores."""
    chosen = {
        "policy.path": folder / "checkpoint",
        "dataset.repo_id": "test/synthetic",
        "dataset.root": folder / "data",
        "output_dir": folder / "results",
    } | {key.replace("__", "."): value for key, value in options.items()}
    return [f"--{key}={value}" for key, value in chosen.items() if value is not None]


def evaluate(folder: Path, **options: Any) -> tuple[dict[str, Any], str]:
    output = run("python", "-m", "lerobot_owlxt5.evaluation.cli", *arguments(folder, **options))
    results = Path(options.get("output_dir", folder / "results"))
    assert output.splitlines()[-1] == f"Results: {results / 'results.json'} and {results / 'results.md'}"
    return json.loads((results / "results.json").read_text()), output


def variants(report: dict[str, Any]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for row in report["rows"]:
        found.setdefault(row["mode"], []).append(row["variant"])
    return found


def test_the_command_reports_all_modes(folder: Path) -> None:
    report, output = evaluate(folder)
    assert variants(report) == AS_TRAINED
    assert (report["policy"], report["split"], report["episodes"]) == ("owlxt5", "test", 3)
    assert "an upper bound" in report["detector"]
    assert report["language model"] == f"{folder / 't5'} (frozen)"
    for text in (output, (folder / "results" / "results.md").read_text()):
        assert "ground_truth (the simulator's own boxes: an upper bound" in text
        assert f"checkpoint: {folder / 'checkpoint'}" in text
        assert "NRMSE %" in text
    for row in report["rows"]:
        for figure in (value for value in row.values() if isinstance(value, dict)):
            assert 0 <= figure["low"] <= figure["value"] <= figure["high"]


def test_data_of_another_source_is_named(folder: Path) -> None:
    dataset = load(folder)
    stats = dataset.meta.stats
    _, same = make_owlxt5_pre_post_processors(make_config(folder / "t5"), stats)
    assert not has_other_movements(same, dataset)
    moving = int((stats["action"]["max"] - stats["action"]["min"]).argmax())
    for share, expected in ((0.03, False), (0.07, True)):
        other = {key: {name: np.array(value) for name, value in each.items()} for key, each in stats.items()}
        width = stats["action"]["max"][moving] - stats["action"]["min"][moving]
        other["action"]["max"][moving] += share * width
        _, postprocessor = make_owlxt5_pre_post_processors(make_config(folder / "t5"), other)
        assert has_other_movements(postprocessor, dataset) is expected


def test_a_mode_that_was_never_trained_is_left_out(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder / "checkpoint", tmp_path / "checkpoint")
    file = tmp_path / "checkpoint" / "config.json"
    config = json.loads(file.read_text()) | {"trained_modes": ["execute", "describe"]}
    file.write_text(json.dumps(config))
    report, _ = evaluate(folder, policy__path=tmp_path / "checkpoint", output_dir=tmp_path / "results")
    assert list(variants(report)) == ["execute", "describe"]
    assert report["modes"] == "execute, describe"


def test_other_words_another_detector_and_the_same_seed(folder: Path, tmp_path: Path) -> None:
    owlv2 = make_owlv2(tmp_path / "owlv2")
    options = {"robustness": "true", "split": "all", "policy__detector": owlv2, "seed": 7}
    report, _ = evaluate(folder, output_dir=tmp_path / "one", **options)
    assert variants(report) == REWORDED
    assert report["detector"] == str(owlv2)
    assert report["episodes"] == 7
    # Neither chance nor the size of a batch is in it.
    again, _ = evaluate(folder, output_dir=tmp_path / "two", batch_size=2, **options)
    for row, other in zip(report["rows"], again["rows"], strict=True):
        assert row.keys() == other.keys()
        for key in row:
            assert row[key] == pytest.approx(other[key], abs=1e-3), (row["mode"], row["variant"], key)


# A policy that knows all ------------------------------------------------------------------------------------


SCALE = 200.0


class Oracle:
    """Has the policies' public methods and knows the right answers, to the dataset's own words alone."""

    def __init__(self, dataset: LeRobotDataset) -> None:
        self.config = SimpleNamespace(max_text_tokens=8, modes=MODES, was_trained_in=lambda mode: True)
        self.visual = SimpleNamespace(names_objects=True)
        self.model = SimpleNamespace(
            language=SimpleNamespace(
                encode=lambda prompts, device: (prompts, None),
                generate=lambda prompts, mask, tokens: [f"Deutsch {prompt}" for prompt in prompts],
            )
        )
        items = [item for item in dataset if item["frame_index"] == 0]
        self.plans = {
            (item["task"], item["observation.objects"][0].numpy().tobytes()): recover_actions(
                item["action"][None], item["action_is_pad"][None]
            )[0][0]
            for item in items
        }

    def predict_action_chunk(self, batch: dict[str, Any]) -> torch.Tensor:
        assert not {"action", "episode_index"} & batch.keys()  # what a robot cannot know
        seen = zip(batch["task"], batch["observation.objects"], batch["observation.state"], strict=True)
        plans = [
            self.plans.get((task, objects.numpy().tobytes()), SCALE * pose.expand(HORIZON, -1)) / SCALE
            for task, objects, pose in seen
        ]
        return torch.stack(plans)

    def repeat_action(self, batch: dict[str, Any]) -> torch.Tensor:
        return recover_actions(batch["action"], batch["action_is_pad"])[0]

    def describe(self, batch: dict[str, Any], labels: list[str]) -> list[str]:
        return [spoken(task) for task in batch["task"]]

    def repeat_language(self, sentences: list[str], batch: dict[str, Any]) -> list[str]:
        return sentences

    def translate(self, sentences: list[str], batch: dict[str, Any]) -> list[str]:
        return [f"Deutsch Translate English to German: {sentence}" for sentence in sentences]


@pytest.fixture(scope="module")
def rows(folder: Path) -> dict[tuple[str, str], Row]:
    dataset = load(folder)
    # Scaled to [-1, 1], roughly, as a preprocessor does it.
    scaled = {"observation.state", "action"}
    scores = score_policy(
        Oracle(dataset),
        lambda batch: {key: value / SCALE if key in scaled else value for key, value in batch.items()},
        lambda actions: actions * SCALE,
        dataset,
        batch_size=2,
        robustness=True,
        seed=0,
    )
    return {(row.mode, row.variant): row for row in scores.rows(joint_range=200.0, seed=0)}


def load(folder: Path) -> LeRobotDataset:
    options = SimpleNamespace(
        repo_id="test/synthetic", root=folder / "data", revision=None, episodes=None, video_backend=None
    )
    config = EvaluateConfig(options, split="test")  # type: ignore[arg-type]
    return open_dataset(config, make_config(folder / "t5"))


def values(row: Row) -> dict[str, float]:
    return {name: round(figure.value, 3) for name, figure in row.figures.items()}


def test_who_knows_all_has_full_marks(rows: dict[tuple[str, str], Row]) -> None:
    full = {"bleu2": 100.0, "accuracy": 100.0}
    # The datasets hold the last pose once, and so a perfect copy is still one step early.
    assert values(rows["execute", "dataset"]) == {"nrmse": 0.0, "refused": 0.0, "steps_off": 1.0}
    assert values(rows["repeat action", "dataset"]) == {"nrmse": 0.0, "steps_off": 1.0}
    assert values(rows["describe", "dataset"]) == {**full, "refused": 0.0}
    assert values(rows["repeat language", "dataset"]) == full
    assert values(rows["translate", "vs. T5 alone"]) == full
    assert values(rows["translate", "vs. dataset"]) == values(rows["T5 alone", "vs. dataset"])
    assert values(rows["translate", "vs. dataset"])["accuracy"] == 0.0


def test_what_is_refused_is_counted(rows: dict[tuple[str, str], Row]) -> None:
    for variant in ("synonyms", "polite", "typos"):
        figures = rows["execute", variant].figures
        assert figures["refused"].value == 100
        assert figures["nrmse"].value > 1
        assert "steps_off" not in figures


def test_the_task_is_accepted_with_the_name_that_the_detector_looks_for() -> None:
    accepted = accepted_descriptions(["push red", "move-up red"], "the red cube")
    assert accepted[:2] == ["push red", "move up red"]
    assert {"push the red cube", "move up the red cube", "push red cube"} <= set(accepted)


def test_describe_sees_the_last_frame(folder: Path) -> None:
    dataset = load(folder)
    assert dataset.tolerance_s == 0.05, "half a frame"
    item = dataset[0]
    assert item["observation.state"].shape == (2, 10)
    assert torch.equal(item["observation.state"][1], item["action"][-1])
    assert item["action"].shape == (2 * HORIZON - 1, 10)


# Errors -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("splits", "split", "among", "expected"),
    [
        ({"train": "0:4", "test": "4:6"}, "test", None, [4, 5]),
        ({"train": "0:4", "test": "4:6"}, "all", [5, 1], [1, 5]),
        ({}, "all", None, [0, 1, 2, 3, 4, 5]),
        ({"train": "0:6"}, "test", None, "no split 'test'; choose --split=all or --split=train"),
        (None, "test", None, "no split 'test'; choose --split=all"),
        ({"test": "4:6"}, "test", [1], "no episode is left"),
        ({"test": "4:7"}, "test", None, "--split=test of me/data is 4:7, but the dataset has 6 episodes"),
        ({"test": "4:6"}, "test", [4, 6], "episode 6, but me/data has 6 episodes"),
    ],
)
def test_episodes_of_a_split(
    splits: dict[str, str] | None, split: str, among: list[int] | None, expected: list[int] | str
) -> None:
    meta: Any = SimpleNamespace(repo_id="me/data", total_episodes=6, info=SimpleNamespace(splits=splits))
    if isinstance(expected, list):
        assert choose_episodes(meta, split, among) == expected
    else:
        with pytest.raises(ValueError, match=expected):
            choose_episodes(meta, split, among)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"policy__path": None}, "--policy.path"),
        ({"policy__path": "/nowhere"}, "/nowhere"),
        ({"split": "validation"}, "--split=train or --split=test"),
        ({"dataset__root": "/nowhere"}, "--dataset.root=/nowhere holds no LeRobotDataset"),
        ({"policy__max_episode_steps": 11}, "--policy.max_episode_steps=12"),
        ({"batch_size": 0}, "--batch_size"),
        ({"batch_size": "null"}, "--batch_size needs a value"),
        ({"seed": -1}, "--seed must not be negative"),
        ({"policy__path": "{act}"}, "'act', which has not the modes"),
    ],
)
def test_mistakes_end_in_one_message(
    folder: Path, monkeypatch: pytest.MonkeyPatch, options: dict[str, Any], message: str
) -> None:
    act = folder / "act"
    act.mkdir(exist_ok=True)
    (act / "config.json").write_text('{"type": "act"}')
    given = [each.format(act=act) for each in arguments(folder, **options)]
    monkeypatch.setattr(sys, "argv", ["owlxt5-evaluate", *given])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert str(stopped.value).startswith("owlxt5-evaluate: ")
    assert message in str(stopped.value)
