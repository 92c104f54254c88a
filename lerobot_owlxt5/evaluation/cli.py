# SPDX-License-Identifier: Apache-2.0
"""`owlxt5-evaluate`: the figures of all modes of a checkpoint on a dataset (docs/evaluation.md)."""

import datetime as dt
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from lerobot.configs import parser
from lerobot.configs.default import DatasetConfig
from lerobot.datasets import LeRobotDataset, LeRobotDatasetMetadata
from lerobot.utils.constants import ACTION, OBS_PREFIX
from rich.console import Console

from ..checkpoint import load_checkpoint, read_config
from ..command_line import check_given, check_numbers, run_with_policy
from ..configuration_crossmodal import CrossmodalConfig
from ..configuration_owlxt5 import GROUND_TRUTH
from ..data.episode_store import find_long_episode
from ..data.normalization import share_joint_range
from ..modeling_crossmodal import CrossmodalPolicy
from . import metrics
from .report import Report
from .scoring import Processor, score_policy

ALL = "all"
LIKE_TRAINED = 0.05
"""Share of its range by which a joint's ends may differ between two datasets of the same movements."""
OTHER_MOVEMENTS = (
    "the joints of this dataset move in other ranges than in the checkpoint's training data, so both come "
    "from different sources: the NRMSE compares unlike movements"
)


@dataclass
class EvaluateConfig:
    """Evaluate all modes of a checkpoint of owlxt5 or crosst5 (--policy.path) on a dataset."""

    dataset: DatasetConfig
    # Split of the dataset, or `all`.
    split: str = "test"
    # Repeat execute and describe with words that are not in the dataset.
    robustness: bool = False
    # Episodes that are evaluated together.
    batch_size: int = 8
    # Seed of these words, and of the bootstrap.
    seed: int = 1000
    # How far a video's frame may be off its time, in seconds; half a frame when unset.
    tolerance_s: float | None = None
    # Where results.json and results.md go; outputs/evaluate/<date>/<time>_<policy> when unset.
    output_dir: Path | None = None

    @classmethod
    def __get_path_fields__(cls) -> list[str]:
        """LeRobot's parser leaves `--policy.path`, and the other `--policy` options with it, to us."""
        return ["policy"]


def load_policy() -> tuple[CrossmodalPolicy, Processor, Processor]:
    """Load the checkpoint that --policy.path names, changed by the other --policy options.

    Unlike LeRobot's `make_policy` it does not show the policy the dataset, which is not to be trained on.

    Returns:
        The policy, its preprocessor and its postprocessor.

    Raises:
        ValueError: If no checkpoint is named, or its policy cannot be evaluated here.
    """
    path = parser.get_path_arg("policy")
    if path is None:
        raise ValueError("name a checkpoint with --policy.path=<folder or Hub id>")
    policy_config = read_config(path)
    if not isinstance(policy_config, CrossmodalConfig):
        raise ValueError(
            f"--policy.path={path} holds the policy '{policy_config.type}', which has not the modes that are "
            "evaluated here; owlxt5 and crosst5 have"
        )
    return load_checkpoint(policy_config)


def open_dataset(config: EvaluateConfig, policy: CrossmodalConfig) -> LeRobotDataset:
    """Open the chosen episodes, with the windows that the policy needs to describe a finished episode.

    Raises:
        FileNotFoundError: If the folder holds no dataset.
        ValueError: If the split is not there, or its episodes do not fit the policy.
    """
    options = config.dataset
    if options.root is not None and not (Path(options.root) / "meta" / "info.json").is_file():
        raise FileNotFoundError(f"--dataset.root={options.root} holds no LeRobotDataset (no meta/info.json)")
    meta = LeRobotDatasetMetadata(options.repo_id, root=options.root, revision=options.revision)
    missing = [key for key in [*(policy.input_features or {}), ACTION] if key not in meta.features]
    if missing:
        raise ValueError(f"the dataset {options.repo_id} lacks what the policy needs: {', '.join(missing)}")
    episodes = choose_episodes(meta, config.split, options.episodes)
    if sentence := find_long_episode(meta, policy.max_episode_steps, episodes):
        raise ValueError(sentence)
    seen, done = (
        [step / meta.fps for step in steps]
        for steps in (policy.describe_delta_indices, policy.episode_delta_indices)
    )
    deltas = {key: seen for key in meta.features if key.startswith(OBS_PREFIX)} | {ACTION: done}
    return LeRobotDataset(
        options.repo_id,
        root=options.root,
        episodes=episodes,
        revision=options.revision,
        video_backend=options.video_backend,
        delta_timestamps=deltas,
        tolerance_s=0.5 / meta.fps if config.tolerance_s is None else config.tolerance_s,
        return_uint8=True,
    )


def choose_episodes(meta: LeRobotDatasetMetadata, split: str, among: Sequence[int] | None) -> list[int]:
    """Choose the episodes of a split.

    Args:
        meta: The dataset's metadata, with splits such as {"test": "1080:1440"}.
        split: A split's name, or `all`.
        among: Only these episodes count, if given (--dataset.episodes).

    Raises:
        ValueError: If there is no such split, no episode in it, or not an episode that was asked for.
    """
    if unknown := [episode for episode in among or () if not 0 <= episode < meta.total_episodes]:
        raise ValueError(
            f"--dataset.episodes names episode {unknown[0]}, but {meta.repo_id} has {meta.total_episodes} "
            "episodes, counted from 0"
        )
    splits = meta.info.splits or {}
    if split == ALL:
        chosen = range(meta.total_episodes)
    elif split in splits:
        start, _, end = splits[split].partition(":")
        chosen = range(int(start), int(end))
        if chosen.stop > meta.total_episodes:
            raise ValueError(
                f"--split={split} of {meta.repo_id} is {splits[split]}, but the dataset has "
                f"{meta.total_episodes} episodes: choose --split={ALL}, and some with --dataset.episodes"
            )
    else:
        raise ValueError(
            f"the dataset {meta.repo_id} has no split '{split}'; choose --split={ALL}"
            + "".join(f" or --split={name}" for name in splits)
        )
    episodes = [episode for episode in chosen if among is None or episode in among]
    if not episodes:
        raise ValueError(
            f"no episode is left of --split={split} and --dataset.episodes={among} in {meta.repo_id}"
        )
    return episodes


def has_other_movements(postprocessor: Processor, dataset: LeRobotDataset) -> bool:
    """Whether the joints of a dataset have other ranges than in the training data: its source is another.

    A checkpoint does not name its source, but its postprocessor knows the range, as what -1 and 1 stand for.
    """
    here = share_joint_range(dataset.meta.stats)[ACTION]
    ends = torch.ones(2, len(here["max"])) * torch.tensor([[-1.0], [1.0]])
    low, high = postprocessor(ends).cpu().double().numpy()
    off = np.maximum(np.abs(here["min"] - low), np.abs(here["max"] - high))
    return bool((off > LIKE_TRAINED * (high - low)).any())


def describe_run(
    config: EvaluateConfig, policy: CrossmodalConfig, dataset: LeRobotDataset
) -> dict[str, str | int]:
    """All that the figures must not be quoted without."""
    detector = getattr(policy, "detector", f"none: {policy.type} sees whole images")
    if detector == GROUND_TRUTH:
        detector += " (the simulator's own boxes: an upper bound, no detector)"
    trained = "trained along" if policy.train_language_model else "frozen"
    return {
        "checkpoint": str(policy.pretrained_path),
        "policy": policy.type,
        "detector": detector,
        "language model": f"{policy.language_model} ({trained})",
        "dataset": config.dataset.repo_id,
        "split": config.split,
        "episodes": dataset.num_episodes,
        "seed": config.seed,
        "modes": ", ".join(mode for mode in policy.modes if policy.was_trained_in(mode)),
        "intervals": (
            f"{metrics.CONFIDENCE:.0%}, percentile bootstrap over episodes, {metrics.RESAMPLES} resamples"
        ),
    }


@parser.wrap()
def _evaluate(config: EvaluateConfig) -> None:
    check_given(config)
    check_numbers(config, "batch_size")
    policy, preprocessor, postprocessor = load_policy()
    dataset = open_dataset(config, policy.config)
    scores = score_policy(
        policy,
        preprocessor,
        postprocessor,
        dataset,
        batch_size=config.batch_size,
        robustness=config.robustness,
        seed=config.seed,
    )
    stats = dataset.meta.stats[ACTION]
    rows = scores.rows(float(np.max(stats["max"]) - np.min(stats["min"])), config.seed)
    about = describe_run(config, policy.config, dataset)
    if has_other_movements(postprocessor, dataset):
        about["warning"] = OTHER_MOVEMENTS
    report = Report(about, rows)
    console = Console(highlight=False)
    for name, value in report.about.items():
        console.print(f"{name}: {value}", soft_wrap=True, markup=False)
    console.print(report.table())
    now = dt.datetime.now()
    folder = Path("outputs/evaluate") / f"{now:%Y-%m-%d}" / f"{now:%H-%M-%S}_{policy.config.type}"
    data, text = report.save(config.output_dir or folder)
    console.print(f"Results: {data} and {text}", soft_wrap=True, markup=False)


def main() -> None:
    """Entry point; an error that the user can mend ends in one message and exit status 1."""
    run_with_policy("owlxt5-evaluate", EvaluateConfig, _evaluate)


if __name__ == "__main__":
    main()
