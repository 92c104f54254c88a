# SPDX-License-Identifier: Apache-2.0
"""LeRobot's text queries: what somebody asks a policy in the middle of a rollout, and what it says.

`lerobot-rollout --interactive=true` of LeRobot's main branch puts them beside an observation (its
`PreTrainedPolicy.generate_text`). Version 0.6.1 asks nothing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

from .commands.instruction import Instruction
from .commands.replies import NO_OBJECTS_SEEN
from .sighting import Sighting
from .validation import read_tasks

# As LeRobot's main branch names them in lerobot.utils.constants, and its kinds of queries.
QUERY_KIND, QUERY_TEXT = "query_kind", "query_text"
NEXT_SUBTASK = "next_subtask"

AS_A_TASK = "If that is my task:"
"""What comes before a sentence on what the robot would do; it does something else at that moment."""


@dataclass(frozen=True)
class Query:
    """What is asked of one robot.

    Attributes:
        text: A question or anything else, in a person's words; for a subtask the goal.
        wants_subtask: Whether the answer becomes the robot's next task.
    """

    text: str
    wants_subtask: bool

    @classmethod
    def of(cls, batch: Mapping[str, Any]) -> Self:
        """Read the query of a batch of one robot; without one, its task is what is asked.

        Raises:
            ValueError: If the batch is of several robots, or the query is no text.
        """
        tasks = read_tasks(batch)
        if len(tasks) != 1:
            raise ValueError(
                f"generate_text answers for one robot, and the batch is of {len(tasks)}: ask for each alone."
            )
        text = batch.get(QUERY_TEXT, tasks[0])
        if not isinstance(text, str):
            raise ValueError(f"'{QUERY_TEXT}' must be one text, and is a {type(text).__name__}.")
        return cls(text, batch.get(QUERY_KIND) == NEXT_SUBTASK)


def answer(instruction: Instruction, sighting: Sighting) -> str:
    """What to say about something that nobody carries out now.

    Args:
        instruction: What it was understood as.
        sighting: What was seen of what it names.
    """
    said = instruction.obstacle(sighting.problem, far=False) or instruction.intention(sighting.name)
    # Whoever sees no objects has no answer: that it holds still would be said of a robot that may move.
    return said if instruction.asks and said != NO_OBJECTS_SEEN else f"{AS_A_TASK} {said}"
