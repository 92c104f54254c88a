# SPDX-License-Identifier: Apache-2.0
"""What a policy makes of a task: what to look for, what to ask the language model, and what to say."""

from collections.abc import Collection
from dataclasses import dataclass

from .parser import Command, object_name, parse_command, with_article
from .prompts import execute_prompt

NOTHING_MOVED = "nothing moved"
"""What `describe` answers when there is nothing to describe."""
NOTHING_KNOWN = "I know none of the objects that I see."
"""What `describe` answers when none of the labels was in view."""


@dataclass(frozen=True)
class Instruction:
    """A task, understood or refused.

    Attributes:
        command: What the parser found in it.
        prompt: What the language model is asked to execute.
        refusal: Why nothing is done; empty if the task is understood.
    """

    command: Command
    prompt: str
    refusal: str

    def may_move(self, object_found: bool) -> bool:
        """Whether to move, given whether the object was seen.

        A task of other training data, without a verb of ours, names no object that could be missed.
        """
        return not self.refusal and (object_found or self.command.verb is None)

    def response(self, object_found: bool) -> str:
        """A sentence on what is going to be done, or on why nothing is."""
        if self.refusal:
            return self.refusal
        if self.may_move(object_found):
            return self.command.intention
        return f"I cannot see {with_article(object_name(self.command.object))}."


def interpret(task: str, trained: Collection[str]) -> Instruction:
    """Understand a task.

    The language model was not trained on free wording: it is told the same in CLANT's words. A task of the
    training data is always understood, whatever its words.

    Args:
        task: What was said.
        trained: Tasks of the training data.
    """
    command = parse_command(task)
    known = task in trained
    prompt = execute_prompt(task if known or command.verb is None else command.canonical)
    return Instruction(command, prompt, "" if known or command.verb else command.refusal)
