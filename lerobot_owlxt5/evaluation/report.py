# SPDX-License-Identifier: Apache-2.0
"""The results of `owlxt5-evaluate` as a table, as JSON and as Markdown."""

import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich import box
from rich.table import Table

from .metrics import Estimate

HEADINGS = {
    "bleu2": "BLEU-2 %",
    "accuracy": "sentence accuracy %",
    "nrmse": "NRMSE %",
    "refused": "refused %",
    "steps_off": "stop off, steps",
}
_DIGITS = 6


@dataclass(frozen=True)
class Row:
    """Figures of one mode, in one kind of words or against one kind of reference.

    Attributes:
        mode: What was done.
        variant: With which words, or against which reference.
        figures: Estimates by key of `HEADINGS`; each mode has some of them.
    """

    mode: str
    variant: str
    figures: dict[str, Estimate]


@dataclass(frozen=True)
class Report:
    """What was evaluated, and what came out.

    Attributes:
        about: Checkpoint, detector, dataset and all else that a figure must not be quoted without.
        rows: The figures, rows of a mode one after the other.
    """

    about: Mapping[str, str | int]
    rows: list[Row]

    def table(self) -> Table:
        """For a terminal of 80 columns: the interval stands below its figure."""
        table = Table(box=box.SIMPLE_HEAD, collapse_padding=True, pad_edge=False)
        table.add_column("mode")
        table.add_column("variant")
        for heading in HEADINGS.values():
            table.add_column(heading, justify="right")
        modes = [row.mode for row in self.rows]
        for row, following in zip(self.rows, [*modes[1:], None], strict=True):
            cells = _cells(row, "{value:.2f}\n[dim]{low}-{high}[/dim]")
            table.add_row(row.mode, row.variant, *cells, end_section=row.mode != following)
        return table

    def save(self, folder: Path) -> tuple[Path, Path]:
        """Write `results.json` and `results.md`.

        Args:
            folder: Is made if it does not exist.

        Returns:
            The two files.
        """
        folder.mkdir(parents=True, exist_ok=True)
        data, text = folder / "results.json", folder / "results.md"
        data.write_text(json.dumps(self._as_json(), indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        text.write_text(self._as_markdown(), encoding="utf-8")
        return data, text

    def _as_json(self) -> dict[str, Any]:
        rows = []
        for row in self.rows:
            figures = {
                key: {name: round(number, _DIGITS) for name, number in asdict(figure).items()}
                for key, figure in row.figures.items()
            }
            rows.append({"mode": row.mode, "variant": row.variant, **figures})
        return {**self.about, "rows": rows}

    def _as_markdown(self) -> str:
        headings = ["mode", "variant", *HEADINGS.values()]
        lines = ["# owlxt5-evaluate", "", *(f"- {name}: {value}" for name, value in self.about.items()), ""]
        lines += [_markdown_row(headings), _markdown_row(["---"] * len(headings))]
        for row in self.rows:
            lines.append(_markdown_row([row.mode, row.variant, *_cells(row, "{value:.2f} ({low}-{high})")]))
        return "\n".join(lines) + "\n"


def _cells(row: Row, pattern: str) -> list[str]:
    figures = [row.figures.get(key) for key in HEADINGS]
    return [
        pattern.format(value=figure.value, low=_short(figure.low), high=_short(figure.high)) if figure else ""
        for figure in figures
    ]


def _short(number: float) -> str:
    """At most three digits and a point, or what stands before the point."""
    return f"{number:.{2 if number < 10 else 1 if number < 100 else 0}f}"


def _markdown_row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
