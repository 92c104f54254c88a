# SPDX-License-Identifier: Apache-2.0
"""Reads and checks the original CLANT release, as its authors published it (samsoneko/CrossT5 on GitHub).

The release is a folder of text files. Two index files have one line per sample, in the order of the numbers:

- `actionstcnoexc.txt`: action and split, `SLIDE-L-R   test`;
- `arrangementstcnoexc.txt`: the colours of the left, middle and right cube, `red+green+blue`.

Sample 7 of the train split is spread over four more files:

- `behavior_train/target0007.txt`: one row per frame, ten joint angles in degrees (`robot.JOINT_NAMES`);
- `language_train/target0007.txt`: four wordings of the command, the canonical one first;
- `translate_train/target0007.txt` and `translate_target_train/target0007.txt`: an English sentence and its
  German translation.

The rest of the release (autoencoder features, one-hot texts, vocabulary) can be derived or is not needed.
Nothing is repaired: what does not fit is reported, all of it in one error.
"""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from nico_tabletop.objects import read_objects
from nico_tabletop.robot import INITIAL_POSE_DEG, JOINT_NAMES
from nico_tabletop.tasks import ACTIONS, find_action

from .wordings import wordings

Split = Literal["train", "test"]
Arrangement = tuple[str, str, str]

_LENGTHS = (60, 60, 85, 40, 60, 40, 40, 40, 60, 50, 40, 85)  # rows, in the order of `ACTIONS`

FRAMES: dict[str, int] = {action.name: rows for action, rows in zip(ACTIONS, _LENGTHS, strict=True)}
"""The twelve actions, `<verb>-<slot>` or `SLIDE-<slot>-<direction>`, and the length of their trajectories."""

ACTIONS_FILE = "actionstcnoexc.txt"
ARRANGEMENTS_FILE = "arrangementstcnoexc.txt"
SPLITS: tuple[Split, Split] = ("train", "test")
KINDS = ("behavior", "language", "translate", "translate_target")

_MAX_ANGLE = 180.0  # degrees; no joint of NICO turns further, so more is a wrong unit or a damaged number
_MAX_SHOWN = 10
_DELETED_LETTERS = re.compile("[äöüÄÖÜß]")


class ReleaseError(ValueError):
    """The release at the given path is not the CLANT that its authors published.

    The message lists what is wrong, one line each, with file and line, and says what to do.
    """


@dataclass(frozen=True, eq=False)
class Sample:
    """One demonstration of the release.

    Attributes:
        number: Position in the index files, from 0.
        action: One of the keys of `FRAMES`, e.g. `SLIDE-L-R`.
        split: The authors' split.
        arrangement: Colours of the cubes on the left, middle and right slot, as the robot sees them.
        joints: Joint angles as written, degrees, float64 (T, 10), in the order of `robot.JOINT_NAMES`;
            read-only.
        texts: The four accepted wordings of the command; the first is the canonical one.
        english: Sentence to translate; it has nothing to do with the action.
        german: Its translation, as written (see `release_quirks`).
    """

    number: int
    action: str
    split: Split
    arrangement: Arrangement
    joints: NDArray[np.float64]
    texts: tuple[str, ...]
    english: str
    german: str


@dataclass(frozen=True, eq=False)
class Release:
    """A release that passed every check.

    Attributes:
        path: Folder that it was read from.
        samples: All samples, by number: 1440 in the published release.
    """

    path: Path
    samples: tuple[Sample, ...]


class Quirks(NamedTuple):
    """Oddities of the published release that are kept as they are, as counts of samples."""

    distinct_english: int
    """Distinct English sentences."""
    test_english_in_train: int
    """Test samples whose English sentence also stands in the train split."""
    german_without_umlauts: int
    """Samples whose German sentence has words with their umlauts deleted, such as `europischen`."""


def read_release(path: str | Path) -> Release:
    """Reads the release and checks it as a whole.

    The number of samples comes from the index files, which must list all twelve actions once for each
    arrangement; every other file must agree with them.

    Args:
        path: The folder of the release, which directly contains `actionstcnoexc.txt`.

    Returns:
        The checked release.

    Raises:
        ReleaseError: Something is missing, damaged or contradictory; the message lists up to ten problems.
    """
    root = Path(path).expanduser()
    if not (root / ACTIONS_FILE).is_file():
        raise ReleaseError(
            f"{root}: no CLANT release here, {ACTIONS_FILE} is missing. "
            "Give the folder CLANT of the release, the one that directly contains this file."
        )
    reader = _Reader(root)
    index = reader.index()
    reader.check_folders()
    reader.raise_problems()  # without a sound index and all folders, every other file would look wrong
    reader.check_splits(index)
    samples = [reader.sample(number, *entry) for number, entry in enumerate(index)]
    reader.check_trajectories(samples)
    reader.raise_problems()
    return Release(root, tuple(samples))


def release_quirks(release: Release) -> Quirks:
    """Counts what is odd in the translation pairs.

    A German word counts as damaged when another sentence of the release has the same word with its umlauts
    (or its sharp s) in place. No dictionary is needed; damaged words that never occur intact go unnoticed.
    """
    train = {sample.english for sample in release.samples if sample.split == "train"}
    words = [set(re.findall(r"\w+", sample.german)) for sample in release.samples]
    vocabulary = set().union(*words)
    intact = {word for word in vocabulary if _DELETED_LETTERS.search(word)}
    damaged = {_DELETED_LETTERS.sub("", word) for word in intact}
    return Quirks(
        distinct_english=len({sample.english for sample in release.samples}),
        test_english_in_train=sum(s.english in train for s in release.samples if s.split == "test"),
        german_without_umlauts=sum(not damaged.isdisjoint(sentence) for sentence in words),
    )


class _Reader:
    """Reads the files of one release and remembers every problem instead of stopping at the first."""

    def __init__(self, root: Path):
        self.root = root
        self.cubes = {cube.name: cube for cube in read_objects("clant")}
        self.problems: list[str] = []

    def problem(self, file: str, what: str, line: int | None = None) -> None:
        self.problems.append(f"{file}: {what}" if line is None else f"{file}, line {line}: {what}")

    def raise_problems(self) -> None:
        if not self.problems:
            return
        shown = self.problems[:_MAX_SHOWN]
        if len(self.problems) > len(shown):
            shown.append(f"... and {len(self.problems) - len(shown)} more")
        count = "1 problem" if len(self.problems) == 1 else f"{len(self.problems)} problems"
        raise ReleaseError(
            f"{self.root}: not a sound CLANT release, {count}:\n  "
            + "\n  ".join(shown)
            + "\nFetch these files again from the authors' repository (samsoneko/CrossT5 on GitHub) "
            "and leave them unchanged."
        )

    def lines(self, file: str) -> list[str]:
        """Lines of a text file without their ends; none when it cannot be read."""
        try:
            data = (self.root / file).read_bytes()
        except FileNotFoundError:
            self.problem(file, "the file is missing")
            return []
        except OSError as error:
            self.problem(file, f"the file cannot be read ({error.strerror})")
            return []
        try:
            lines = data.decode("utf-8").splitlines()
        except UnicodeDecodeError as error:
            line = data.count(b"\n", 0, error.start) + 1
            self.problem(file, f"byte 0x{data[error.start]:02x} is not UTF-8", line)
            return []
        if not lines:
            self.problem(file, "the file is empty")
        return lines

    def index(self) -> list[tuple[str, Split, Arrangement]]:
        """Action, split and arrangement of each sample, from the two index files."""
        actions = [self._action(*numbered) for numbered in enumerate(self.lines(ACTIONS_FILE), 1)]
        arrangements = [
            self._arrangement(*numbered) for numbered in enumerate(self.lines(ARRANGEMENTS_FILE), 1)
        ]
        if self.problems:
            return []
        if len(actions) != len(arrangements):
            counts = f"{len(arrangements)} lines, but {ACTIONS_FILE} has {len(actions)}"
            self.problem(ARRANGEMENTS_FILE, counts)
            return []
        index = [(*action, arrangement) for action, arrangement in zip(actions, arrangements, strict=True)]
        seen: dict[tuple[str, Arrangement], int] = {}
        for line, (action, _, arrangement) in enumerate(index, 1):
            if (first := seen.setdefault((action, arrangement), line)) != line:
                again = f"{action} with {'+'.join(arrangement)} again, as in line {first}"
                self.problem(ACTIONS_FILE, again, line)
        for arrangement in dict.fromkeys(arrangements):
            if missing := [action for action in FRAMES if (action, arrangement) not in seen]:
                self.problem(ACTIONS_FILE, f"{'+'.join(arrangement)} has no sample of {', '.join(missing)}")
        return index

    def _action(self, line: int, text: str) -> tuple[str, Split]:
        words = text.split()
        if len(words) != 2:
            self.problem(ACTIONS_FILE, f"expected an action and a split, found {text!r}", line)
            return "", "train"
        action, split = words
        if action not in FRAMES:
            self.problem(ACTIONS_FILE, f"unknown action {action!r}; known: {', '.join(FRAMES)}", line)
        if split not in SPLITS:
            self.problem(ACTIONS_FILE, f"unknown split {split!r}; known: {', '.join(SPLITS)}", line)
        return action, cast("Split", split)

    def _arrangement(self, line: int, text: str) -> Arrangement:
        colours = text.strip().split("+")
        for colour in colours:
            if colour not in self.cubes:
                known = ", ".join(self.cubes)
                self.problem(ARRANGEMENTS_FILE, f"unknown colour {colour!r}; known: {known}", line)
        if len(colours) != 3 or len(set(colours)) != 3:
            self.problem(ARRANGEMENTS_FILE, f"expected three different colours, found {text.strip()!r}", line)
            return "", "", ""
        return colours[0], colours[1], colours[2]

    def check_folders(self) -> None:
        for kind in KINDS:
            for split in SPLITS:
                if not (self.root / f"{kind}_{split}").is_dir():
                    self.problem(f"{kind}_{split}", "the folder is missing")

    def check_splits(self, index: Sequence[tuple[str, Split, Arrangement]]) -> None:
        """Reports files in the split folders that the index does not know or puts into the other split."""
        due = {_name(number): split for number, (_, split, _) in enumerate(index)}
        for kind in KINDS:
            for split in SPLITS:
                folder = f"{kind}_{split}"
                for name in sorted(file.name for file in (self.root / folder).glob("target*.txt")):
                    if name not in due:
                        self.problem(f"{folder}/{name}", f"{ACTIONS_FILE} has no line for this sample")
                    elif due[name] != split:
                        says = f"{ACTIONS_FILE} says {due[name]} in line {int(name[6:-4]) + 1}"
                        self.problem(f"{folder}/{name}", f"stands in the {split} split, but {says}")

    def sample(self, number: int, action: str, split: Split, arrangement: Arrangement) -> Sample:
        """Reads the four files of a sample; after a problem, its contents are not to be used."""
        behavior, language, english, german = (f"{kind}_{split}/{_name(number)}" for kind in KINDS)
        return Sample(
            number=number,
            action=action,
            split=split,
            arrangement=arrangement,
            joints=self._joints(behavior, action),
            texts=self._texts(language, action, arrangement),
            english=self._sentence(english),
            german=self._sentence(german),
        )

    def _joints(self, file: str, action: str) -> NDArray[np.float64]:
        before = len(self.problems)
        rows = [self._row(file, line, text) for line, text in enumerate(self.lines(file), 1)]
        if len(self.problems) > before:
            return np.empty((0, len(JOINT_NAMES)))
        if len(rows) != FRAMES[action]:
            self.problem(file, f"{len(rows)} rows, but {action} has {FRAMES[action]}")
        joints = np.array(rows) + 0.0  # turns the release's -0.0 into 0.0
        if not np.array_equal(joints[:1], INITIAL_POSE_DEG[None]):
            pose = " ".join(f"{angle:g}" for angle in INITIAL_POSE_DEG)
            self.problem(file, f"the first row is not the start pose {pose}", 1)
        joints.flags.writeable = False
        return joints

    def _row(self, file: str, line: int, text: str) -> list[float]:
        words = text.split()
        if len(words) != len(JOINT_NAMES):
            self.problem(file, f"{len(words)} joint angles instead of {len(JOINT_NAMES)}", line)
        row = []
        for column, word in enumerate(words, 1):
            try:
                angle = float(word)
            except ValueError:
                self.problem(file, f"column {column}: {word!r} is not a number", line)
                continue
            if not abs(angle) <= _MAX_ANGLE:  # written so that NaN fails too
                limits = f"{-_MAX_ANGLE:g} to {_MAX_ANGLE:g} degrees"
                self.problem(file, f"column {column}: {word} is not an angle in {limits}", line)
            row.append(angle)
        return row

    def _texts(self, file: str, action: str, arrangement: Arrangement) -> tuple[str, ...]:
        texts = tuple(line.strip() for line in self.lines(file))
        task = find_action(action)
        expected = wordings(task, self.cubes[arrangement[task.slot]])
        if texts and len(texts) != len(expected):
            self.problem(file, f"{len(texts)} wordings instead of {len(expected)}")
        for line, (text, due) in enumerate(zip(texts, expected, strict=False), 1):
            if text != due:
                found = repr(text) if text else "empty wording"
                scene = f"{action} with {'+'.join(arrangement)}"
                self.problem(file, f"{found} does not fit {scene}, expected {due!r}", line)
        return texts

    def _sentence(self, file: str) -> str:
        lines = self.lines(file)
        if len(lines) > 1:
            self.problem(file, f"{len(lines)} lines instead of one sentence")
        elif lines and not lines[0].strip():
            self.problem(file, "the sentence is empty", 1)
        return lines[0] if lines else ""

    def check_trajectories(self, samples: Sequence[Sample]) -> None:
        """All samples of an action share one trajectory, so the odd one out has a damaged number."""
        for action, frames in FRAMES.items():
            whole = [s for s in samples if s.action == action and len(s.joints) == frames]
            if not whole:
                continue
            [(usual, _)] = Counter(sample.joints.tobytes() for sample in whole).most_common(1)
            expected = np.frombuffer(usual).reshape(frames, len(JOINT_NAMES))
            for sample in whole:
                rows = np.flatnonzero((sample.joints != expected).any(axis=1))
                if rows.size:
                    file = f"behavior_{sample.split}/{_name(sample.number)}"
                    self.problem(file, f"differs from the other samples of {action}", int(rows[0]) + 1)


def _name(number: int) -> str:
    return f"target{number:04d}.txt"
