# SPDX-License-Identifier: Apache-2.0
"""What became of each episode, one line of JSON each: LeRobot's `eval_info.json` keeps the rewards alone."""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any

from .scoring import Failure
from .words import ABSENT, CANONICAL

EPISODES = "episodes.jsonl"
"""Name of the file, beside `eval_info.json`."""


@dataclass(frozen=True)
class Episode:
    """A finished episode.

    Attributes:
        seed: Of its reset; None if it had none.
        objects: What was on offer: name of a shipped set, or path of a YAML file.
        arrangement: What stood on the left, in the middle and on the right.
        action: CLANT's name of the environment's action, such as `PUSH-L`.
        task: What was said.
        outcome: See `scoring.Outcome`.
        failure: See `scoring.Failure`; empty if it did not fail.
        reward: Of the last step.
        words: Kind of what was said, see `words.WORDS`.
        asked: CLANT's name of the action that the words ask for; None: the named object is absent.
        poses: How the three objects were placed, see `placement.Pose`.
        conditions: In which way the start differed from the paper's setting, see `Conditions.facts`.
        distractors: Further objects, each with its pose.
    """

    seed: int | None
    objects: str
    arrangement: tuple[str, ...]
    action: str
    task: str
    outcome: str
    failure: str
    reward: float
    words: str = CANONICAL
    asked: str | None = None
    poses: tuple[Any, ...] = ()
    conditions: dict[str, Any] = field(default_factory=dict)
    distractors: tuple[Any, ...] = ()

    @property
    def right(self) -> bool:
        """Whether it was right: the named object was moved rightly, or the robot refused as it is absent."""
        return self.reward > 0

    @property
    def refused(self) -> bool:
        """Whether the robot held still, and so moved nothing."""
        return self.failure == Failure.REFUSED or (self.words == ABSENT and self.right)

    @property
    def moved_rightly(self) -> bool:
        """Whether the named object was moved as it was said; never if it is absent."""
        return self.right and not self.refused

    @property
    def some_object_moved(self) -> bool:
        """Whether an object moved, as in `scoring.why_it_failed`: the named one by 5 mm, another by 1 cm.

        What falls over or off the table moves farther than that.
        """
        return self.moved_rightly or self.failure == Failure.MOVED_WRONGLY


_JUDGED = ("moved_rightly", "some_object_moved", "refused")  # for readers of the file; we derive them again


def add_episode(file: Path, episode: Episode) -> None:
    """Append a line; several processes may do so."""
    judged = {name: getattr(episode, name) for name in _JUDGED}
    with file.open("a", encoding="utf-8") as lines:
        lines.write(json.dumps(asdict(episode) | judged, ensure_ascii=False) + "\n")


def read_episodes(file: Path) -> Iterator[Episode]:
    """Read a file of episodes, also one without words: then all is said in CLANT's.

    Raises:
        OSError: If it cannot be read.
        ValueError: If it is no such file; the message has the line.
    """
    known = {each.name for each in fields(Episode)}
    with file.open(encoding="utf-8") as lines:
        for number, line in enumerate(lines, 1):
            try:
                content = {key: value for key, value in json.loads(line).items() if key in known}
                yield Episode(**({"asked": content["action"]} | content))
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ValueError(
                    f"{file}, line {number}, is no episode that --env.output_dir records ({error!r})"
                ) from None
