# SPDX-License-Identifier: Apache-2.0
"""Writes docs/results.md from what has been run: `python -m reproduce.report --size=quick`."""

import datetime as dt
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console

from lerobot_owlxt5.command_line import command
from nico_tabletop.scoring import Failure, Outcome

from .paper import LINES, Line
from .plan import OUTPUTS, PLAN, ROOT, Plan, Step, read_plan
from .results import (
    Column,
    Measurement,
    Share,
    count_outcomes,
    read_cells,
    read_figure,
    read_measurements,
    share_of,
)

HUB, FULL = "hub", "full"
"""Sizes of the plan: the one that runs the Hub's models, and the largest of the embedded ones."""
RESULTS = Path("docs/results.md")
NO_MATPLOTLIB = (
    "There are no pictures, because matplotlib is missing: run pip install '.[reproduce]' and write the "
    "report again with python -m reproduce.report."
)
_TITLES = {"crosst5": "CrossT5", "owlxt5": "OWLxT5"}
_SUCCESS = (Outcome.PERFECT, Outcome.SUCCESSFUL)
_OBJECTS = ("clant", "claeo")

_DIFFERENCES = Path(__file__).with_name("differences.md")

_MISSING_ABLATIONS = (
    "Three are not measured, because no option of a policy reaches them yet: the mode drawn for each batch "
    "in place of each sample, no stop output, and an action decoder without made-up names."
)


@dataclass
class ReportConfig:
    """Write docs/results.md from what has been run so far."""

    # `quick` or `full`; the Hub's models are taken from the size `hub`.
    size: str = "quick"
    # File to write; pictures go into the folder `images` beside it.
    results: Path = RESULTS


@dataclass(frozen=True)
class Wanted:
    """A figure of a table: which measurements it is of."""

    measures: str
    policy: str
    objects: str
    demonstrations: int | None = None
    variant: str = ""

    def has(self, step: Step) -> bool:
        """Whether a step measures it."""
        return (
            (step.measures, step.policy, step.variant) == (self.measures, self.policy, self.variant)
            and objects_of(step) == self.objects
            and self.demonstrations in (None, step.chosen.get("demonstrations"))
        )


def objects_of(step: Step) -> str:
    """The set of objects that a step measures on."""
    names = ("objects", "perturbed", "perturbed_crosst5")
    return next((str(step.chosen[name]) for name in names if name in step.chosen), "")


class Book:
    """What was run of a size and of the Hub's, and what was not.

    Args:
        size: Of the plan.
        path: File of the plan.
        outputs: Folder with the sizes' folders.
    """

    def __init__(self, size: str, path: Path = PLAN, outputs: Path = OUTPUTS) -> None:
        self.small = read_plan(FULL if size == HUB else size, path, outputs=outputs)
        self.hub = read_plan(HUB, path, outputs=outputs)
        self.full = read_plan(FULL, path, outputs=outputs)
        self.measured = read_measurements(self.small) + read_measurements(self.hub)

    def plan_of(self, column: Column) -> Plan:
        """The plan that is to fill a column."""
        return self.hub if column is Column.HUB else self.small

    def largest(self, column: Column, policy: str, measures: str = "outcomes") -> int | None:
        """The most demonstrations from which a policy of a column learns; None where it learns from none."""
        numbers = [
            step.chosen.get("demonstrations", 0)
            for step in self.plan_of(column).steps
            if (step.policy, step.measures) == (policy, measures)
        ]
        return max(numbers, default=0) or None

    def find(self, wanted: Wanted, *columns: Column) -> list[Measurement]:
        """What was measured of it, with the pretrained models of these columns."""
        return [each for each in self.measured if wanted.has(each.step) and each.column in columns]

    def show(
        self, wanted: Wanted, columns: Sequence[Column], text: Callable[[list[Measurement]], str]
    ) -> str:
        """The text of what was measured; or the command that measures it."""
        if found := self.find(wanted, *columns):
            return text(found)
        plans = [self.hub] if Column.HUB in columns else [self.small, self.full]
        sizes = [plan.size for plan in plans if any(wanted.has(step) for step in plan.steps)]
        return f"not run: `make reproduce SIZE={sizes[0]}`" if sizes else "not planned"


def write_report(
    size: str, console: Console, results: Path = ROOT / RESULTS, *, path: Path = PLAN, outputs: Path = OUTPUTS
) -> None:
    """Write the page of results, and its pictures if matplotlib is there.

    Args:
        size: Of the plan; the Hub's column is filled from the size `hub`.
        console: Says where the page is.
        results: File to write.
        path: File of the plan.
        outputs: Folder with the sizes' folders.
    """
    book = Book(size, path, outputs)
    images = results.parent / "images"
    images.mkdir(parents=True, exist_ok=True)
    drawn = _draw(book, images)
    parts = [
        "# Results",
        f"`make reproduce SIZE={size}` wrote this on {dt.date.today():%Y-%m-%d}, from what had been run by "
        "then. Shares have Wilson's 95 % intervals.",
        book.small.about,
        "## What differs from the paper",
        _DIFFERENCES.read_text(encoding="utf-8").strip(),
        *_table_one(book),
        *_figure_three(book, drawn),
        *_efficiency(book, drawn),
        *_perturbations(book, drawn),
        *_ablations(book),
        *_commands(book),
    ]
    results.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    console.print(f"Results: {results}", soft_wrap=True, highlight=False)
    if drawn is None:
        console.print(NO_MATPLOTLIB, soft_wrap=True, highlight=False, markup=False)


def _table_one(book: Book) -> list[str]:
    headings = ["figure", "objects"]
    for title in _TITLES.values():
        headings += [f"{title}, paper", f"{title}, {Column.HUB}", f"{title}, {Column.EMBEDDED}"]
    rows = []
    for line in LINES:
        row = [line.title, line.objects]
        for policy in _TITLES:
            published = line.published.get(policy)
            row.append("not published" if published is None else f"{published:.2f} % ({line.where})")
            for column in (Column.HUB, Column.EMBEDDED):
                wanted = Wanted("modes", policy, line.objects, book.largest(column, policy, "modes"))
                row.append(book.show(wanted, [column], partial(_figure_text, line)))
        rows.append(row)
    return [
        "## Table 1, and the errors of section 4",
        table(headings, rows),
        "BLEU-2 is better if it is higher, NRMSE if it is lower. In brackets stands the 95 % bootstrap "
        "interval over the episodes of one seed, or the lowest and the highest of several seeds. "
        "[evaluation.md](evaluation.md#the-figures) has the definitions. Our NRMSE is over true steps; the "
        "authors of CrossT5 count zeros after an episode's end as correct steps.",
        *_made_with(book, "modes", [*_TITLES]),
    ]


def _figure_text(line: Line, found: list[Measurement]) -> str:
    return str(read_figure(found, line.mode, line.variant, line.figure) or "not trained in this mode")


def _policies(plan: Plan, measures: str) -> list[str]:
    return [*dict.fromkeys(step.policy for step in plan.steps if step.measures == measures)]


def _figure_three(book: Book, drawn: dict[str, str] | None) -> list[str]:
    rows = []
    for policy in _policies(book.small, "outcomes"):
        for objects in _OBJECTS:
            row = [_TITLES.get(policy, policy), objects]
            for columns in ([Column.HUB], [Column.EMBEDDED, Column.NONE]):
                wanted = Wanted("outcomes", policy, objects, book.largest(columns[0], policy))
                row.append(book.show(wanted, columns, lambda found: _outcome_text(count_outcomes(found))))
            rows.append(row)
    return [
        "## Figure 3: outcomes of execute",
        *_picture(drawn, "outcomes", "Stacked bars: perfect, successful and failed executions"),
        table(["policy", "objects", str(Column.HUB), f"{Column.EMBEDDED}, or none"], rows),
        "The paper shows its outcomes as bars without numbers. On cubes CrossT5 is slightly better there. On "
        "novel objects it fails and OWLxT5 does not (section 4). Episodes of several seeds are pooled.",
        *_made_with(book, "outcomes", _policies(book.small, "outcomes")),
    ]


def _outcome_text(counts: Counter[str]) -> str:
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in Failure if counts[kind])
    failures = f"; failures: {kinds}" if kinds else ""
    perfect, success = share_of(counts, Outcome.PERFECT), share_of(counts, *_SUCCESS)
    return f"perfect {perfect}; perfect or successful {success}{failures}"


def _numbers(book: Book) -> list[int]:
    """Numbers of demonstrations from which some policy learns."""
    steps = [step for plan in (book.full, book.small) for step in plan.steps if step.measures == "outcomes"]
    return sorted({step.chosen["demonstrations"] for step in steps if "demonstrations" in step.chosen})


def _efficiency(book: Book, drawn: dict[str, str] | None) -> list[str]:
    numbers = _numbers(book)
    rows = []
    for objects in _OBJECTS:
        for policy in _policies(book.full, "outcomes"):
            for columns, title in (([Column.HUB], "Hub's models"), ([Column.EMBEDDED, Column.NONE], "")):
                wanted = [Wanted("outcomes", policy, objects, number) for number in numbers]
                if not any(each.has(step) for each in wanted for step in book.full.steps):
                    continue  # it learns from no demonstration
                if columns == [Column.HUB] and policy not in _TITLES:
                    continue  # it has no pretrained models
                cells = [book.show(each, columns, _success_text) for each in wanted]
                name = _TITLES.get(policy, policy)
                rows.append([objects, f"{name}, {title or _column_name(book, wanted)}", *cells])
        for policy, share in _lines(book).get(objects, {}).items():
            rows.append([objects, policy, *["" for _ in numbers[1:]], f"{share}, without demonstrations"])
    return [
        "## Data efficiency",
        *_picture(drawn, "efficiency", "Success against the number of demonstrations"),
        table(["objects", "policy", *(f"{number} demonstrations" for number in numbers)], rows),
        "Success is perfect or successful. All demonstrations are of cubes. A policy takes the same number "
        "of steps, however many demonstrations it has. Episodes of several seeds are pooled. "
        "`motion_library` learns from none, and is the dashed line. LeRobot's ACT reads no command, so it "
        "cannot know which of the twelve actions is asked for.",
        *_made_with(book, "outcomes", _policies(book.full, "outcomes")),
    ]


def _column_name(book: Book, wanted: Iterable[Wanted]) -> str:
    """The name of the column that was measured, or is going to be."""
    found = [each.column for one in wanted for each in book.find(one, Column.EMBEDDED, Column.NONE)]
    return str(found[0]) if found else f"{Column.EMBEDDED}, or none"


def _success_text(found: list[Measurement]) -> str:
    return str(share_of(count_outcomes(found), *_SUCCESS))


def _lines(book: Book) -> dict[str, dict[str, Share]]:
    """Success of the policies that learn from no demonstration, by objects."""
    found: dict[str, dict[str, Share]] = {}
    for policy in _policies(book.small, "outcomes"):
        if book.largest(Column.EMBEDDED, policy) is None:
            for objects in _OBJECTS:
                measured = book.find(Wanted("outcomes", policy, objects), Column.EMBEDDED, Column.NONE)
                if measured:
                    share = share_of(count_outcomes(measured), *_SUCCESS)
                    found.setdefault(objects, {})[policy] = share
    return found


def _perturbations(book: Book, drawn: dict[str, str] | None) -> list[str]:
    found = _cells(book)
    if not found:
        shown = f"not run: `make reproduce SIZE={book.small.size}`"
    else:
        cells = dict.fromkeys(cell for row in found.values() for cell in row)
        rows = [[f"`{cell}`", *(str(row.get(cell, "not run")) for row in found.values())] for cell in cells]
        shown = table(["cell", *(title.replace("\n", ", ") for title in found)], rows)
    return [
        "## Perturbations",
        *_picture(drawn, "perturbations", "Heat map of how often the named object was moved rightly"),
        shown,
        "How often the named object was moved rightly, that is perfect or successful. "
        "[evaluation.md](evaluation.md#other-situations) says what each cell changes.",
        *_made_with(book, "cells", _policies(book.small, "cells")),
    ]


def _cells(book: Book) -> dict[str, dict[str, Share]]:
    """Shares by policy, objects and pretrained models."""
    titles: dict[str, list[Measurement]] = {}
    for each in book.measured:
        if each.step.measures == "cells" and not each.step.variant:
            policy = _TITLES.get(each.step.policy, each.step.policy)
            titles.setdefault(f"{policy}\n{objects_of(each.step)}\n{each.column}", []).append(each)
    return {title: read_cells(measured) for title, measured in titles.items()}


def _ablations(book: Book) -> list[str]:
    steps = [step for step in (*book.small.steps, *book.full.steps) if step.variant]
    rows = []
    for policy in dict.fromkeys(step.policy for step in steps):
        for variant in ("", *dict.fromkeys(step.variant for step in steps if step.policy == policy)):
            row = [_TITLES.get(policy, policy), variant or "as trained"]
            for objects in _OBJECTS:
                number = book.largest(Column.EMBEDDED, policy)
                wanted = Wanted("outcomes", policy, objects, number, variant)
                columns = [Column.EMBEDDED, Column.MIXED] if variant else [Column.EMBEDDED]
                row.append(book.show(wanted, columns, lambda found: _outcome_text(count_outcomes(found))))
            rows.append(row)
    return [
        "## Ablations",
        table(["policy", "what is changed", *_OBJECTS], rows),
        "The simulator's boxes are an upper bound, not a detector. " + _MISSING_ABLATIONS,
        *_made_with(book, "outcomes", sorted({step.policy for step in steps}), variants=True),
    ]


def _made_with(book: Book, measures: str, policies: Sequence[str], *, variants: bool = False) -> list[str]:
    """With what the figures of a section were made; the commands that measure them, run or not."""
    lines = []
    for plan in (book.small, book.hub):
        steps = [
            step
            for step in plan.steps
            if step.measures == measures and step.policy in policies and bool(step.variant) == variants
        ]
        measured = [each for each in book.measured if any(each.step is step for step in steps)]
        if measured:
            lines.append(_conditions(plan, measured))
        if steps:
            about = f"Commands of the size `{plan.size}`, {len(measured)} of {len(steps)} run"
            lines.append(_details(about, [step.command for step in steps]))
    return lines


def _conditions(plan: Plan, measured: Sequence[Measurement]) -> str:
    seeds = sorted({str(each.step.chosen["seed"]) for each in measured if "seed" in each.step.chosen})
    models = {", ".join(f"{option} {name}" for option, name in each.backbones.items()) for each in measured}
    versions = {
        ", ".join(f"{name} {number}" for name, number in each.record.versions.items()) for each in measured
    }
    machines = {each.record.machine for each in measured}
    facts = {
        "seeds": ", ".join(seeds) or "none",
        "backbones": "; ".join(sorted(filter(None, models))) or "none",
        "versions": "; ".join(sorted(versions)),
        "machine": "; ".join(sorted(machines)),
    }
    said = "\n".join(f"- {name}: {text}" for name, text in facts.items())
    return f"Made in the size `{plan.size}` with\n\n{said}"


def _commands(book: Book) -> list[str]:
    parts = [
        "## What these commands need",
        "They are run in this order in the repository's root, with these variables of the environment and "
        "`MUJOCO_GL=egl` on Linux. `make reproduce` does so, and leaves out what is done.",
    ]
    for plan in (book.small, book.hub):
        environment = [f"export {name}={value}" for name, value in plan.environment.items()]
        others = [step.command for step in plan.steps if not step.measures]
        parts.append(_details(f"Datasets and trainings of the size `{plan.size}`", [*environment, *others]))
    return parts


def _details(title: str, commands: Sequence[str]) -> str:
    lines = "\n".join(commands)
    return f"<details><summary>{title}</summary>\n\n```sh\n{lines}\n```\n\n</details>"


def table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join("| " + " | ".join(cells) + " |" for cells in lines)


def _picture(drawn: dict[str, str] | None, name: str, about: str) -> list[str]:
    if drawn is None:
        return [NO_MATPLOTLIB]
    return [f"![{about}](images/{drawn[name]})"] if name in drawn else []


def _draw(book: Book, images: Path) -> dict[str, str] | None:
    """Draw what has been measured; names of the files, by picture. None without matplotlib."""
    try:
        from . import pictures
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "matplotlib":
            raise
        return None
    drawn = {}
    if bars := _bars(book):
        pictures.draw_outcomes(bars, images / "results_outcomes.png")
        drawn["outcomes"] = "results_outcomes.png"
    if curves := _curves(book):
        pictures.draw_efficiency(curves, _lines(book), images / "results_efficiency.png")
        drawn["efficiency"] = "results_efficiency.png"
    if cells := _cells(book):
        pictures.draw_cells(cells, images / "results_perturbations.png")
        drawn["perturbations"] = "results_perturbations.png"
    return drawn


def _bars(book: Book) -> dict[str, Counter[str]]:
    bars = {}
    for objects in _OBJECTS:
        for policy in _policies(book.small, "outcomes"):
            for column in (Column.HUB, Column.EMBEDDED, Column.NONE):
                wanted = Wanted("outcomes", policy, objects, book.largest(column, policy))
                if found := book.find(wanted, column):
                    name = _TITLES.get(policy, policy)
                    bars[f"{name}\n{objects}\n{column}"] = count_outcomes(found)
    return bars


def _curves(book: Book) -> dict[str, dict[str, dict[int, Share]]]:
    curves: dict[str, dict[str, dict[int, Share]]] = {}
    for objects in _OBJECTS:
        for policy in _policies(book.small, "outcomes"):
            for column in (Column.HUB, Column.EMBEDDED, Column.NONE):
                for number in _numbers(book):
                    if found := book.find(Wanted("outcomes", policy, objects, number), column):
                        title = f"{_TITLES.get(policy, policy)}, {column}"
                        share = share_of(count_outcomes(found), *_SUCCESS)
                        curves.setdefault(objects, {}).setdefault(title, {})[number] = share
    return curves


@command("reproduce.report", ValueError, OSError)
def main(config: ReportConfig) -> None:
    """Write the page."""
    write_report(config.size, Console(), ROOT / config.results)


if __name__ == "__main__":
    main()
