# SPDX-License-Identifier: Apache-2.0
"""How `owlxt5-talk` holds: python benchmarks/visitors.py --minutes=60 [--policy.path=CHECKPOINT].

Scripted visitors talk to their robots as people at the page do, with no browser between: they say commands
and ask questions, stop a movement now and then, choose new scenes, leave and come back. Prints how long a
reply takes, how regular the picture of a movement is, and how much memory there is, minute by minute.
"""

import logging
import time
from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np
import psutil
from lerobot.configs import parser
from rich.console import Console
from rich.table import Table as RichTable
from tqdm import tqdm

from lerobot_owlxt5.command_line import check_given, check_numbers, run_with_policy
from nico_tabletop.simulation import CONTROL_HZ
from owlxt5_talk.cli import make_visitors
from owlxt5_talk.visitor import Visitor
from owlxt5_talk.visitors import Visitors
from owlxt5_talk.world import Table

_LATE = 1.5 / CONTROL_HZ
"""A picture of a movement that comes later after the one before is late, seconds."""
_POLL = 0.005
_TURNS = 12  # of a visit
_PATIENCE = 60.0  # seconds for a movement and its report


Visit = Generator[None, None, None]
"""Goes on a little each time that it is asked."""


@dataclass
class VisitorsConfig:
    """Let scripted visitors talk to their robots; `--policy.path` chooses a policy, as for owlxt5-talk."""

    # How long.
    minutes: float = 5.0
    # So many at once.
    visitors: int = 2
    # Of what they say.
    seed: int = 0

    @classmethod
    def __get_path_fields__(cls) -> list[str]:
        """LeRobot's parser leaves `--policy.path`, and the other `--policy` options with it, to us."""
        return ["policy"]


@dataclass
class Seconds:
    """What was measured of all visitors, seconds."""

    entered: list[float] = field(default_factory=list)
    replied: list[float] = field(default_factory=list)
    between_pictures: list[float] = field(default_factory=list)


def _visit(visitors: Visitors, session: str, random: np.random.Generator, seconds: Seconds) -> Visit:
    """From coming in to leaving; several visits go on in turn."""
    began = time.monotonic()
    while (visitor := visitors.enter(session)) is None:
        yield
    try:
        while not visitor.view.eyes:
            yield
        seconds.entered.append(time.monotonic() - began)
        for _ in range(_TURNS):
            yield from _turn(visitor, random, seconds)
    finally:
        visitors.leave(session)
        visitor.join()


def _turn(visitor: Visitor, random: np.random.Generator, seconds: Seconds) -> Visit:
    names = [thing.name for thing in visitor.view.things] or ["mug"]
    name = str(random.choice(names))
    verb = random.choice(
        ["push the {}", "pull the {}", "slide the {} to the left", "slide the {} to the right"]
    )
    said = random.choice(
        [verb, verb, "what do you see?", "where is the {}?", "did it work?", "what can you do?"]
    )
    said_before, asked = len(visitor.view.lines), time.monotonic()
    visitor.say(str(said).format(name))
    while len(visitor.view.lines) < said_before + 2 and time.monotonic() - asked < _PATIENCE:
        yield
    seconds.replied.append(time.monotonic() - asked)
    stops_after = 2.0 if random.random() < 0.1 else _PATIENCE
    last, view = None, visitor.view
    while view.busy and time.monotonic() - asked < _PATIENCE:
        before, view = view, visitor.view
        if view.eyes is not before.eyes:  # it is drawn anew only where something has moved
            now = time.monotonic()
            if last is not None:
                seconds.between_pictures.append(now - last)
            last = now
        if time.monotonic() - asked > stops_after:
            visitor.stop()
            stops_after = _PATIENCE
        yield
    if random.random() < 0.1:
        visitor.lay(Table("claeo", str(random.choice(["slots", "free"]))))
        while visitor.view.lines:  # the conversation begins anew
            yield


def _percentiles(values: list[float]) -> list[str]:
    if not values:
        return ["", "", ""]
    return [f"{1000 * np.percentile(values, each):.0f}" for each in (50, 95, 100)]


@parser.wrap()
def _measure(config: VisitorsConfig) -> None:
    check_given(config)
    check_numbers(config, "minutes", "visitors")
    visitors, seconds = make_visitors(config.visitors, Table()), Seconds()
    random = np.random.default_rng(config.seed)
    visits: dict[int, Visit] = {}
    count, process, memory = 0, psutil.Process(), list[tuple[float, float]]()
    began = time.monotonic()
    with tqdm(total=round(60 * config.minutes), unit="s") as bar:
        while (elapsed := time.monotonic() - began) < 60 * config.minutes:
            for place in range(config.visitors):
                if place not in visits:
                    count += 1
                    visits[place] = _visit(visitors, f"visit {count}", random, seconds)
                if next(visits[place], "over") == "over":
                    del visits[place]
            if elapsed >= 60 * len(memory):
                memory.append((elapsed / 60, process.memory_info().rss / 2**20))
            bar.update(int(elapsed) - bar.n)
            time.sleep(_POLL)
    for visit in visits.values():
        visit.close()
    table = RichTable(
        title=f"{count} visits, {config.visitors} at once, {config.minutes:g} minutes; milliseconds"
    )
    for heading in ("", "n", "median", "95 %", "longest"):
        table.add_column(heading, justify="left" if not heading else "right")
    rows = {
        "from coming in to the first picture": seconds.entered,
        "first reply": seconds.replied,
        "between two pictures of a movement": seconds.between_pictures,
    }
    for name, values in rows.items():
        table.add_row(name, str(len(values)), *_percentiles(values))
    late = np.mean([each > _LATE for each in seconds.between_pictures]) if seconds.between_pictures else 0.0
    console = Console(width=120)
    console.print(table)
    console.print(f"late pictures (after more than {1000 * _LATE:.0f} ms): {late:.1%}")
    console.print("memory, MiB: " + ", ".join(f"{mib:.0f} after {at:.0f} min" for at, mib in memory))


def main() -> None:
    """Entry point; an error that the user can mend ends in one message and exit status 1."""
    logging.getLogger("httpx").setLevel(logging.WARNING)
    run_with_policy("visitors", VisitorsConfig, _measure)


if __name__ == "__main__":
    main()
