# SPDX-License-Identifier: Apache-2.0
"""The frames of sentences in `understanding_frames/`, and the words that fill them."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import NamedTuple


class Frame(NamedTuple):
    """A sentence with places to fill, and the kind of its answer."""

    kind: str
    text: str


@dataclass(frozen=True)
class FrameBook:
    """The frames of all files, and the lists that fill places in them.

    Attributes:
        frames: By kind and language, those of each file; a contrast has two, each as likely.
        lists: By name and language what may stand in a place of this name.
    """

    frames: dict[tuple[str, str], list[list[tuple[Frame, ...]]]]
    lists: dict[tuple[str, str], list[str]]


def words(name: str, language: str) -> Sequence[str]:
    """What may stand in a place of this name."""
    return frame_book().lists[name, language]


@cache
def frame_book() -> FrameBook:
    """Read `understanding_frames/`."""
    book = FrameBook({}, {})
    for file in sorted(files(__package__).joinpath("understanding_frames").iterdir(), key=lambda f: f.name):
        section, written = ("", ""), defaultdict[tuple[str, str], list[tuple[Frame, ...]]](list)
        for line in file.read_text(encoding="utf-8").splitlines():
            if line.startswith("["):
                kind, _, language = line.strip("[]").rpartition(" ")
                section = (kind, language)
            elif line and not line.startswith("#"):
                kind, language = section
                if kind.startswith("list "):
                    book.lists.setdefault((kind.removeprefix("list "), language), []).append(line)
                else:
                    sides = line.split(" || ") if kind == "contrast" else [f"{kind}: {line}"]
                    frame = tuple(Frame(*side.split(": ", 1)) for side in sides)
                    written[section].append(frame)
        for section, found in written.items():
            book.frames.setdefault(section, []).append(found)
    return book
