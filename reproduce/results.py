# SPDX-License-Identifier: Apache-2.0
"""What came out: the outputs of a plan's steps, and with which pretrained models they were obtained."""

import json
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from statistics import fmean
from typing import Any

from nico_tabletop.rates import wilson
from nico_tabletop.report import read_evaluations
from nico_tabletop.scoring import Outcome

from .plan import ROOT, Plan, Step
from .record import Record, is_whole, read_record

HUB_MODELS = {"language_model": "google-t5/t5-small", "detector": "google/owlv2-base-patch16"}
"""The paper's pretrained models (section 3)."""
_OPTIONS = (*HUB_MODELS, "understanding")


class Column(StrEnum):
    """In which column a figure stands, by the pretrained models with which it was obtained."""

    HUB = "Hub's models"
    """T5-small and OWLv2-base, and no other."""
    EMBEDDED = "embedded backbones"
    """The small ones of this package, and no other."""
    NONE = "no backbones"
    """The policy has none."""
    MIXED = "mixed"
    """Anything else, such as the simulator's boxes: in no column of the paper's tables."""


def backbones_of(step: Step) -> dict[str, str]:
    """Names of the pretrained models of a measurement, by the option that names them.

    The checkpoint says which it was trained with; an option of the measurement itself wins over that.

    Raises:
        FileNotFoundError: If the checkpoint is gone.
    """
    given = dict(re.findall(rf"--policy\.({'|'.join(_OPTIONS)})=(\S+)", step.command))
    config: dict[str, Any] = {}
    if path := re.search(r"--policy\.path=(\S+)", step.command):
        config = json.loads((ROOT / path[1] / "config.json").read_text(encoding="utf-8"))
    named = {option: config[option] for option in _OPTIONS if config.get(option)}
    if config.get("train_language_model"):
        named["language_model"] += ", trained along"
    return named | given


def column_of(backbones: dict[str, str]) -> Column:
    """The column for figures that were obtained with these models."""
    models = {option: name for option, name in backbones.items() if name != "none"}
    if not models:
        return Column.NONE
    if all(name == HUB_MODELS.get(option) for option, name in models.items()):
        return Column.HUB
    return Column.EMBEDDED if {*models.values()} == {"embedded"} else Column.MIXED


@dataclass(frozen=True)
class Measurement:
    """A step that has measured something.

    Attributes:
        step: The step.
        record: How it was run.
        backbones: See `backbones_of`.
        column: See `column_of`.
    """

    step: Step
    record: Record
    backbones: dict[str, str]
    column: Column

    @property
    def folder(self) -> Path:
        """Where its results lie."""
        return ROOT / self.step.output


def read_measurements(plan: Plan) -> list[Measurement]:
    """All measurements of a plan that are whole, and whose checkpoint still says with what they were made."""
    found = []
    for step in plan.steps:
        record = read_record(plan, step)
        if step.measures and record and is_whole(plan, step):
            with suppress(FileNotFoundError):
                backbones = backbones_of(step)
                found.append(Measurement(step, record, backbones, column_of(backbones)))
    return found


@dataclass(frozen=True)
class Share:
    """So many of so many."""

    hits: int
    total: int

    @property
    def percent(self) -> float:
        """The share in percent."""
        return 100 * self.hits / self.total

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval in percent."""
        low, high = wilson(self.hits, self.total)
        return 100 * low, 100 * high

    def __str__(self) -> str:
        low, high = self.interval
        return f"{self.percent:.1f} % ({low:.1f} to {high:.1f}), n {self.total}"


def count_outcomes(measured: Iterable[Measurement]) -> Counter[str]:
    """How often each outcome happened, and each kind of failure where it was recorded."""
    counts = Counter[str]()
    for each in measured:
        for evaluation in read_evaluations(each.folder / "eval_info.json"):
            for trial in evaluation.trials:
                counts[trial.outcome] += 1
                if trial.episode and trial.episode.failure:
                    counts[trial.episode.failure] += 1
    return counts


def share_of(counts: Counter[str], *outcomes: Outcome) -> Share:
    """The share of episodes with one of these outcomes."""
    return Share(sum(counts[each] for each in outcomes), sum(counts[each] for each in Outcome))


@dataclass(frozen=True)
class Figure:
    """A figure of `owlxt5-evaluate`, of one seed or of several.

    Attributes:
        value: The figure, or the mean of the seeds' figures.
        low: Lower end of its interval over episodes; of several seeds the lowest figure.
        high: Upper end of it; of several seeds the highest figure.
        seeds: How many seeds.
        episodes: Of each seed.
    """

    value: float
    low: float
    high: float
    seeds: int
    episodes: int

    def __str__(self) -> str:
        of = f"{self.seeds} seeds, " if self.seeds > 1 else ""
        return f"{self.value:.2f} % ({self.low:.2f} to {self.high:.2f}), {of}n {self.episodes}"


def read_figure(measured: Iterable[Measurement], mode: str, variant: str, key: str) -> Figure | None:
    """A figure of `owlxt5-evaluate`; None where the policy was not trained in the mode."""
    found, episodes = [], 0
    for each in measured:
        results = json.loads((each.folder / "results.json").read_text(encoding="utf-8"))
        rows = [row for row in results["rows"] if (row["mode"], row["variant"]) == (mode, variant)]
        found += [row[key] for row in rows if key in row]
        episodes = results["episodes"]
    if not found:
        return None
    if len(found) == 1:
        [only] = found
        return Figure(only["value"], only["low"], only["high"], 1, episodes)
    values = [each["value"] for each in found]
    return Figure(fmean(values), min(values), max(values), len(values), episodes)


def read_cells(measured: Iterable[Measurement]) -> dict[str, Share]:
    """How often all commands of an episode were carried out rightly, in each cell of `robustness.py`."""
    right, total = Counter[str](), Counter[str]()
    for each in measured:
        for cell, rewards in _episodes(each.folder / "cells.jsonl"):
            total[cell] += 1
            right[cell] += min(rewards) >= Outcome.SUCCESSFUL.reward
    return {cell: Share(right[cell], total[cell]) for cell in total}


def _episodes(path: Path) -> Iterator[tuple[str, list[float]]]:
    """Cell and rewards of the commands of each episode."""
    for line in path.read_text(encoding="utf-8").splitlines():
        record = json.loads(line)
        for episode in record["episodes"]:
            yield record["cell"], [told["reward"] for told in episode]
