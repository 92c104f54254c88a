# SPDX-License-Identifier: Apache-2.0
"""What has been run of a plan, and what has not: the figures that a report shows."""

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from pathlib import Path

from nico_tabletop.scoring import Outcome

from .plan import OUTPUTS, PLAN, Plan, Step, read_plan
from .results import (
    Column,
    Measurement,
    Share,
    count_outcomes,
    read_cells,
    read_measurements,
    share_of,
)

HUB, FULL = "hub", "full"
"""Sizes of the plan: the one that runs the Hub's models, and the largest of the embedded ones."""
TITLES = {"crosst5": "CrossT5", "owlxt5": "OWLxT5"}
"""The paper's policies, as it calls them."""
OBJECTS = ("clant", "claeo")
SUCCESS = (Outcome.PERFECT, Outcome.SUCCESSFUL)


def title_of(policy: str) -> str:
    """What a policy is called in a report."""
    return TITLES.get(policy, policy)


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

    def plans_of(self, column: Column) -> list[Plan]:
        """The plans that may fill a column; the first that plans a figure counts."""
        return [self.hub] if column is Column.HUB else [self.small, self.full]

    def largest(
        self, column: Column, policy: str, measures: str = "outcomes", variant: str = ""
    ) -> int | None:
        """The most demonstrations from which a policy of a column learns; None where it learns from none."""
        wanted = measures, policy, variant
        for plan in self.plans_of(column):
            steps = [each for each in plan.steps if (each.measures, each.policy, each.variant) == wanted]
            if steps:
                return max(each.chosen.get("demonstrations", 0) for each in steps) or None
        return None

    def find(self, wanted: Wanted, *columns: Column) -> list[Measurement]:
        """What was measured of it, with the pretrained models of these columns."""
        return [each for each in self.measured if wanted.has(each.step) and each.column in columns]

    def show(
        self, wanted: Wanted, columns: Sequence[Column], text: Callable[[list[Measurement]], str]
    ) -> str:
        """The text of what was measured; or the command that measures it."""
        if found := self.find(wanted, *columns):
            return text(found)
        plans = self.plans_of(columns[0])
        sizes = [plan.size for plan in plans if any(wanted.has(step) for step in plan.steps)]
        return f"not run: `make reproduce SIZE={sizes[0]}`" if sizes else "not planned"

    def numbers(self) -> list[int]:
        """Numbers of demonstrations from which some policy learns."""
        plans = self.full, self.small
        steps = [step for plan in plans for step in plan.steps if step.measures == "outcomes"]
        return sorted({step.chosen["demonstrations"] for step in steps if "demonstrations" in step.chosen})

    def without_demonstrations(self) -> dict[str, dict[str, Share]]:
        """Success of the policies that learn from no demonstration, by objects."""
        found: dict[str, dict[str, Share]] = {}
        for policy in policies(self.small, "outcomes"):
            if self.largest(Column.EMBEDDED, policy) is None:
                for objects in OBJECTS:
                    measured = self.find(Wanted("outcomes", policy, objects), Column.EMBEDDED, Column.NONE)
                    if measured:
                        share = share_of(count_outcomes(measured), *SUCCESS)
                        found.setdefault(objects, {})[policy] = share
        return found

    def outcomes(self) -> dict[str, Counter[str]]:
        """Outcomes by policy, objects and pretrained models, each from the most demonstrations."""
        bars = {}
        for objects, policy, column in self._in_one_column():
            wanted = Wanted("outcomes", policy, objects, self.largest(column, policy))
            if found := self.find(wanted, column):
                bars[f"{title_of(policy)}\n{objects}\n{column}"] = count_outcomes(found)
        return bars

    def curves(self) -> dict[str, dict[str, dict[int, Share]]]:
        """Success by objects, by policy and pretrained models, and by the number of demonstrations."""
        curves: dict[str, dict[str, dict[int, Share]]] = {}
        for objects, policy, column in self._in_one_column():
            for number in self.numbers():
                if found := self.find(Wanted("outcomes", policy, objects, number), column):
                    share = share_of(count_outcomes(found), *SUCCESS)
                    title = f"{title_of(policy)}, {column}"
                    curves.setdefault(objects, {}).setdefault(title, {})[number] = share
        return curves

    def _in_one_column(self) -> Iterator[tuple[str, str, Column]]:
        """Objects, policies, and columns in which a figure of them may stand."""
        columns = Column.HUB, Column.EMBEDDED, Column.NONE
        return product(OBJECTS, policies(self.small, "outcomes"), columns)

    def cells(self) -> dict[str, dict[str, Share]]:
        """Shares of each perturbation's cell, by policy, objects and pretrained models."""
        titles: dict[str, list[Measurement]] = {}
        for each in self.measured:
            if each.step.measures == "cells" and not each.step.variant:
                title = f"{title_of(each.step.policy)}\n{objects_of(each.step)}\n{each.column}"
                titles.setdefault(title, []).append(each)
        return {title: read_cells(measured) for title, measured in titles.items()}


def policies(plan: Plan, measures: str) -> list[str]:
    """Policies of which a plan measures something."""
    return [*dict.fromkeys(step.policy for step in plan.steps if step.measures == measures)]
