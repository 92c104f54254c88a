# SPDX-License-Identifier: Apache-2.0
"""Draws learning curves.

    python benchmarks/learning.py --image=learning.png --dataset_root=data/clant
        --trainings='{owlxt5: outputs/owlxt5, crosst5: outputs/crosst5}'

Runs `owlxt5-evaluate` on every sixth episode of the test split with each checkpoint of the trainings
(`--save_freq` makes them) and draws what it says over the training steps. What is evaluated already, in
`evaluated` of the training's folder, is not evaluated again. Needs `pip install matplotlib`.
"""

import json
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from lerobot.datasets import LeRobotDatasetMetadata
from matplotlib.ticker import PercentFormatter
from tqdm import tqdm

from lerobot_owlxt5.command_line import command

CURVES = (("execute", "nrmse"), ("repeat action", "nrmse"), ("describe", "bleu2"))
EVERY = 6
TITLES = {"nrmse": "NRMSE", "bleu2": "BLEU-2"}


@dataclass
class LearningConfig:
    """What to draw.

    Args:
        image: File to draw into.
        dataset_root: Folder of CLANT as a LeRobotDataset with a split `test`.
        trainings: Output folder of each training, by the name that the legend gives it.
    """

    image: Path
    dataset_root: Path
    trainings: dict[str, Path]


def _evaluate(checkpoint: Path, dataset: Path, episodes: list[int], output: Path) -> list[dict[str, Any]]:
    """The rows of the checkpoint's results."""
    results = output / "results.json"
    if not results.exists():
        command = ["owlxt5-evaluate", f"--policy.path={checkpoint / 'pretrained_model'}"]
        command += ["--dataset.repo_id=local/clant", f"--dataset.root={dataset}", f"--output_dir={output}"]
        command += [f"--dataset.episodes={episodes}"]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    rows: list[dict[str, Any]] = json.loads(results.read_text(encoding="utf-8"))["rows"]
    return rows


@command("learning")
def main(config: LearningConfig) -> None:
    """Evaluate and draw."""
    meta = LeRobotDatasetMetadata("local/clant", root=config.dataset_root)
    start, end = map(int, (meta.info.splits or {})["test"].split(":"))
    episodes = [*range(start, end, EVERY)]
    figure, panels = plt.subplots(1, len(CURVES), figsize=(11, 3.2), layout="constrained")
    for name, training in config.trainings.items():
        checkpoints = sorted(path for path in (training / "checkpoints").iterdir() if path.name.isdigit())
        rows = {
            int(checkpoint.name): _evaluate(
                checkpoint, config.dataset_root, episodes, training / "evaluated" / checkpoint.name
            )
            for checkpoint in tqdm(checkpoints, desc=name, unit="checkpoint")
        }
        for panel, (mode, figure_key) in zip(panels, CURVES, strict=True):
            found = {
                step: row[figure_key] for step, each in rows.items() for row in each if row["mode"] == mode
            }
            low, middle, high = (
                [estimate[key] for estimate in found.values()] for key in ("low", "value", "high")
            )
            [line] = panel.plot([*found], middle, marker=".", label=name)
            panel.fill_between([*found], low, high, alpha=0.2, color=line.get_color())
    for panel, (mode, figure_key) in zip(panels, CURVES, strict=True):
        panel.set(title=f"{mode}: {TITLES[figure_key]}", xlabel="training steps", ylim=(0, None))
        panel.yaxis.set_major_formatter(PercentFormatter())
        panel.grid(alpha=0.3)
    panels[0].legend()
    figure.savefig(config.image, dpi=100)
    print(f"Image: {config.image}")


if __name__ == "__main__":
    main()
