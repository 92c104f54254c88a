# SPDX-License-Identifier: Apache-2.0
"""What a policy makes of a task: what to look for, what to ask the language model, and what to say."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

from .parser import Command, object_name, parse_command, plain, with_article
from .prompts import MAX_CHARACTERS, execute_prompt

TOO_LONG = f"I hold still, because a command may have at most {MAX_CHARACTERS} characters: say it in fewer."
TOO_FAR = "I hold still, because my arms are too far from where I learnt to begin: move them back there."

NOTHING_MOVED = "nothing moved"
"""What `describe` answers when there is nothing to describe."""
NOTHING_KNOWN = "I know none of the objects that I see."
"""What `describe` answers when none of the labels was in view."""


@dataclass(frozen=True)
class Instruction:
    """A task, understood or refused.

    Attributes:
        command: What the parser found in it; nothing if the task is refused.
        prompt: What the language model is asked to execute; it has no word of a refused task.
        refusal: Why nothing is done; empty if the task is understood.
    """

    command: Command
    prompt: str
    refusal: str = ""

    def obstacle(self, object_found: bool, far: bool) -> str:
        """A sentence on why nothing is done; empty if the robot may move.

        A task of other training data, without a verb of ours, names no object that could be missed.

        Args:
            object_found: Whether the object was seen.
            far: Whether the arms are far from where the movements of the training data begin.
        """
        if not self.refusal and not object_found and self.command.verb:
            return f"I cannot see {with_article(object_name(self.command.object))}."
        return self.refusal or (TOO_FAR if far else "")


def interpret(
    task: str, trained: Sequence[str], can_read: Callable[[Sequence[str]], bool] | None
) -> Instruction:
    """Understand a task.

    A task of the training data is always understood, whatever its words, if it has any. Free wording is new
    to the language model: it is told the verb in words of the training data (`trained_task`).

    Args:
        task: What was said.
        trained: Tasks of the training data.
        can_read: Whether names are short enough to be looked for. None: nothing is looked for by its name, so
            that the prompt alone can have it.
    """
    if len(task) > MAX_CHARACTERS:
        return _refuse(TOO_LONG)
    command, known = parse_command(task), task in trained and bool(plain(task))
    if not command.verb:
        return Instruction(command, execute_prompt(task)) if known else _refuse(command.refusal)
    if can_read is None:
        return Instruction(command, execute_prompt(task if known else command.canonical))
    if not known and not can_read([command.object]):
        return _refuse(f"I cannot look for a name as long as {command.object!r}: use fewer words.")
    return Instruction(command, execute_prompt(trained_task(command, tuple(trained))))


def _refuse(why: str) -> Instruction:
    return Instruction(Command(None, ""), execute_prompt(""), why)


def trained_task(command: Command, trained: tuple[str, ...]) -> str:
    """The task of the training data that asks for a command's movement, whatever its object.

    Where the object is comes from the detector. Any word of its name could only mislead the language model:
    "left", "upper" or "back" in a name turned movements around. So one name stands for all: the first one of
    the training data, or the first one with this verb. The command itself, if no task has a verb of ours.
    """
    tasks, name = _with_verbs(trained)
    alike = [(other.object != name, task) for task, other in tasks.items() if other.verb == command.verb]
    if alike:
        return min(alike, key=lambda each: each[0])[1]
    return Command(command.verb, name or command.object).canonical


@cache
def _with_verbs(trained: tuple[str, ...]) -> tuple[dict[str, Command], str]:
    """The tasks that have a verb of ours, and the first object that they name, "" if there is none."""
    commands = {task: parse_command(task) for task in trained}
    tasks = {task: command for task, command in commands.items() if command.verb}
    return tasks, next((command.object for command in tasks.values()), "")
