# SPDX-License-Identifier: Apache-2.0
"""Tests of the release reader, on a miniature release with faults put into it, and on the real one."""

import dataclasses
import re
import shutil
from collections import Counter
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from clant_claeo.release import (
    FRAMES,
    KINDS,
    SPLITS,
    ReleaseError,
    read_release,
    release_quirks,
)

VERBS = {
    "PUSH": ("push", "move-up"),
    "PULL": ("pull", "move-down"),
    "SLIDE-L": ("slide-to-left", "move-sideways-to-left"),
    "SLIDE-R": ("slide-to-right", "move-sideways-to-right"),
}
COLOURS = {
    "red": ("red", "scarlet"),
    "green": ("green", "harlequin"),
    "blue": ("blue", "azure"),
    "yellow": ("yellow", "blonde"),
    "cyan": ("cyan", "greenish-blue"),
    "violet": ("violet", "purple"),
}
START_POSE = np.array([0.0, -20, 0, -100, 0, 0, 20, 0, 100, 0])
ARRANGEMENTS = [("red", "green", "blue"), ("cyan", "violet", "yellow"), ("blue", "yellow", "red")]

ACTIONS = "actionstcnoexc.txt"
SCENES = "arrangementstcnoexc.txt"
BEHAVIOR = "behavior_train/target0007.txt"
LANGUAGE = "language_train/target0007.txt"


def write_release(root: Path) -> Path:
    """Writes a sound release of 3 arrangements x 12 actions; the last arrangement is the test split."""
    for kind in KINDS:
        for split in SPLITS:
            (root / f"{kind}_{split}").mkdir(parents=True)
    scenes = [(action, scene) for scene in ARRANGEMENTS for action in FRAMES]
    splits = ["test" if scene == ARRANGEMENTS[-1] else "train" for _, scene in scenes]
    actions = [f"{action:18}{split}" for (action, _), split in zip(scenes, splits, strict=True)]
    (root / "actionstcnoexc.txt").write_text("\n".join(actions))
    (root / "arrangementstcnoexc.txt").write_text("\n".join("+".join(scene) for _, scene in scenes))
    for number, ((action, scene), split) in enumerate(zip(scenes, splits, strict=True)):
        verb, slot, *direction = action.split("-")
        verbs = VERBS["-".join([verb, *direction])]
        colours = COLOURS[scene["LMR".index(slot)]]
        joints = (
            START_POSE + np.linspace(0, 20, FRAMES[action])[:, None] * (list(FRAMES).index(action) + 1) / 12
        )
        contents = {
            "behavior": "\n".join(" ".join(f"{angle:.1f}" for angle in row) for row in joints) + "\n",
            "language": "\n".join(f"{verb} {colour}" for colour in colours for verb in verbs) + "\n",
            "translate": f"Sentence {number % 30} for Brussels.",
            "translate_target": f"Satz {number} für Br{'' if number < 5 else 'ü'}ssel.",
        }
        for kind, content in contents.items():
            (root / f"{kind}_{split}" / f"target{number:04d}.txt").write_text(content, encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_release(tmp_path_factory.mktemp("sound") / "CLANT")


@pytest.fixture
def release(sound: Path, tmp_path: Path) -> Path:
    """A copy to put a fault into."""
    return shutil.copytree(sound, tmp_path / "CLANT")


def replace_line(path: Path, line: int, text: str) -> None:
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[line - 1 : line] = [text]
    path.write_text("\n".join(lines), encoding="utf-8")


def problems(root: Path) -> list[str]:
    """The problems listed in the error that reading this release raises."""
    with pytest.raises(ReleaseError) as error:
        read_release(root)
    return [line.strip() for line in str(error.value).splitlines() if line.startswith("  ")]


def test_sound_release(sound: Path) -> None:
    samples = read_release(str(sound)).samples
    assert [sample.number for sample in samples] == list(range(36))
    assert Counter(sample.split for sample in samples) == {"train": 24, "test": 12}
    sample = samples[15]
    assert (sample.action, sample.arrangement) == (
        "SLIDE-L-R",
        ("cyan", "violet", "yellow"),
    )
    assert sample.texts == (
        "slide-to-right cyan",
        "move-sideways-to-right cyan",
        "slide-to-right greenish-blue",
        "move-sideways-to-right greenish-blue",
    )
    assert (sample.english, sample.german) == ("Sentence 15 for Brussels.", "Satz 15 für Brüssel.")
    assert sample.joints.shape == (40, 10) and sample.joints.dtype == np.float64
    np.testing.assert_array_equal(sample.joints[0], START_POSE)


def test_samples_cannot_be_changed(sound: Path) -> None:
    sample = read_release(sound).samples[0]
    with pytest.raises(dataclasses.FrozenInstanceError):
        sample.action = "PULL-L"  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        sample.joints[0, 0] = 1.0


def test_minus_zero_and_windows_line_ends_are_sound(release: Path) -> None:
    path = release / "behavior_train/target0000.txt"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n").replace(b" 0.0", b" -0.0", 1))
    joints = read_release(release).samples[0].joints
    assert not np.signbit(joints[joints == 0]).any()


def test_quirks_are_counted_and_kept(sound: Path) -> None:
    release = read_release(sound)
    quirks = release_quirks(release)
    assert quirks.distinct_english == 30
    assert quirks.test_english_in_train == 6  # samples 30 to 35 repeat the sentences of 0 to 5
    assert quirks.german_without_umlauts == 5
    assert release.samples[0].german == "Satz 0 für Brssel."


@pytest.mark.parametrize(
    ("file", "line", "text", "expected"),
    [
        (ACTIONS, 3, "PUSH-X train", "unknown action 'PUSH-X'"),
        (ACTIONS, 3, "SLIDE-L-L validation", "unknown split 'validation'"),
        (ACTIONS, 3, "SLIDE-L-L", "expected an action and a split, found 'SLIDE-L-L'"),
        (ACTIONS, 3, "PUSH-L train", "PUSH-L with red+green+blue again, as in line 1"),
        (SCENES, 9, "red+green+red", "expected three different colours, found 'red+green+red'"),
        (SCENES, 9, "red+green", "expected three different colours, found 'red+green'"),
        (SCENES, 9, "red+green+pink", "unknown colour 'pink'"),
        (BEHAVIOR, 5, "0 -20 0 -100 0 0 20 0 100", "9 joint angles instead of 10"),
        (BEHAVIOR, 5, "0 -20 0 -100 0 0 20 0 100 0 0", "11 joint angles instead of 10"),
        (BEHAVIOR, 5, "", "0 joint angles instead of 10"),
        (BEHAVIOR, 5, "0 nan 0 -100 0 0 20 0 100 0", "column 2: nan is not an angle"),
        (BEHAVIOR, 5, "0 0 inf -100 0 0 20 0 100 0", "column 3: inf is not an angle"),
        (BEHAVIOR, 5, "0 0 0 -1000 0 0 20 0 100 0", "column 4: -1000 is not an angle"),
        (BEHAVIOR, 5, "0 0 0 -100 0 0 2o 0 100 0", "column 7: '2o' is not a number"),
        (BEHAVIOR, 1, "0 0 0 -1.75 0 0 0.35 0 1.75 0", "the first row is not the start pose"),
        (BEHAVIOR, 5, "0 0 0 -100 0 0 20 0 100 0", "differs from the other samples of SLIDE-M-R"),
        (LANGUAGE, 3, "", "empty wording does not fit SLIDE-M-R with red+green+blue"),
        (LANGUAGE, 1, "slide-to-right red", "'slide-to-right red' does not fit SLIDE-M-R"),
        ("translate_train/target0007.txt", 1, "A\nB", "2 lines instead of one sentence"),
        ("translate_target_train/target0007.txt", 1, " ", "the sentence is empty"),
    ],
)
def test_damaged_line(release: Path, file: str, line: int, text: str, expected: str) -> None:
    replace_line(release / file, line, text)
    first = problems(release)[0]
    assert re.match(rf"{re.escape(file)}(, line {line})?: ", first)
    assert expected in first


def test_empty_file(release: Path) -> None:
    (release / "translate_test/target0030.txt").write_text("")
    assert problems(release) == ["translate_test/target0030.txt: the file is empty"]


def test_too_few_rows_and_wordings(release: Path) -> None:
    for name in ("behavior_train/target0000.txt", "language_train/target0000.txt"):
        path = release / name
        path.write_text("\n".join(path.read_text().splitlines()[:-1]))
    assert problems(release) == [
        "behavior_train/target0000.txt: 59 rows, but PUSH-L has 60",
        "language_train/target0000.txt: 3 wordings instead of 4",
    ]


def test_wrong_encoding_names_the_line(release: Path) -> None:
    (release / "translate_target_train/target0008.txt").write_bytes("Satz für Brüssel.".encode("latin-1"))
    path = release / "behavior_train/target0009.txt"
    path.write_bytes(path.read_bytes().replace(b"\n", b"\n\xff", 1))
    assert problems(release) == [
        "translate_target_train/target0008.txt, line 1: byte 0xfc is not UTF-8",
        "behavior_train/target0009.txt, line 2: byte 0xff is not UTF-8",
    ]


def test_missing_file(release: Path) -> None:
    (release / "language_test/target0025.txt").unlink()
    assert problems(release) == ["language_test/target0025.txt: the file is missing"]


def test_missing_folders_are_one_problem_each(release: Path) -> None:
    shutil.rmtree(release / "behavior_train")
    shutil.rmtree(release / "language_test")
    assert problems(release) == [
        "behavior_train: the folder is missing",
        "language_test: the folder is missing",
    ]


@pytest.mark.parametrize("wrong", ["..", "nowhere"])
def test_wrong_path(sound: Path, wrong: str) -> None:
    with pytest.raises(ReleaseError, match=r"actionstcnoexc.txt is missing\. Give the folder CLANT"):
        read_release(sound / wrong)


def test_file_in_the_wrong_split(release: Path) -> None:
    (release / "behavior_train/target0003.txt").rename(release / "behavior_test/target0003.txt")
    assert problems(release) == [
        "behavior_test/target0003.txt: stands in the test split, but actionstcnoexc.txt says train in line 4",
        "behavior_train/target0003.txt: the file is missing",
    ]


def test_index_of_other_length(release: Path) -> None:
    path = release / "arrangementstcnoexc.txt"
    path.write_text("\n".join(path.read_text().splitlines()[:30]))
    assert problems(release) == ["arrangementstcnoexc.txt: 30 lines, but actionstcnoexc.txt has 36"]


def test_index_cut_inside_an_arrangement(release: Path) -> None:
    for name in ("actionstcnoexc.txt", "arrangementstcnoexc.txt"):
        path = release / name
        path.write_text("\n".join(path.read_text().splitlines()[:34]))
    assert problems(release) == ["actionstcnoexc.txt: blue+yellow+red has no sample of SLIDE-R-L, SLIDE-R-R"]


def test_index_cut_after_an_arrangement(release: Path) -> None:
    for name in ("actionstcnoexc.txt", "arrangementstcnoexc.txt"):
        path = release / name
        path.write_text("\n".join(path.read_text().splitlines()[:24]))
    assert (
        problems(release)[0] == "behavior_test/target0024.txt: actionstcnoexc.txt has no line for this sample"
    )


def test_many_problems_are_cut_to_ten(release: Path) -> None:
    for path in (release / "translate_train").iterdir():
        path.unlink()
    found = problems(release)
    assert len(found) == 11
    assert found[-1] == "... and 14 more"


def test_unreadable_file(release: Path) -> None:
    path = release / "language_test/target0025.txt"
    path.unlink()
    path.mkdir()
    assert problems(release) == ["language_test/target0025.txt: the file cannot be read (Is a directory)"]


def test_published_release(clant_dir: Path) -> None:
    release = read_release(clant_dir)
    samples = release.samples
    assert [sample.number for sample in samples] == list(range(1440))
    assert Counter(sample.split for sample in samples) == {"train": 1080, "test": 360}
    assert Counter((sample.action, sample.split) for sample in samples) == {
        (action, split): count for action in FRAMES for split, count in (("train", 90), ("test", 30))
    }
    assert {sample.arrangement for sample in samples} == set(permutations(COLOURS, 3))
    trajectories = {(sample.action, sample.joints.tobytes()) for sample in samples}
    assert len(trajectories) == len({joints for _, joints in trajectories}) == 12
    assert {sample.action: len(sample.joints) for sample in samples} == FRAMES
    assert release_quirks(release) == (1162, 74, 566)
