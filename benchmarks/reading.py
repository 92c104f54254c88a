# SPDX-License-Identifier: Apache-2.0
"""How fast training reads datasets: python benchmarks/reading.py --dataset_roots='[data/clant, data/claeo]'.

For each LeRobotDataset: its size, the processor time that loading one item for owlxt5 takes, and, from
`lerobot-train` at the paper's sizes (batch 64, two workers, a T5-small with random weights, no detector), the
seconds of a step that go into waiting for data and into the update.
"""

import re
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

import torch
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.datasets.factory import resolve_delta_timestamps
from rich.console import Console
from rich.table import Table

from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config

ITEMS = 100
STEPS, LOGGED = 40, 20  # the first steps find what the workers have fetched before
_T5_SMALL = (
    "--d_model=512",
    "--d_kv=64",
    "--d_ff=2048",
    "--num_layers=6",
    "--num_heads=8",
    "--vocab_size=32128",
)


@dataclass
class ReadingConfig:
    """What to read.

    Args:
        dataset_roots: Folders of LeRobotDatasets.
        train_options: Further options of `lerobot-train`, such as `[--policy.device=cuda]`.
    """

    dataset_roots: list[Path]
    train_options: list[str] = field(default_factory=list)


def _milliseconds_per_item(root: Path) -> float:
    """Processor time of one item, as the data loader's workers spend it."""
    meta = LeRobotDatasetMetadata("local/reading", root=root)
    windows = resolve_delta_timestamps(OWLxT5Config(device="cpu"), meta)
    dataset = LeRobotDataset("local/reading", root=root, delta_timestamps=windows, return_uint8=True)
    torch.set_num_threads(1)  # as in the loader's workers
    dataset[0]
    began = time.process_time()
    for index in range(ITEMS):
        dataset[index * 997 % len(dataset)]
    return 1000 * (time.process_time() - began) / ITEMS


def _seconds_per_step(root: Path, t5: Path, folder: Path, options: list[str]) -> tuple[float, float]:
    """(waiting for data, update), mean over the later steps of a short run."""
    command = [
        *("lerobot-train", "--policy.type=owlxt5", "--policy.device=cpu", "--policy.push_to_hub=false"),
        *(f"--policy.language_model={t5}", "--policy.detector=ground_truth"),
        *("--dataset.repo_id=local/reading", f"--dataset.root={root}", f"--output_dir={folder}"),
        *("--batch_size=64", "--num_workers=2", f"--steps={STEPS}", f"--log_freq={LOGGED}"),
        *("--save_checkpoint=false", "--env_eval_freq=0", *options),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    found = re.findall(r"updt_s:([\d.]+).*?data_s:([\d.]+)", done.stdout + done.stderr)
    if done.returncode or len(found) != STEPS // LOGGED:
        raise RuntimeError((done.stdout + done.stderr)[-2000:])
    update, data = (statistics.mean(map(float, column)) for column in zip(*found[1:], strict=True))
    return data, update


@command("reading")
def main(config: ReadingConfig) -> None:
    """Measure and print."""
    table = Table(title="Reading for owlxt5: batch 64, two workers")
    for heading in ("dataset", "kB a frame", "ms an item", "data s a step", "update s a step", "data %"):
        table.add_column(heading, justify="left" if heading == "dataset" else "right")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        t5 = folder / "t5"
        subprocess.run(
            [sys.executable, "-m", "lerobot_owlxt5.backbones.small_t5", f"--output_dir={t5}", *_T5_SMALL],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        for number, root in enumerate(config.dataset_roots):
            frames = LeRobotDatasetMetadata("local/reading", root=root).total_frames
            size = sum(path.stat().st_size for path in root.rglob("*") if path.is_file())
            item = _milliseconds_per_item(root)
            data, update = _seconds_per_step(root, t5, folder / str(number), config.train_options)
            share = 100 * data / (data + update)
            numbers = (
                f"{size / frames / 1000:.1f}",
                f"{item:.1f}",
                f"{data:.2f}",
                f"{update:.2f}",
                f"{share:.0f}",
            )
            table.add_row(root.name, *numbers)
            print(root.name, *numbers, sep="\t", flush=True)
    Console().print(table)


if __name__ == "__main__":
    main()
