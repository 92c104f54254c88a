# SPDX-License-Identifier: Apache-2.0
"""What became of each episode, one line of JSON each: LeRobot's `eval_info.json` keeps the rewards alone."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

EPISODES = "episodes.jsonl"
"""Name of the file, beside `eval_info.json`."""


@dataclass(frozen=True)
class Episode:
    """A finished episode.

    Attributes:
        seed: Of its reset; None if it had none.
        objects: What was on offer: name of a shipped set, or path of a YAML file.
        arrangement: What stood on the left, in the middle and on the right.
        action: CLANT's name of what was to be done, such as `PUSH-L`.
        task: The command.
        outcome: See `scoring.Outcome`.
        failure: See `scoring.Failure`; empty if it did not fail.
        reward: Of the last step.
    """

    seed: int | None
    objects: str
    arrangement: tuple[str, ...]
    action: str
    task: str
    outcome: str
    failure: str
    reward: float


def add_episode(file: Path, episode: Episode) -> None:
    """Append a line; several processes may do so."""
    with file.open("a", encoding="utf-8") as lines:
        lines.write(json.dumps(asdict(episode), ensure_ascii=False) + "\n")


def read_episodes(file: Path) -> Iterator[Episode]:
    """Read a file of episodes."""
    with file.open(encoding="utf-8") as lines:
        yield from (Episode(**json.loads(line)) for line in lines)
