# SPDX-License-Identifier: Apache-2.0
"""Draws success against the distance from the slots.

    python benchmarks/distance.py --image=distance.png --results='{slots: slots/eval_info.json, …}'

Needs `pip install matplotlib`. Each result is an `eval_info.json` of `lerobot-eval --env.placement=free
--eval.batch_size=1` with LeRobot's own seed. It does not say where objects stood; but the environment's
seeds tell, as they are counted up from there. The distance is that of the object acted on to the nearest of
CLANT's slots.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from lerobot.configs.eval import EvalPipelineConfig
from matplotlib.ticker import PercentFormatter
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from tqdm import tqdm

from lerobot_owlxt5.command_line import command
from nico_tabletop.env import TabletopEnv
from nico_tabletop.placement import SLOT_POSES
from nico_tabletop.rates import wilson
from nico_tabletop.scoring import Outcome
from nico_tabletop.tasks import ACTIONS

BINS_CM = [*pairwise((0, 1, 2, 3, 4, 5, 6, 8, 12))]
FIRST_SEED = EvalPipelineConfig.__dataclass_fields__["seed"].default


@dataclass
class DistanceConfig:
    """What to draw.

    Args:
        image: File to draw into.
        results: `eval_info.json` of each policy, by the name that the legend gives it.
    """

    image: Path
    results: dict[str, Path]


def _trials(path: Path) -> Iterator[tuple[float, float]]:
    """Distance in cm and reward of each episode."""
    tasks = json.loads(path.read_text(encoding="utf-8"))["per_task"]
    slots = np.array([(pose.x, pose.y) for pose in SLOT_POSES])
    for task in tqdm(tasks, desc=str(path.parent), unit="action"):
        action = ACTIONS[task["task_id"]]
        env = TabletopEnv(action.name, task["task_group"], placement="free")
        for number, reward in enumerate(task["metrics"]["sum_rewards"]):
            _, info = env.reset(seed=FIRST_SEED + number)
            pose = info["poses"][action.slot]
            yield 100 * np.hypot(*(slots - (pose.x, pose.y)).T).min(), reward
        env.close()


def _shares(trials: NDArray[np.float64], reward: float) -> Iterator[tuple[float, float, float, int]]:
    """Share of at least this reward in each bin, its 95 % interval (Wilson), and the number of episodes."""
    for start, end in BINS_CM:
        rewards = trials[(trials[:, 0] >= start) & (trials[:, 0] < end), 1]
        if not rewards.size:
            yield np.nan, np.nan, np.nan, 0
            continue
        right = int((rewards >= reward).sum())
        yield right / rewards.size, *wilson(right, rewards.size), rewards.size


@command("distance")
def main(config: DistanceConfig) -> None:
    """Read, count and draw."""
    figure, axes = plt.subplots(figsize=(6, 3.6), layout="constrained")
    middles = [(start + end) / 2 for start, end in BINS_CM]
    table = Table(title="Perfect, by distance of the object from the nearest slot")
    for heading in ("policy", *(f"{a} to {b} cm" for a, b in BINS_CM), "all"):
        table.add_column(heading)
    for name, path in config.results.items():
        trials = np.array([*_trials(path)])
        share, low, high, count = np.array([*_shares(trials, Outcome.PERFECT.reward)]).T
        [line] = axes.plot(middles, share, marker=".", label=name)
        axes.fill_between(middles, low, high, alpha=0.2, color=line.get_color())
        cells = [f"{each:.0%} of {int(number)}" for each, number in zip(share, count, strict=True)]
        table.add_row(name, *cells, f"{(trials[:, 1] >= Outcome.PERFECT.reward).mean():.1%} of {len(trials)}")
    axes.set(xlabel="distance from the nearest slot, cm", ylabel="perfect", ylim=(0, 1.02))
    axes.yaxis.set_major_formatter(PercentFormatter(1))
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(config.image, dpi=100)
    Console().print(table)
    print(f"Image: {config.image}")


if __name__ == "__main__":
    main()
