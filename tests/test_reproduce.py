# SPDX-License-Identifier: Apache-2.0
"""`make reproduce`: its plan, how it goes on, and what its report says."""

import importlib
import json
import re
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import draccus
import pytest
import yaml
from lerobot.configs.eval import EvalPipelineConfig
from lerobot.configs.train import TrainPipelineConfig
from rich.console import Console

from clant_claeo.cli import DatasetConfig
from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config
from lerobot_owlxt5.evaluation.cli import EvaluateConfig
from nico_tabletop.tasks import ACTIONS
from reproduce.plan import Plan, Setting, Step, read_plan, read_sizes, write_setting
from reproduce.record import is_whole, read_record, write_record
from reproduce.report import NO_MATPLOTLIB, write_report
from reproduce.results import Column, Share, backbones_of, column_of, read_cells, read_measurements
from reproduce.run import RunError, next_command, run, time_left

ROOT = Path(__file__).parents[1]
PROGRAMS = {"owlxt5-dataset", "lerobot-train", "lerobot-eval", "owlxt5-evaluate", "python"}


def make_plan(folder: Path, *commands: str, setting: Setting | None = None) -> Plan:
    """A plan whose steps are called a, b, c …, in a folder of its own."""
    steps = [{"name": name, "command": command} for name, command in zip("abcdef", commands, strict=False)]
    content = {"sizes": {"tiny": {"about": "A tiny size."}}, "steps": steps}
    (folder / "plan.yaml").write_text(yaml.safe_dump(content))
    return read_plan("tiny", folder / "plan.yaml", setting=setting, outputs=folder / "outputs")


QUIET = Console(quiet=True)


@pytest.mark.parametrize("size", read_sizes())
def test_each_step_reads_what_an_earlier_one_writes(size: str) -> None:
    plan = read_plan(size, setting=Setting())
    known = set[str]()
    for step in plan.steps:
        assert {*step.inputs} <= known
        assert str(step.output) in step.command
        assert step.command.split()[0] in PROGRAMS
        assert "{" not in step.command
        known.add(step.name)
    assert {step.measures for step in plan.steps} == {"", "outcomes", "modes", "cells"}
    assert sum(step.seconds for step in plan.steps) < (3600 if size == "quick" else float("inf"))


def options_of(step: Step) -> dict[str, str]:
    """The options of a command by name, with one episode in place of bash's sequences."""
    words = shlex.split(re.sub(r"\[[^]]*\]", "[0]", step.command))
    return dict(word[2:].split("=", 1) for word in words if word.startswith("--"))


@pytest.mark.slow
@pytest.mark.parametrize("size", read_sizes())
def test_the_commands_have_these_options(size: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    classes = {
        "lerobot-train": TrainPipelineConfig,
        "lerobot-eval": EvalPipelineConfig,
        "owlxt5-dataset": DatasetConfig,
        "owlxt5-evaluate": EvaluateConfig,
        "python": read_class("robustness", "RobustnessConfig", monkeypatch),
    }
    by_template = {step.template: step for step in read_plan(size, setting=Setting()).steps}
    for step in by_template.values():
        options, of_policy = options_of(step), dict[str, str]()
        if options.pop("policy.path", None):  # LeRobot reads these itself
            of_policy = {name: value for name, value in options.items() if name.startswith("policy.")}
            options = {name: value for name, value in options.items() if name not in of_policy}
        recipe = options.pop("config_path", None)
        arguments = [f"--{name}={value}" for name, value in options.items()]
        draccus.parse(classes[step.command.split()[0]], config_path=recipe, args=arguments)
        assert {name.removeprefix("policy.") for name in of_policy} <= {*vars(OWLxT5Config(device="cpu"))}


def read_class(module: str, name: str, monkeypatch: pytest.MonkeyPatch) -> type:
    """A class of a benchmark."""
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    try:
        found: type = getattr(importlib.import_module(module), name)
    finally:
        sys.modules.pop(module, None)
    return found


def test_a_step_that_reads_what_nobody_writes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no earlier step of the plan writes: missing"):
        make_plan(tmp_path, "cat {folder}/missing/file > {output}")
    with pytest.raises(ValueError, match="has no 'seed'"):
        make_plan(tmp_path, "echo {seed}")
    with pytest.raises(ValueError, match="choose one of tiny"):
        read_plan("huge", tmp_path / "plan.yaml")


@pytest.mark.slow
@pytest.mark.parametrize("source", ["scripted", "release"])
def test_twelve_demonstrations_are_one_of_each_action(source: str, request: pytest.FixtureRequest) -> None:
    from clant_claeo.cli import _demonstrations

    folder = str(request.getfixturevalue("clant_dir")) if source == "release" else source
    training = [
        each
        for each in _demonstrations(DatasetConfig(source=folder, arrangements=4))
        if each.split == "train"
    ]
    content = yaml.safe_load((ROOT / "reproduce" / "plan.yaml").read_text(encoding="utf-8"))
    chosen = [int(index) for index in content["demonstrations"][0]["episodes"].split(",")]
    assert {training[index].action for index in chosen} == {*ACTIONS}
    assert len(training) == 36


def test_what_was_changed_is_not_whole_any_more(tmp_path: Path) -> None:
    plan = make_plan(tmp_path, "echo 1 > {output}", "cat {folder}/a > {output}", "echo 3 > {output}")
    plan.folder.mkdir(parents=True)
    for step in plan.steps:
        step.output.write_text("there")
        write_record(plan, step, 1.0, whole=True)
    changed = make_plan(tmp_path, "echo 2 > {output}", "cat {folder}/a > {output}", "echo 3 > {output}")
    assert [is_whole(plan, step) for step in plan.steps] == [True, True, True]
    assert [is_whole(changed, step) for step in changed.steps] == [False, False, True]
    plan.steps[2].output.unlink()
    assert not is_whole(plan, plan.steps[2])


def test_a_step_depends_on_the_files_that_its_command_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("reproduce.plan.ROOT", tmp_path)
    named = ["configs/small.yaml", "benchmarks/robustness.py", "benchmarks/cells.py", "benchmarks/rollout.py"]
    for name in named:
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text("before")

    def digests() -> list[str]:
        commands = [
            "lerobot-train --config_path=configs/small.yaml --output_dir={output}",
            "python benchmarks/robustness.py --results={output}/cells.jsonl",
            "cat {folder}/a > {output}",
            "echo configs {output}",
        ]
        return [step.digest for step in make_plan(tmp_path, *commands).steps]

    for name in named:
        before = digests()
        (tmp_path / name).write_text("after")
        changed = [old != new for old, new in zip(before, digests(), strict=True)]
        of_recipe = name == "configs/small.yaml"
        assert changed == [of_recipe, not of_recipe, of_recipe, False]


def test_a_training_goes_on_from_its_checkpoint_and_nothing_else_does(tmp_path: Path) -> None:
    commands = [
        "lerobot-train --output_dir={output}",
        "owlxt5-dataset --root={output}/data",
        "lerobot-eval --output_dir={output}",
    ]
    plan = make_plan(tmp_path, *commands)
    training, dataset, evaluation = plan.steps
    assert [next_command(plan, step) for step in plan.steps] == [None, None, None]
    for step in plan.steps:
        write_record(plan, step, 1.0, whole=False)
    assert next_command(plan, training) is None  # it was interrupted before its first checkpoint
    checkpoint = training.output / "checkpoints" / "last" / "pretrained_model" / "train_config.json"
    checkpoint.parent.mkdir(parents=True)
    checkpoint.write_text("{}")
    assert next_command(plan, training) == f"lerobot-train --config_path={checkpoint} --resume=true"
    assert next_command(plan, dataset) is None  # its folder is gone
    dataset.output.mkdir()
    assert next_command(plan, dataset) == dataset.command
    assert next_command(plan, evaluation) is None
    other = make_plan(tmp_path, commands[0] + " --steps=3")
    assert next_command(other, other.steps[0]) is None  # it is another training


def test_time_left_learns_from_what_was_measured(tmp_path: Path) -> None:
    steps = [{"name": "{kind}_{n}", "for": ["kind", "n"], "seconds": [0, 10, 1], "command": "{output}"}]
    steps.append({"name": "last", "seconds": [100, 0, 0], "command": "{output}"})
    lists = {"kind": ["a"], "n": [1, 2, 3]}
    content = {"sizes": {"tiny": {"about": "", "lists": lists}}, "steps": steps}
    (tmp_path / "plan.yaml").write_text(yaml.safe_dump(content))
    plan = read_plan("tiny", tmp_path / "plan.yaml", outputs=tmp_path)
    assert time_left(plan, {}) == 130
    last = 100 * (20 + 300) / (10 + 300)  # of another kind: most of five minutes went as planned
    assert time_left(plan, {"a_1": 20.0}) == pytest.approx(2 * 20 + last)
    assert time_left(plan, {"a_1": 20.0}, plan.steps[1], since=5.0) == pytest.approx(15 + 20 + last)
    assert time_left(plan, {"a_1": 20.0}, plan.steps[1], since=50.0) == pytest.approx(0 + 20 + last)


@pytest.mark.slow
def test_a_plan_is_run_and_only_what_changed_is_run_again(tmp_path: Path) -> None:
    commands = {
        "a": f"echo x >> {tmp_path}/runs_a && echo 1 > {{output}}",
        "b": f"echo x >> {tmp_path}/runs_b && cat {{folder}}/a > {{output}}",
    }

    def count(name: str) -> int:
        return len((tmp_path / f"runs_{name}").read_text().split())

    plan = make_plan(tmp_path, *commands.values())
    run(plan, QUIET)
    run(plan, QUIET)
    assert (count("a"), count("b")) == (1, 1)
    commands["b"] += " && true"
    run(make_plan(tmp_path, *commands.values()), QUIET)
    assert (count("a"), count("b")) == (1, 2)
    commands["a"] += " && true"
    run(make_plan(tmp_path, *commands.values()), QUIET)
    assert (count("a"), count("b")) == (2, 3)


@pytest.mark.slow
def test_what_reads_from_a_step_that_began_anew_is_run_again(tmp_path: Path) -> None:
    commands = ["date +%N > {output}", "cat {folder}/a > {output}", "cat {folder}/b > {output}"]
    plan = make_plan(tmp_path, *commands, "date +%N > {output}")
    run(plan, QUIET)
    first, _, third, other = plan.steps
    untouched = other.output.read_text()
    first.output.unlink()
    run(plan, QUIET)
    assert third.output.read_text() == first.output.read_text()
    assert other.output.read_text() == untouched


@pytest.mark.slow
def test_a_dataset_that_is_there_is_whole(tmp_path: Path) -> None:
    plan = make_plan(tmp_path, "owlxt5-dataset --root={output}/data")
    [step] = plan.steps
    for folder in ("data", "data.unfinished"):
        (step.output / folder).mkdir(parents=True)
    write_record(plan, step, 1.0, whole=False)  # the run ended, and its command after it
    run(plan, QUIET)
    assert is_whole(plan, step)
    assert [each.name for each in step.output.iterdir()] == ["data"]


@pytest.mark.slow
def test_a_forgotten_variable_throws_nothing_away(tmp_path: Path) -> None:
    release = Setting("release")
    with pytest.raises(RunError, match="steps are missing"):
        run(make_plan(tmp_path, "false {output}", setting=Setting()), QUIET)
    plan = make_plan(tmp_path, "echo {source} > {output}", setting=release)  # nothing was whole
    run(plan, QUIET)
    forgotten = make_plan(tmp_path, "echo {source} > {output}", setting=Setting())
    with pytest.raises(RunError, match="source release and device cpu, but they are now scripted and cpu"):
        run(forgotten, QUIET)
    assert plan.steps[0].output.read_text() == "release\n"
    assert make_plan(tmp_path, "echo {source} > {output}").setting == release
    shutil.rmtree(plan.folder)
    run(forgotten, QUIET)
    assert plan.steps[0].output.read_text() == "scripted\n"


def test_a_size_that_names_its_device_does_not_depend_on_the_machine() -> None:
    assert read_plan("quick", setting=Setting(device="cuda")) == read_plan("quick", setting=Setting())
    assert read_plan("full", setting=Setting(device="cuda")).setting.device == "cuda"


@pytest.mark.slow
def test_a_step_that_fails_leaves_out_only_those_that_need_it(tmp_path: Path) -> None:
    plan = make_plan(
        tmp_path, "echo broken; exit 3", "cat {folder}/a > {output}", "echo 3 > {output}", "true {output}"
    )
    with pytest.raises(RunError, match=r"3 of 4 steps are missing, first of all a: see .*/logs/a\.log"):
        run(plan, QUIET)
    assert [is_whole(plan, step) for step in plan.steps] == [False, False, True, False]
    assert (plan.folder / "logs" / "a.log").read_text() == "broken\n"


SCRIPT = """
import signal, sys
from pathlib import Path
from rich.console import Console
from reproduce.plan import read_plan
from reproduce.run import heed_signals, run
folder = Path(sys.argv[1])
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell in the background ignores it
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # and nohup this one
heed_signals()
run(read_plan("tiny", folder / "plan.yaml", outputs=folder / "outputs"), Console())
"""


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_it_goes_on_after_a_kill_in_the_middle(number: signal.Signals, tmp_path: Path) -> None:
    wait = (
        f"echo half > {{output}}; while [ ! -e {tmp_path}/go ]; do sleep 0.1; done; echo whole > {{output}}"
    )
    plan = make_plan(tmp_path, "date +%N > {output}", wait, "cat {folder}/b > {output}")
    first, second, third = plan.steps
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, tmp_path], cwd=ROOT)
    while not second.output.exists() or not second.output.read_text():
        time.sleep(0.05)
    with pytest.raises(RunError, match="another run, or a command that it started, still writes into"):
        run(plan, QUIET)
    made = first.output.read_text()
    process.send_signal(number)
    assert process.wait(30) != 0
    assert not is_whole(plan, second)
    assert read_record(plan, second) is not None
    (tmp_path / "go").touch()
    run(plan, QUIET)
    assert first.output.read_text() == made
    assert third.output.read_text() == "whole\n"


@pytest.mark.parametrize(
    ("backbones", "column"),
    [
        ({}, Column.NONE),
        (
            {"language_model": "embedded", "detector": "embedded", "understanding": "embedded"},
            Column.EMBEDDED,
        ),
        ({"language_model": "embedded", "detector": "embedded", "understanding": "none"}, Column.EMBEDDED),
        ({"language_model": "embedded", "detector": "ground_truth"}, Column.MIXED),
        ({"language_model": "google-t5/t5-small", "detector": "embedded"}, Column.MIXED),
        ({"language_model": "google-t5/t5-small", "understanding": "embedded"}, Column.MIXED),
        ({"language_model": "google-t5/t5-small, trained along", "understanding": "none"}, Column.MIXED),
        ({"language_model": "google-t5/t5-small", "understanding": "none"}, Column.HUB),
        ({"language_model": "google-t5/t5-small", "detector": "google/owlv2-base-patch16"}, Column.HUB),
    ],
)
def test_only_the_hubs_models_stand_in_the_hubs_column(backbones: dict[str, str], column: Column) -> None:
    assert column_of(backbones) is column


EMBEDDED = {"language_model": "embedded", "detector": "embedded", "understanding": "embedded"}
HUBS = {
    "language_model": "google-t5/t5-small",
    "detector": "google/owlv2-base-patch16",
    "understanding": "none",
}


@pytest.fixture
def outputs(tmp_path: Path) -> Path:
    """Where sizes write: absolute, so outside the repository."""
    return tmp_path / "outputs"


def plan_of(outputs: Path, size: str) -> Plan:
    plan = read_plan(size, setting=Setting(), outputs=outputs)
    write_setting(plan)
    return plan


def finish(plan: Plan, name: str, backbones: dict[str, str], **files: str) -> Step:
    """Leave what a measurement leaves, and the configuration of the checkpoint that it names."""
    [step] = [step for step in plan.steps if step.name == name]
    step.output.mkdir(parents=True)
    for file, content in files.items():
        (step.output / file.replace("__", ".")).write_text(content)
    for word in step.command.split():
        if word.startswith("--policy.path="):
            checkpoint = Path(word.partition("=")[2])
            checkpoint.mkdir(parents=True, exist_ok=True)
            (checkpoint / "config.json").write_text(json.dumps(backbones))
    write_record(plan, step, 1.0, whole=True)
    return step


def eval_info(objects: str, rewards: Iterable[float]) -> str:
    metrics = {"sum_rewards": [*rewards], "video_paths": []}
    return json.dumps({"per_task": [{"task_group": objects, "task_id": 0, "metrics": metrics}]})


def results_json(mode: str, variant: str, key: str, value: float) -> str:
    row: dict[str, Any] = {"mode": mode, "variant": variant}
    row[key] = {"value": value, "low": value - 1, "high": value + 1}
    return json.dumps({"episodes": 12, "rows": [row]})


def write(outputs: Path, size: str) -> str:
    page = outputs / "docs" / "results.md"
    write_report(size, QUIET, page, outputs=outputs)
    return page.read_text(encoding="utf-8")


def section(text: str, title: str) -> str:
    return text.partition(f"\n## {title}")[2].partition("\n## ")[0]


def rows(text: str) -> list[list[str]]:
    """Cells of the lines of a table, without its heading."""
    lines = [line for line in text.splitlines() if line.startswith("| ")]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines][2:]


def test_a_report_of_nothing_says_what_to_run(outputs: Path) -> None:
    text = write(outputs, "quick")
    assert "few demonstrations" in text.partition("## What differs")[0]
    assert "CoppeliaSim" in text.partition("## Table 1")[0]
    for row in rows(section(text, "Table 1")):
        assert row[3] == row[6] == "not run: `make reproduce SIZE=hub`"
        assert row[4] == row[7] == "not run: `make reproduce SIZE=quick`"
    efficiency = rows(section(text, "Data efficiency"))
    for rival in ("act", "early_fusion"):
        row = next(row for row in efficiency if row[1].startswith(rival))
        assert {*row[2:]} == {"not run: `make reproduce SIZE=full`"}
    owlxt5 = next(row for row in efficiency if row[:2] == ["clant", "OWLxT5, embedded backbones, or none"])
    assert [cell[-6:-1] for cell in owlxt5[2:]] == ["quick", "=full", "quick", "=full", "=full"]
    ablations = rows(section(text, "Ablations"))
    assert {cell[-6:-1] for row in ablations[:2] for cell in row[2:]} == {"quick"}
    assert {cell for row in ablations[2:] for cell in row[2:]} == {"not run: `make reproduce SIZE=full`"}
    assert ablations[-1][1] == "no made-up names in training"
    assert "not run" in section(text, "Perturbations")
    assert "lerobot-train" in section(text, "What these commands need")
    assert str(Path.home()) not in text


def test_a_report_says_what_its_size_is(outputs: Path) -> None:
    for size in read_sizes():
        about = read_plan(size, outputs=outputs).about
        assert about in write(outputs, size).partition("## What differs")[0]


def test_figures_stand_in_the_column_of_their_models(outputs: Path) -> None:
    quick, hub = plan_of(outputs, "quick"), plan_of(outputs, "hub")
    bleu = results_json("describe", "dataset", "bleu2", 12.5)
    finish(quick, "modes_owlxt5_108_seed1_clant", EMBEDDED, results__json=bleu)
    finish(hub, "modes_owlxt5_1080_seed1_clant", HUBS, results__json=bleu.replace("12.5", "77.25"))
    info = eval_info("clant", [1.0, 1.0, 0.5, 0.0])
    finish(quick, "eval_owlxt5_108_seed1_clant", EMBEDDED, eval_info__json=info)
    finish(quick, "eval_owlxt5_12_seed1_clant", EMBEDDED, eval_info__json=eval_info("clant", [0.0, 0.5]))
    text = write(outputs, "quick")
    table = rows(section(text, "Table 1"))
    [describe] = [row for row in table if row[:2] == ["describe, BLEU-2", "clant"]]
    assert describe[5:] == [
        "100.00 % (table 1)",
        "77.25 % (11.50 to 13.50), n 12",
        "12.50 % (11.50 to 13.50), n 12",
    ]
    assert describe[2] == "100.00 % (table 1)"
    assert describe[3].startswith("not run")
    [outcome] = [row for row in rows(section(text, "Figure 3")) if row[:2] == ["OWLxT5", "clant"]]
    assert outcome[2] == "not run: `make reproduce SIZE=hub`"
    assert outcome[3].startswith("perfect 50.0 % (15.0 to 85.0), n 4; perfect or successful 75.0 %")
    efficiency = rows(section(text, "Data efficiency"))
    [curve] = [row for row in efficiency if row[:2] == ["clant", "OWLxT5, embedded backbones"]]
    assert curve[2].startswith("50.0 %")
    assert curve[2].endswith("n 2")
    assert curve[3] == "not run: `make reproduce SIZE=full`"
    assert curve[4].startswith("75.0 %")
    made = section(text, "Figure 3")
    assert "- seeds: 1" in made
    assert "language_model embedded, detector embedded" in made
    assert "mujoco" in made


def test_embedded_backbones_never_stand_in_the_hubs_column(outputs: Path) -> None:
    hub = plan_of(outputs, "hub")  # somebody has edited the plan's models
    info = eval_info("claeo", [1.0])
    finish(hub, "eval_owlxt5_1080_seed1_claeo", EMBEDDED, eval_info__json=info)
    finish(hub, "eval_crosst5_1080_seed1_claeo", {"language_model": "embedded"}, eval_info__json=info)
    for size in ("quick", "full", "hub"):
        for row in rows(section(write(outputs, size), "Figure 3")):
            assert "perfect" not in row[2]


def test_an_option_of_the_measurement_wins_over_the_checkpoint(outputs: Path) -> None:
    quick = plan_of(outputs, "quick")
    info = eval_info("clant", [1.0, 1.0])
    step = finish(quick, "ablation_ground_truth_seed1_clant", EMBEDDED, eval_info__json=info)
    assert backbones_of(step)["detector"] == "ground_truth"
    [measured] = read_measurements(quick)
    assert measured.column is Column.MIXED
    text = write(outputs, "quick")
    ablation = [row for row in rows(section(text, "Ablations")) if row[1].startswith("the simulator's")]
    assert ablation[0][2].startswith("perfect 100.0 %")
    assert "perfect 100.0 %" not in section(text, "Figure 3")
    library = next(step for step in quick.steps if step.policy == "motion_library")
    assert column_of(backbones_of(library)) is Column.EMBEDDED


def test_a_measurement_whose_checkpoint_is_gone_counts_as_not_run(outputs: Path) -> None:
    quick = plan_of(outputs, "quick")
    finish(quick, "eval_owlxt5_108_seed1_clant", EMBEDDED, eval_info__json=eval_info("clant", [1.0]))
    assert len(read_measurements(quick)) == 1
    shutil.rmtree(quick.folder / "owlxt5_108_seed1")
    assert read_measurements(quick) == []
    assert "perfect 100.0 %" not in write(outputs, "quick")


def test_an_episode_of_several_commands_is_right_if_all_are(outputs: Path) -> None:
    quick = plan_of(outputs, "quick")
    lines = [
        {
            "cell": "three",
            "episodes": [[{"reward": 1.0}, {"reward": 0.0}], [{"reward": 1.0}, {"reward": 0.5}]],
        },
        {"cell": "dark", "episodes": [[{"reward": 0.5}]]},
    ]
    cells = "\n".join(map(json.dumps, lines))
    finish(quick, "cells_owlxt5_108_seed1_claeo", EMBEDDED, cells__jsonl=cells)
    assert read_cells(read_measurements(quick)) == {"three": Share(1, 2), "dark": Share(1, 1)}
    text = section(write(outputs, "quick"), "Perturbations")
    assert rows(text)[0][:2] == ["`three`", "50.0 % (9.5 to 90.5), n 2"]


def test_seeds_are_pooled_or_averaged(outputs: Path) -> None:
    full = plan_of(outputs, "full")
    for seed, value in (("1", 10.0), ("2", 30.0)):
        finish(
            full,
            f"modes_owlxt5_1080_seed{seed}_clant",
            EMBEDDED,
            results__json=results_json("execute", "dataset", "nrmse", value),
        )
        info = eval_info("clant", [1.0] if seed == "1" else [0.0, 0.0, 0.0])
        finish(full, f"eval_owlxt5_1080_seed{seed}_clant", EMBEDDED, eval_info__json=info)
    text = write(outputs, "full")
    [nrmse] = [row for row in rows(section(text, "Table 1")) if row[:2] == ["execute, NRMSE", "clant"]]
    assert nrmse[7] == "20.00 % (10.00 to 30.00), 2 seeds, n 12"
    assert nrmse[5] == "not published"
    [outcome] = [row for row in rows(section(text, "Figure 3")) if row[:2] == ["OWLxT5", "clant"]]
    assert outcome[3].startswith("perfect 25.0 %")
    assert "- seeds: 1, 2" in text


def test_without_matplotlib_there_are_tables_and_a_sentence(
    outputs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    monkeypatch.delitem(sys.modules, "reproduce.pictures", raising=False)
    monkeypatch.delattr("reproduce.pictures", raising=False)  # a test before may have imported it
    text = write(outputs, "quick")
    assert NO_MATPLOTLIB in text
    assert "| figure |" in text


def test_what_was_measured_is_drawn(outputs: Path) -> None:
    pytest.importorskip("matplotlib")
    quick = plan_of(outputs, "quick")
    finish(quick, "eval_owlxt5_12_seed1_clant", EMBEDDED, eval_info__json=eval_info("clant", [0.0]))
    finish(quick, "eval_owlxt5_108_seed1_clant", EMBEDDED, eval_info__json=eval_info("clant", [1.0, 0.5]))
    finish(quick, "eval_motion_library_clant", {}, eval_info__json=eval_info("clant", [1.0]))
    cells = json.dumps({"cell": "dark", "episodes": [[{"reward": 0.5}]]})
    finish(quick, "cells_owlxt5_108_seed1_claeo", EMBEDDED, cells__jsonl=cells)
    text = write(outputs, "quick")
    for name in ("outcomes", "efficiency", "perturbations"):
        assert f"(images/results_{name}.png)" in text
        assert (outputs / "docs" / "images" / f"results_{name}.png").stat().st_size > 1000
