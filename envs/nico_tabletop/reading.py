# SPDX-License-Identifier: Apache-2.0
"""Values of a YAML file that know where they stand, so that every complaint says it."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import Any

_HUGE = 1e6  # beyond it MuJoCo's single precision ends
_SHORTEST = 1e-4  # metres
_WORDS = re.compile(r"[^\W_]+(?:[ '-][^\W_]+)*")


class ObjectsError(ValueError):
    """A set of objects cannot be used. The message says where, why, and what to write instead."""


@dataclass(frozen=True)
class Value:
    """What stands at one place of a file.

    Attributes:
        content: As the YAML reader gave it.
        place: The way there, outermost first, such as `("toys.yaml", "object 'duck'", "scale")`.
    """

    content: Any
    place: tuple[str, ...]

    def error(self, problem: str) -> ObjectsError:
        """An error at this place, for the caller to raise."""
        return ObjectsError(f"{', '.join(self.place)}: {problem}")

    def mapping(self, required: tuple[str, ...], optional: tuple[str, ...] = ()) -> dict[str, "Value"]:
        """The values under these keys, and no others."""
        if not isinstance(self.content, Mapping):
            raise self.error(
                f"expected {', '.join((*required, *optional))} with values; got {self.content!r}"
            )
        if missing := [key for key in required if key not in self.content]:
            raise self.error(f"{', '.join(missing)} is missing")
        if unknown := [str(key) for key in self.content if key not in (*required, *optional)]:
            known = ", ".join((*required, *optional))
            raise self.error(f"{', '.join(unknown)} is not known here; there are {known}")
        return {key: Value(content, (*self.place, key)) for key, content in self.content.items()}

    def items(self, label: str, least: int = 1) -> list["Value"]:
        """The items of a list, called `label` 1, 2, … in messages."""
        if not isinstance(self.content, list) or len(self.content) < least:
            raise self.error(f"expected a list of {least} or more {label}s; got {self.content!r}")
        return [Value(item, (*self.place, f"{label} {n}")) for n, item in enumerate(self.content, 1)]

    def number(self, least: float = -_HUGE, most: float = _HUGE) -> float:
        """A finite number from `least` to `most`."""
        number = self.content
        if isinstance(number, bool) or not isinstance(number, int | float) or not isfinite(number):
            raise self.error(f"expected a number such as 0.025; got {number!r}")
        if not least <= number <= most:
            raise self.error(f"expected a number from {least:g} to {most:g}; got {number:g}")
        return float(number)

    def length(self) -> float:
        """A length in metres, from a tenth of a millimetre up."""
        return self.number(least=_SHORTEST)

    def lengths(self, count: int) -> tuple[float, ...]:
        """So many lengths, as above."""
        return self.numbers(count, least=_SHORTEST)

    def numbers(self, *counts: int, least: float = -_HUGE, most: float = _HUGE) -> tuple[float, ...]:
        """As many numbers as one of `counts`."""
        if not isinstance(self.content, list) or len(self.content) not in counts:
            raise self.error(
                f"expected [{' or '.join(map(str, counts))} numbers] in brackets; got {self.content!r}"
            )
        return tuple(number.number(least, most) for number in self.items("number"))

    def words(self, most_bytes: int | None = None) -> str:
        """Words with single spaces between them: they become part of commands."""
        if not isinstance(self.content, str):
            raise self.error(
                f"expected words (in quotes, if they are no text for YAML); got {self.content!r}"
            )
        if not _WORDS.fullmatch(self.content):
            raise self.error(f"expected letters and digits with single spaces; got {self.content!r}")
        if most_bytes is not None and (size := len(self.content.encode())) > most_bytes:
            raise self.error(
                f"{self.content!r} has {size} bytes in UTF-8, {most_bytes} fit; choose a shorter one"
            )
        return self.content
