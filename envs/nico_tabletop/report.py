# SPDX-License-Identifier: Apache-2.0
"""Outcomes and frames of what `lerobot-eval` has run: `python -m nico_tabletop.report eval_info.json …`."""

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray
from PIL import Image
from rich.console import Console
from rich.table import Table

from .scoring import Outcome
from .tasks import ACTIONS

_FRAMES, _ROWS = 4, 3  # of a video, and videos of an environment type, in the image


def outcomes(info: dict[str, Any]) -> dict[str, dict[str, Counter[Outcome]]]:
    """Count outcomes by environment type and action.

    `lerobot-eval` keeps the sum of rewards of each episode; the environment pays `Outcome.reward` once.

    Args:
        info: Contents of an `eval_info.json`.
    """
    of_reward = {outcome.reward: outcome for outcome in Outcome}
    found: dict[str, dict[str, Counter[Outcome]]] = {}
    for task in info["per_task"]:
        rewards = task["metrics"]["sum_rewards"]
        action = ACTIONS[task["task_id"]].name
        found.setdefault(task["task_group"], {})[action] = Counter(of_reward[reward] for reward in rewards)
    return found


def outcome_table(by_type: dict[str, dict[str, Counter[Outcome]]]) -> Table:
    """A row for each action and one for each environment type."""
    table = Table(title="Outcomes")
    for heading in ("environment", "action", "episodes", *Outcome, "success"):
        table.add_column(str(heading), justify="left" if heading in ("environment", "action") else "right")
    for environment, by_action in by_type.items():
        total: Counter[Outcome] = sum(by_action.values(), Counter())
        for action, count in [*by_action.items(), ("all", total)]:
            success = 1 - count[Outcome.FAILURE] / count.total()
            cells = [str(count.total()), *(str(count[outcome]) for outcome in Outcome), f"{success:.0%}"]
            total_row = action == "all"
            style = "bold" if total_row else ""
            table.add_row(environment, action, *cells, style=style, end_section=total_row)
    return table


def _frames(video: Path) -> NDArray[np.uint8]:
    """Evenly spaced frames of a video side by side."""
    with av.open(str(video)) as container:
        frames = [frame.to_ndarray(format="rgb24") for frame in container.decode(video=0)]
    chosen = np.linspace(0, len(frames) - 1, _FRAMES).round().astype(int)
    return np.concatenate([frames[index] for index in chosen], axis=1)


def main() -> None:
    """Print the table, and save an image with a row of frames for some of the videos."""
    parser = argparse.ArgumentParser(prog="python -m nico_tabletop.report", description=main.__doc__)
    parser.add_argument("eval_info", nargs="+", type=Path, help="eval_info.json of lerobot-eval")
    parser.add_argument("--image", type=Path, required=True, help="PNG file to write")
    arguments = parser.parse_args()
    by_type: dict[str, dict[str, Counter[Outcome]]] = {}
    rows = []
    for path in arguments.eval_info:
        info = json.loads(path.read_text(encoding="utf-8"))
        by_type |= outcomes(info)
        videos = [paths[0] for task in info["per_task"] if (paths := task["metrics"]["video_paths"])]
        rows += [_frames(Path(video)) for video in videos[:: max(1, len(videos) // _ROWS)][:_ROWS]]
    Image.fromarray(np.concatenate(rows)).resize((1280, 240 * len(rows))).save(arguments.image)
    console = Console()
    console.print(outcome_table(by_type))
    for path in arguments.eval_info:
        console.print(f"Videos: {path.parent / 'videos'}", soft_wrap=True)
    console.print(f"Image: {arguments.image}", soft_wrap=True)


if __name__ == "__main__":
    main()
