# SPDX-License-Identifier: Apache-2.0
"""How a checkpoint does in other situations than it learnt in, and whether it knows what it did.

    python benchmarks/robustness.py --policy.path=CHECKPOINT [--cells=slots,free] [--objects=clant]

Each cell (`cells.CELLS`) has some scenes for each of the twelve actions, the same for every policy. Prints
how often the named object was moved rightly and perfectly, with Wilson's 95 % intervals; how often a failed
movement was reported as a success, and a success was not; and how long the policy takes. What is measured is
kept in a file, where a run that was broken off goes on. Uses one core; several runs may share the file.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import draccus
import torch
from cells import CELLS, Cell
from lerobot.configs import parser
from rich.console import Console
from rich.table import Table
from rollout import Rollout, Times, Told
from tqdm import tqdm
from understanding import rate

from lerobot_owlxt5.command_line import check_given, check_numbers, run_with_policy
from lerobot_owlxt5.evaluation.cli import load_policy
from lerobot_owlxt5.executing_policy import ExecutingPolicy
from nico_tabletop.objects import read_objects
from nico_tabletop.simulation import TabletopSimulation
from nico_tabletop.tasks import ACTIONS

DISPLACED = tuple(name for name, cell in CELLS.items() if cell.displaced_cm)
"""Here others move the object too, and a policy that compares two images cannot know who did."""


@dataclass
class RobustnessConfig:
    """Measure a checkpoint of owlxt5 or crosst5 (--policy.path) in the cells of the table."""

    # Names of cells, separated by commas; all when unset.
    cells: str | None = None
    # Objects on the table, as --env.objects.
    objects: str = "claeo"
    # Scenes of each action in a cell.
    scenes: int = 8
    # Of the scenes.
    seed: int = 0
    # JSON lines: what was measured, of any checkpoint.
    results: Path = Path("outputs/robustness.jsonl")

    @classmethod
    def __get_path_fields__(cls) -> list[str]:
        """LeRobot's parser leaves `--policy.path`, and the other `--policy` options with it, to us."""
        return ["policy"]


@dataclass(frozen=True)
class Measured:
    """A cell of a checkpoint.

    Attributes:
        episodes: What became of the commands of each.
        times: Of each command that was carried out from home, without a break.
    """

    episodes: list[list[Told]]
    times: list[Times]


def choose_cells(names: str | None) -> list[str]:
    """The cells of a list with commas; all of them if it is None.

    Raises:
        ValueError: If there is no such cell.
    """
    chosen = [name.strip() for name in names.split(",")] if names else [*CELLS]
    if unknown := [name for name in chosen if name not in CELLS]:
        raise ValueError(f"--cells names {unknown[0]!r}, but the cells are {', '.join(CELLS)}")
    return chosen


def fingerprint(policy: ExecutingPolicy) -> str:
    """What tells a checkpoint from others, wherever it lies: a hash of its weights and options."""
    options = {key: value for key, value in draccus.encode(policy.config).items() if key != "pretrained_path"}
    digest = hashlib.sha256(json.dumps(options, sort_keys=True, default=str).encode())
    for name, weights in sorted(policy.state_dict().items()):
        digest.update(name.encode() + weights.detach().cpu().contiguous().numpy().tobytes())
    return digest.hexdigest()[:16]


def read_results(path: Path, key: dict[str, Any]) -> dict[str, Measured]:
    """The cells that were measured with a checkpoint, objects, scenes and a seed, by name."""
    found = {}
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    for record in map(json.loads, lines):
        if record["key"] == key:
            episodes = [[Told(**told) for told in episode] for episode in record["episodes"]]
            found[record["cell"]] = Measured(episodes, [Times(**times) for times in record["times"]])
    return found


def add_result(path: Path, key: dict[str, Any], name: str, measured: Measured) -> None:
    """Add a cell that was measured to the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps({"key": key, "cell": name, **asdict(measured)}) + "\n")


def measure(rollout: Rollout, cell: Cell, config: RobustnessConfig, bar: "tqdm[Any]") -> Measured:
    """Play all episodes of a cell."""
    objects = read_objects(config.objects)
    rollout.times.clear()
    episodes = []
    for scene in range(config.scenes):
        for action in ACTIONS:
            episodes.append(rollout.play(cell, cell.draw(objects, action, scene, config.seed)))
            bar.update()
    return Measured(episodes, [*rollout.times])


def share(hits: Iterable[bool]) -> str:
    """A share in percent with its interval and what it is of; nothing of nothing."""
    counted = [*hits]
    return f"{rate(sum(counted), len(counted), 1)} of {len(counted)}" if counted else "of 0"


def false_claims(told: Iterable[Told]) -> Iterator[bool]:
    """Of each movement that failed and was reported: was it reported as a success?"""
    return (each.claims for each in told if each.reported and not each.reward)


def missed_successes(told: Iterable[Told]) -> Iterator[bool]:
    """Of each success that was reported: was it not reported as one?"""
    return (not each.claims for each in told if each.reported and each.reward)


def rates(about: str, measured: dict[str, Measured]) -> Table:
    """The table of cells; an episode is right if all its commands are."""
    table = Table(title=f"{about}; Wilson's 95 % intervals")
    table.add_column("cell")
    table.add_column("n", justify="right")
    for heading in ("moved rightly", "perfect", "failed, claims success", "right, not recognised"):
        table.add_column(heading, justify="right")
    for name, cell in measured.items():
        least = [min(told.reward for told in episode) for episode in cell.episodes]
        shown = [rate(sum(reward >= wanted for reward in least), len(least), 1) for wanted in (0.5, 1.0)]
        table.add_row(CELLS[name].about, str(len(least)), *shown, *_honesty(_all_told([cell])))
    table.add_section()
    everywhere = {
        "all commands": [*measured],
        "all but displaced": [n for n in measured if n not in DISPLACED],
    }
    for title, names in everywhere.items():
        told = _all_told([measured[name] for name in names])
        table.add_row(title, str(len(told)), "", "", *_honesty(told))
    return table


def _all_told(cells: Sequence[Measured]) -> list[Told]:
    return [told for cell in cells for episode in cell.episodes for told in episode]


def _honesty(told: Sequence[Told]) -> tuple[str, str]:
    return share(false_claims(told)), share(missed_successes(told))


def durations(measured: dict[str, Measured]) -> Table:
    """The table of times: median and longest, milliseconds."""
    times = [each for cell in measured.values() for each in cell.times]
    table = Table(title="select_action with its processors, on one core")
    for heading in ("step", "median, ms", "longest, ms"):
        table.add_column(heading, justify="left" if heading == "step" else "right")
    rows = {
        "first: look and plan": [each.first for each in times],
        "the detector's part: an image": [each.detector for each in times if each.detector is not None],
        "later, mean of a command": [each.later for each in times],
        "last: look again, report": [each.last for each in times],
    }
    for name, seconds in rows.items():
        if seconds:
            table.add_row(name, f"{1000 * median(seconds):.1f}", f"{1000 * max(seconds):.1f}")
    return table


@parser.wrap()
def _robustness(config: RobustnessConfig) -> None:
    check_given(config)
    check_numbers(config, "scenes")
    names = choose_cells(config.cells)
    torch.set_num_threads(1)
    policy, before, after = load_policy()
    key = {
        "policy": fingerprint(policy),
        "objects": config.objects,
        "scenes": config.scenes,
        "seed": config.seed,
    }
    missing = [name for name in names if name not in read_results(config.results, key)]
    rollout = Rollout(policy, (before, after), TabletopSimulation(read_objects(config.objects)))
    with tqdm(total=len(missing) * config.scenes * len(ACTIONS), unit="episode") as bar:
        for name in missing:
            bar.set_description(name)
            add_result(config.results, key, name, measure(rollout, CELLS[name], config, bar))
    known = read_results(config.results, key)
    measured = {name: known[name] for name in names}
    console = Console(width=150, highlight=False)
    console.print(rates(f"{policy.config.pretrained_path}, {config.objects}", measured))
    console.print(durations(measured))


def main() -> None:
    """Entry point; an error that the user can mend ends in one message and exit status 1."""
    run_with_policy("robustness", RobustnessConfig, _robustness)


if __name__ == "__main__":
    main()
