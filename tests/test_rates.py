# SPDX-License-Identifier: Apache-2.0
"""Rates, intervals and the paired test, from hand-made records and from the environment's own."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from black_images import black_images
from nico_tabletop import report
from nico_tabletop.env import TabletopEnv
from nico_tabletop.rates import PairingError, Pairs, mcnemar, pair, rate, wilson
from nico_tabletop.record import Episode, add_episode, read_episodes
from nico_tabletop.robot import INITIAL_POSE_DEG
from nico_tabletop.tasks import ACTIONS, Action

SCENE = ("mug", "ball", "can")
RIGHT = Episode(0, "claeo", SCENE, "PUSH-L", "push mug", "perfect", "", 1.0, asked="PUSH-L")
REFUSED = replace(RIGHT, outcome="failure", failure="refused", reward=0.0)
MISSED = replace(REFUSED, failure="missed")
WRONG = replace(REFUSED, failure="moved wrongly")
ABSENT = replace(RIGHT, words="absent", task="push mustard bottle", asked=None)


def write(file: Path, *episodes: Episode) -> Path:
    for seed, episode in enumerate(episodes):
        add_episode(file, replace(episode, seed=seed))
    return file


def test_what_was_moved_and_what_refused() -> None:
    judged = [
        (each.moved_rightly, each.some_object_moved, each.refused)
        for each in (RIGHT, REFUSED, MISSED, WRONG, ABSENT)
    ]
    assert judged == [
        (True, True, False),
        (False, False, True),
        (False, False, False),
        (False, True, False),
        (False, False, True),
    ]
    assert not replace(MISSED, words="absent", asked=None).refused


def test_intervals_and_the_paired_test_have_known_values() -> None:
    for count, total in ((0, 10), (3, 10), (348, 360), (10, 10)):
        known = binomtest(count, total).proportion_ci(method="wilson")
        assert wilson(count, total) == pytest.approx((known.low, known.high))
    assert wilson(0, 0) == (0, 1)
    assert rate([True, False]) == "50.0% (9.5 to 90.5), n 2" and rate([]) == "-"
    assert mcnemar(1, 9) == pytest.approx(22 / 1024)  # 2 (1 + 10) / 2 ** 10
    for first, second in ((0, 0), (5, 5), (0, 6), (12, 3)):
        known = binomtest(first, first + second).pvalue if first + second else 1
        assert mcnemar(first, second) == mcnemar(second, first) == pytest.approx(known)


def test_a_report_of_a_record_has_rates_and_refusals(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    absent_wrong = replace(WRONG, words="absent", asked=None)
    file = write(tmp_path / "e.jsonl", RIGHT, RIGHT, REFUSED, WRONG, ABSENT, ABSENT, absent_wrong)
    monkeypatch.setattr("sys.argv", ["report", str(file)])
    monkeypatch.setenv("COLUMNS", "250")
    report.main()
    rows = {
        line.split("│")[2].strip(): [cell.strip().partition(" ")[0] for cell in line.split("│")[3:7]]
        + [line.split("│")[4].rpartition("n ")[2].strip()]
        for line in capsys.readouterr().out.splitlines()
        if "claeo, " in line
    }
    assert rows == {
        "claeo, canonical": ["50.0%", "75.0%", "-", "25.0%", "4"],
        "claeo, absent": ["-", "33.3%", "66.7%", "-", "3"],
    }


def test_two_files_are_compared_in_pairs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    first = write(tmp_path / "a.jsonl", *[RIGHT] * 9, WRONG, RIGHT, MISSED)
    second = write(tmp_path / "b.jsonl", *[MISSED] * 9, RIGHT, RIGHT, MISSED, RIGHT)
    one, other = list(read_episodes(first)), list(read_episodes(second))
    assert pair(one, other) == Pairs(both=1, only_first=9, only_second=1, neither=1)
    monkeypatch.setattr("sys.argv", ["report", str(first), str(second), "--compare"])
    monkeypatch.setenv("COLUMNS", "250")
    report.main()
    text = capsys.readouterr().out
    assert "12 pairs: both right 1, neither 1; McNemar's exact test: p = 0.0215" in text
    assert "Without a partner: 1 episodes" in text
    for changed, message in (
        ([replace(one[0], task="push ball")], "seed 0 of PUSH-L has other task in the two files"),
        ([one[0], one[0]], "seed 0 of PUSH-L stands twice"),
        ([replace(one[0], seed=None)], "has no seed"),
        ([replace(one[0], seed=99)], "no episode of one file"),
    ):
        with pytest.raises(PairingError, match=message):
            pair(changed, other)
    monkeypatch.setattr("sys.argv", ["report", str(first), "--compare"])
    with pytest.raises(SystemExit, match="--compare takes two files; got 1"):
        report.main()


def test_records_of_before_are_read_and_what_is_none_is_named(tmp_path: Path) -> None:
    old = {"seed": 3, "objects": "claeo", "arrangement": SCENE, "action": "PULL-M", "task": "pull ball"}
    file = tmp_path / "episodes.jsonl"
    file.write_text(
        json.dumps(old | {"outcome": "failure", "failure": "moved wrongly", "reward": 0.0}) + "\n"
    )
    [episode] = read_episodes(file)
    assert (episode.words, episode.asked, episode.distractors) == ("canonical", "PULL-M", ())
    assert episode.some_object_moved and not episode.moved_rightly and not episode.refused
    for wrong in ("[]", "{}", "push"):
        file.write_text(wrong)
        with pytest.raises(ValueError, match=r"line 1, is no episode that --env\.output_dir records"):
            list(read_episodes(file))


@pytest.mark.parametrize(
    ("words", "moves", "right"),
    [("canonical", False, False), ("absent", False, True), ("absent", True, False)],
)
def test_an_episode_is_judged_and_recorded_by_what_is_said(
    words: str, moves: bool, right: bool, tmp_path: Path
) -> None:
    file = tmp_path / "episodes.jsonl"
    env = TabletopEnv("PUSH-M", "claeo", 48, 64, words=words, distractors=2, episode_length=2, record=file)
    with black_images():
        _, start = env.reset(seed=5)
        names = [name for name, _ in start["distractors"]]
        for _ in range(2):
            *_, info = env.step((INITIAL_POSE_DEG + 3 * moves).astype(np.float32))
    assert info["is_success"] is right
    line = json.loads(file.read_text())
    assert (line["refused"], line["moved_rightly"], line["some_object_moved"]) == (not moves, False, False)
    [episode] = read_episodes(file)
    assert episode.right is right and [name for name, _ in episode.distractors] == names
    assert episode.task == env.task_description and episode.action == "PUSH-M"
    name = episode.task.removeprefix("push ")
    assert (name in (*start["arrangement"], *names)) == (words != "absent")
    env.close()


def test_a_seed_draws_the_same_scene_whatever_is_said() -> None:
    scenes = []
    with black_images():
        for words in ("canonical", "counterfactual", "polite", "absent"):
            env = TabletopEnv("SLIDE-R-L", "claeo", 48, 64, placement="free", words=words, distractors=1)
            _, info = env.reset(seed=11)
            _, again = env.reset(options=info)
            assert again["distractors"] == info["distractors"]
            scenes.append((info["arrangement"], info["poses"], info["conditions"], info["distractors"]))
            env.reset(seed=11)
            if words == "counterfactual":
                asked = env.command.action
                assert asked is not None and asked.slot != 2 and asked in ACTIONS
                assert env.task_description == f"slide-to-left {info['arrangement'][asked.slot]}"
                env.reset(options={"task": "push mug"})
                assert env.task_description == "push mug"
                assert env.command.action == Action(env.action.slot, ACTIONS[0].verb)
            env.close()
    assert all(scene == scenes[0] for scene in scenes)


def test_an_object_that_the_command_does_not_name_is_no_success() -> None:
    env = TabletopEnv("PUSH-M", "claeo", 48, 64, words="counterfactual", distractors=1, episode_length=1)
    outcomes = []
    with black_images():
        for named in (True, False):
            env.reset(seed=2)
            asked = env.command.action
            assert asked is not None
            slot = asked.slot if named else env.action.slot
            simulation = env.simulation
            simulation.data.joint(simulation.arrangement[slot]).qpos[0] += 0.05
            outcomes.append(env.step(INITIAL_POSE_DEG.astype(np.float32) + 5)[-1])
        env.reset(seed=2)
        simulation.data.joint(simulation.distractors[0].name).qpos[0] -= 0.02
        outcomes.append(env.step(INITIAL_POSE_DEG.astype(np.float32) + 5)[-1])
    assert [each["outcome"] for each in outcomes] == ["perfect", "failure", "failure"]
    assert [each.get("failure") for each in outcomes] == [None, "moved wrongly", "moved wrongly"]
    env.close()
