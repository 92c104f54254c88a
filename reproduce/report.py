# SPDX-License-Identifier: Apache-2.0
"""Writes docs/results.md from what has been run: `python -m reproduce.report --size=quick`."""

import datetime as dt
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rich.console import Console

from lerobot_owlxt5.command_line import command
from nico_tabletop.scoring import Failure, Outcome

from .book import HUB, OBJECTS, SUCCESS, TITLES, Book, Wanted, policies, title_of
from .paper import LINES, Line
from .plan import OUTPUTS, PLAN, ROOT, Plan
from .results import Column, Measurement, count_outcomes, read_figure, share_of

RESULTS = Path("docs/results.md")
NO_MATPLOTLIB = (
    "There are no pictures, because matplotlib is missing: run pip install '.[reproduce]' and write the "
    "report again with python -m reproduce.report."
)
_DIFFERENCES = Path(__file__).with_name("differences.md")


@dataclass
class ReportConfig:
    """Write docs/results.md from what has been run so far."""

    # `quick` or `full`; the Hub's models are taken from the size `hub`.
    size: str = "quick"
    # File to write; pictures go into the folder `images` beside it.
    results: Path = RESULTS


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
        (book.hub if size == HUB else book.small).about,
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
    for title in TITLES.values():
        headings += [f"{title}, paper", f"{title}, {Column.HUB}", f"{title}, {Column.EMBEDDED}"]
    rows = []
    for line in LINES:
        row = [line.title, line.objects]
        for policy in TITLES:
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
        *_made_with(book, "modes", [*TITLES]),
    ]


def _figure_text(line: Line, found: list[Measurement]) -> str:
    return str(read_figure(found, line.mode, line.variant, line.figure) or "not trained in this mode")


def _figure_three(book: Book, drawn: dict[str, str] | None) -> list[str]:
    rows = []
    for policy in policies(book.small, "outcomes"):
        for objects in OBJECTS:
            row = [title_of(policy), objects]
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
        *_made_with(book, "outcomes", policies(book.small, "outcomes")),
    ]


def _outcome_text(counts: Counter[str]) -> str:
    kinds = ", ".join(f"{counts[kind]} {kind}" for kind in Failure if counts[kind])
    failures = f"; failures: {kinds}" if kinds else ""
    perfect, success = share_of(counts, Outcome.PERFECT), share_of(counts, *SUCCESS)
    return f"perfect {perfect}; perfect or successful {success}{failures}"


def _efficiency(book: Book, drawn: dict[str, str] | None) -> list[str]:
    numbers = book.numbers()
    rows = []
    for objects in OBJECTS:
        for policy in policies(book.full, "outcomes"):
            for columns, title in (([Column.HUB], "Hub's models"), ([Column.EMBEDDED, Column.NONE], "")):
                wanted = [Wanted("outcomes", policy, objects, number) for number in numbers]
                if not any(each.has(step) for each in wanted for step in book.full.steps):
                    continue  # it learns from no demonstration
                if columns == [Column.HUB] and policy not in TITLES:
                    continue  # it has no pretrained models
                cells = [book.show(each, columns, _success_text) for each in wanted]
                name = title_of(policy)
                rows.append([objects, f"{name}, {title or _column_name(book, wanted)}", *cells])
        for policy, share in book.without_demonstrations().get(objects, {}).items():
            rows.append([objects, policy, *["" for _ in numbers[1:]], f"{share}, without demonstrations"])
    return [
        "## Data efficiency",
        *_picture(drawn, "efficiency", "Success against the number of demonstrations"),
        table(["objects", "policy", *(f"{number} demonstrations" for number in numbers)], rows),
        "Success is perfect or successful. All demonstrations are of cubes. A policy takes the same number "
        "of steps, however many demonstrations it has. Episodes of several seeds are pooled. "
        "`motion_library` learns from none, and is the dashed line. LeRobot's ACT reads no command, so it "
        "cannot know which of the twelve actions is asked for. `early_fusion` is RT-2's way without RT-2's "
        "pre-training.",
        *_made_with(book, "outcomes", policies(book.full, "outcomes")),
    ]


def _column_name(book: Book, wanted: Iterable[Wanted]) -> str:
    """The name of the column that was measured, or is going to be."""
    found = [each.column for one in wanted for each in book.find(one, Column.EMBEDDED, Column.NONE)]
    return str(found[0]) if found else f"{Column.EMBEDDED}, or none"


def _success_text(found: list[Measurement]) -> str:
    return str(share_of(count_outcomes(found), *SUCCESS))


def _perturbations(book: Book, drawn: dict[str, str] | None) -> list[str]:
    found = book.cells()
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
        *_made_with(book, "cells", policies(book.small, "cells")),
    ]


def _ablations(book: Book) -> list[str]:
    steps = [step for step in (*book.small.steps, *book.full.steps) if step.variant]
    rows = []
    for policy in dict.fromkeys(step.policy for step in steps):
        for variant in ("", *dict.fromkeys(step.variant for step in steps if step.policy == policy)):
            row = [title_of(policy), variant or "as trained"]
            number = book.largest(Column.EMBEDDED, policy, variant=variant)
            for objects in OBJECTS:
                wanted = Wanted("outcomes", policy, objects, number, variant)
                columns = [Column.EMBEDDED, Column.MIXED] if variant else [Column.EMBEDDED]
                row.append(book.show(wanted, columns, lambda found: _outcome_text(count_outcomes(found))))
            rows.append(row)
    return [
        "## Ablations",
        table(["policy", "what is changed", *OBJECTS], rows),
        "The simulator's boxes are an upper bound, not a detector. Made-up names, the stop output and a mode "
        "for each sample are changed in training; the others at evaluation alone.",
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
    if bars := book.outcomes():
        pictures.draw_outcomes(bars, images / "results_outcomes.png")
        drawn["outcomes"] = "results_outcomes.png"
    if curves := book.curves():
        pictures.draw_efficiency(curves, book.without_demonstrations(), images / "results_efficiency.png")
        drawn["efficiency"] = "results_efficiency.png"
    if cells := book.cells():
        pictures.draw_cells(cells, images / "results_perturbations.png")
        drawn["perturbations"] = "results_perturbations.png"
    return drawn


@command("reproduce.report")
def main(config: ReportConfig) -> None:
    """Write the page."""
    write_report(config.size, Console(), ROOT / config.results)


if __name__ == "__main__":
    main()
