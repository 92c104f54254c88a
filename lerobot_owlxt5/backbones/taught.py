# SPDX-License-Identifier: Apache-2.0
"""The things that somebody has shown and named, in memory and in a file of theirs."""

import json
import os
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file

from .appearance import Appearance

MOST_LOOKS = 5
"""Of one thing the last looks count (our decision)."""
_DETECTOR, _NAMES = "detector", "names"
_CHANGES_A_FILE = threading.Lock()
"""Visitors of one page share a file, each from a thread of their own."""


class TaughtThings(Mapping[str, tuple[Appearance, ...]]):
    """Names, and the last looks at what is called so.

    Args:
        detector: Whose looks they are, by its revision or name: no other one understands its embeddings.
        file: A safetensors file to keep them in; None: they are forgotten in the end.

    Raises:
        ValueError: If the file exists and cannot be used; it stays as it is.
    """

    def __init__(self, detector: str, file: Path | None = None) -> None:
        self.detector, self._file = detector, file
        self._looks: dict[str, tuple[Appearance, ...]] = {}
        self._read()

    def __iter__(self) -> Iterator[str]:
        """The names, in the order in which they were taught."""
        return iter(self._looks)

    def __len__(self) -> int:
        """How many things were taught."""
        return len(self._looks)

    def __getitem__(self, name: str) -> tuple[Appearance, ...]:
        """The last looks at a thing."""
        return self._looks[name]

    def add(self, name: str, look: Appearance) -> None:
        """Remember one more look at a thing.

        Raises:
            ValueError, OSError: If the file cannot be used; the look is remembered for now.
        """
        looks = (*self._looks.get(name, ()), look)[-MOST_LOOKS:]
        self._looks[name] = looks
        with _CHANGES_A_FILE:
            self._read()
            self._looks[name] = looks
            self._write()

    def remove(self, name: str) -> None:
        """Forget a thing.

        Raises:
            KeyError: If it was not taught.
            ValueError, OSError: If the file cannot be used.
        """
        del self._looks[name]
        with _CHANGES_A_FILE:
            self._read()
            self._looks.pop(name, None)
            self._write()

    def _read(self) -> None:
        """What is in the file: others may have added to it since, or taken something out."""
        if self._file is None or not self._file.exists():
            return
        try:
            with safe_open(self._file, "pt") as file:
                about = file.metadata() or {}
                names, detector = json.loads(about[_NAMES]), about[_DETECTOR]
                tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118  no dict
                looks = {
                    name: tuple(
                        Appearance(tensors[f"{row}.{look}.embedding"], tensors[f"{row}.{look}.colours"])
                        for look in range(count)
                    )
                    for row, (name, count) in enumerate(names.items())
                }
        except (SafetensorError, KeyError, ValueError, AttributeError, TypeError) as error:
            raise ValueError(
                f"{self._file} is no file of taught things, or it is broken. It stays as it is: move it, "
                "or name another file"
            ) from error
        if detector != self.detector:
            raise ValueError(
                f"{self._file} has things that another detector was taught, and this one cannot know again: "
                "name another file"
            )
        self._looks = looks

    def _write(self) -> None:
        if self._file is None:
            return
        tensors: dict[str, torch.Tensor] = {}
        for row, looks in enumerate(self._looks.values()):
            for number, look in enumerate(looks):
                parts = look._asdict().items()
                tensors |= {f"{row}.{number}.{part}": value.clone() for part, value in parts}
        names = {name: len(looks) for name, looks in self._looks.items()}
        self._file.parent.mkdir(parents=True, exist_ok=True)
        draft = self._file.with_name(f"{self._file.name}.draft")
        save_file(tensors, draft, {_DETECTOR: self.detector, _NAMES: json.dumps(names)})
        os.replace(draft, self._file)
