# SPDX-License-Identifier: Apache-2.0
"""What was said, by whom."""

from dataclasses import dataclass
from typing import Literal

MOST_LINES = 200
"""So many lines are kept, the last ones."""

Speaker = Literal["person", "robot"]


@dataclass(frozen=True)
class Line:
    """Something that was said.

    Attributes:
        speaker: Who said it.
        text: What was said.
    """

    speaker: Speaker
    text: str


def add(lines: list[Line], speaker: Speaker, text: str) -> None:
    """Add a line, and forget what is too long ago."""
    lines.append(Line(speaker, text))
    del lines[:-MOST_LINES]
