# SPDX-License-Identifier: Apache-2.0
"""Outcomes, rates and frames of what `lerobot-eval` has run: `python -m nico_tabletop.report FILE …`.

A file is an `eval_info.json` or an `episodes.jsonl`. `--compare` compares two of them by a paired test.
"""

import argparse
import json
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont
from rich.console import Console
from rich.table import Table

from .rates import comparison_table, rates_table
from .record import EPISODES, Episode, read_episodes
from .scoring import Failure, Outcome
from .tasks import ACTIONS

_FRAMES, _ROWS = 4, 3  # of a video, and videos of an evaluation, in the image
_WIDTH, _HEIGHT, _LINE = 1280, 240, 26  # of a row of frames, and of the line above it


@dataclass(frozen=True)
class Trial:
    """An evaluated episode.

    Attributes:
        action: CLANT's name of what was to be done.
        outcome: How it went.
        video: Where LeRobot put its video; None if it has none.
        episode: What the environment recorded of it; None if it recorded nothing.
    """

    action: str
    outcome: Outcome
    video: Path | None
    episode: Episode | None

    @property
    def title(self) -> str:
        """One line on what happened."""
        if (episode := self.episode) is None:
            return f"{self.action}: {self.outcome}"
        scene = ", ".join(episode.arrangement)
        words = f"{self.action}, seed {episode.seed}, “{episode.task}” ({scene}): {self.outcome}"
        return f"{words}, {episode.failure}" if episode.failure else words


@dataclass(frozen=True)
class Evaluation:
    """The episodes of an `eval_info.json`.

    Attributes:
        objects: The set of objects, LeRobot's task group.
        folder: Where the file lies.
        trials: In LeRobot's order.
    """

    objects: str
    folder: Path
    trials: list[Trial]

    @property
    def recorded(self) -> bool:
        """Whether it is known why episodes failed."""
        return all(trial.episode for trial in self.trials if trial.outcome is Outcome.FAILURE)


def read_evaluations(path: Path) -> Iterator[Evaluation]:
    """Read an `eval_info.json`, and the record of its episodes if it lies beside it.

    `lerobot-eval` keeps the sum of rewards of each episode; the environment pays `Outcome.reward` once.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is of other environments, or no such file.
    """
    try:
        yield from _read_evaluations(path)
    except (ValueError, KeyError, IndexError, TypeError) as error:
        raise ValueError(
            f"{path} is no eval_info.json of lerobot-eval with --env.type=clant or claeo ({error!r})"
        ) from None


def _read_evaluations(path: Path) -> Iterator[Evaluation]:
    folder = path.parent
    of_reward = {outcome.reward: outcome for outcome in Outcome}
    record = list(read_episodes(folder / EPISODES)) if (folder / EPISODES).exists() else []
    trials: dict[str, list[Trial]] = {}
    for task in json.loads(path.read_text(encoding="utf-8"))["per_task"]:
        metrics: dict[str, Any] = task["metrics"]
        action, rewards = ACTIONS[task["task_id"]].name, metrics["sum_rewards"]
        # In batches LeRobot runs more episodes than it counts, and workers end theirs in any order.
        episodes = sorted(
            (episode for episode in record if episode.action == action), key=lambda episode: episode.seed or 0
        )[: len(rewards)]
        if [episode.reward for episode in episodes] != rewards:  # none, or those of another run
            episodes = []
        # LeRobot's paths begin where it ran; their last three parts lie beside `eval_info.json`.
        videos = [folder / Path(*Path(video).parts[-3:]) for video in metrics.get("video_paths", [])]
        trials.setdefault(task["task_group"], []).extend(
            Trial(
                action,
                of_reward[reward],
                videos[number] if number < len(videos) else None,
                episodes[number] if episodes else None,
            )
            for number, reward in enumerate(rewards)
        )
    yield from (Evaluation(objects, folder, each) for objects, each in trials.items())


def outcome_table(evaluations: Sequence[Evaluation]) -> Table:
    """A row for each action and one for each evaluation; failures by kind where they were recorded."""
    table = Table(title="Outcomes")
    for heading in ("objects", "action", "episodes", *Outcome, *Failure, "success"):
        name = heading in ("objects", "action")
        # On 80 columns headings go over several lines, and names stay whole.
        table.add_column(str(heading), justify="left" if name else "right", no_wrap=name, overflow="fold")
    for evaluation in evaluations:
        by_action: dict[str, list[Trial]] = {}
        for trial in evaluation.trials:
            by_action.setdefault(trial.action, []).append(trial)
        for action, trials in [*by_action.items(), ("all", evaluation.trials)]:
            count = Counter(trial.outcome for trial in trials)
            kinds = Counter(trial.episode.failure for trial in trials if trial.episode)
            cells = [str(count.total()), *(str(count[outcome]) for outcome in Outcome)]
            known = not count[Outcome.FAILURE] or evaluation.recorded
            cells += [str(kinds[kind]) if known else "?" for kind in Failure]
            success = f"{1 - count[Outcome.FAILURE] / count.total():.0%}"
            total_row = action == "all"
            style = "bold" if total_row else ""
            table.add_row(evaluation.objects, action, *cells, success, style=style, end_section=total_row)
    return table


def picture(evaluations: Sequence[Evaluation]) -> Image.Image | None:
    """A row of frames for some videos of each evaluation, failures first; None without any video."""
    rows = []
    for evaluation in evaluations:
        filmed = [trial for trial in evaluation.trials if trial.video and trial.video.exists()]
        failed = [trial for trial in filmed if trial.outcome is Outcome.FAILURE]
        spread = [trial for trial in filmed if trial not in failed]
        spread = spread[:: max(1, len(spread) // _ROWS)]
        rows += [(f"{evaluation.objects} {trial.title}", trial.video) for trial in [*failed, *spread][:_ROWS]]
    if not rows:
        return None
    image = Image.new("RGB", (_WIDTH, (_HEIGHT + _LINE) * len(rows)), "white")
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(17)
    for number, (title, video) in enumerate(rows):
        top = number * (_HEIGHT + _LINE)
        draw.text((6, top + 2), title, "black", font)
        assert video is not None
        image.paste(Image.fromarray(_frames(video)).resize((_WIDTH, _HEIGHT)), (0, top + _LINE))
    return image


def _frames(video: Path) -> NDArray[np.uint8]:
    """Evenly spaced frames of a video side by side."""
    with av.open(str(video)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    chosen = np.linspace(0, len(frames) - 1, _FRAMES).round().astype(int)
    return np.concatenate([frames[index] for index in chosen], axis=1)


def _is_record(path: Path) -> bool:
    return path.suffix == Path(EPISODES).suffix


def _episodes(path: Path, evaluations: Sequence[Evaluation]) -> list[Episode]:
    """All episodes of a record; of an evaluation those that LeRobot counts."""
    if _is_record(path):
        return list(read_episodes(path))
    trials = (trial for evaluation in evaluations for trial in evaluation.trials)
    return [trial.episode for trial in trials if trial.episode is not None]


def main() -> None:
    """Print outcomes, failures and rates; save an image with a row of frames for some of the videos."""
    parser = argparse.ArgumentParser(prog="python -m nico_tabletop.report", description=main.__doc__)
    parser.add_argument(
        "files", nargs="+", type=Path, help="eval_info.json or episodes.jsonl of lerobot-eval"
    )
    parser.add_argument("--image", type=Path, help="PNG file to write")
    parser.add_argument("--compare", action="store_true", help="compare two files by a paired test")
    arguments = parser.parse_args()
    paths: list[Path] = arguments.files
    try:
        if arguments.compare and len(paths) != 2:
            raise ValueError(f"--compare takes two files; got {len(paths)}")
        read = [(path, [] if _is_record(path) else list(read_evaluations(path))) for path in paths]
        evaluations = [each for _, of_file in read for each in of_file]
        records = [(str(path), _episodes(path, of_file)) for path, of_file in read]
        compared = (
            comparison_table((records[0][0], records[1][0]), records[0][1], records[1][1])
            if arguments.compare
            else None
        )
        image = picture(evaluations) if arguments.image else None
        if image is not None:
            image.save(arguments.image)
    except (OSError, ValueError) as error:
        sys.exit(f"nico_tabletop.report: {error}")
    console = Console(highlight=False)
    if evaluations:
        console.print(outcome_table(evaluations))
    if any(episodes for _, episodes in records):
        console.print(rates_table(records))
    if compared is not None:
        console.print(compared)
    _print_details(console, evaluations)
    if arguments.image:
        console.print(
            "No image: there are no videos." if image is None else f"Image: {arguments.image}", soft_wrap=True
        )


def _print_details(console: Console, evaluations: Sequence[Evaluation]) -> None:
    """Each failure, and where the videos are."""
    for evaluation in evaluations:
        for trial in evaluation.trials:
            if trial.outcome is Outcome.FAILURE:
                console.print(f"{evaluation.objects} {trial.title}", soft_wrap=True, markup=False)
    if not all(evaluation.recorded for evaluation in evaluations):
        hint = "run lerobot-eval with --env.output_dir=<its --output_dir>"
        console.print(f"Why episodes failed (?) is not recorded: {hint}.", soft_wrap=True)
    for folder in dict.fromkeys(evaluation.folder for evaluation in evaluations):
        console.print(f"Videos: {folder / 'videos'}", soft_wrap=True)


if __name__ == "__main__":
    main()
