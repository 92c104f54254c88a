# SPDX-License-Identifier: Apache-2.0
"""How a policy listens: what a task asks for, and who understands words that no training had."""

from collections.abc import Sequence
from functools import cached_property

from .backbones.pretrained import EMBEDDED
from .backbones.understanding import Understanding, Understood
from .commands.answer import Action, Request, Target
from .commands.instruction import Instruction, TaskReader, target_of
from .commands.parser import named_objects, parse_command
from .configuration_crossmodal import NO_UNDERSTANDING, CrossmodalConfig


class Listener:
    """Makes instructions of tasks.

    Args:
        config: The policy's. Its `tasks`, which grow in training, are read at each task.
        names_objects: Whether the policy's visual encoder looks for an object by its name.
    """

    def __init__(self, config: CrossmodalConfig, names_objects: bool) -> None:
        self._config, self._names_objects = config, names_objects

    def instruct(self, task: str, before: Target | None, agreed: Request | None = None) -> Instruction:
        """What a task asks for.

        Args:
            task: In a person's words, or a dataset's.
            before: What was spoken of last: "it".
            agreed: What it means, if a person has agreed to that.
        """
        reader = self._reader
        instruction = reader.read_task(task)
        if instruction is not None:
            return instruction
        if agreed is not None:
            return reader.read_answer(agreed, True, before)
        if self._understanding is None:
            return reader.read_words(task)
        understood = self._understanding(task)
        return reader.read_answer(understood.answer, understood.sure, before, understood.unknown)

    def instruct_later(self, actions: Sequence[Action], before: Target | None) -> Instruction:
        """What is to be done next, of several things that were asked for in one sentence."""
        return self._reader.read_answer(Request((*actions,)), True, before)

    def understand(self, sentence: str) -> Understood:
        """What a sentence asks for, before it is an instruction."""
        command = self._reader.command(sentence)
        if command is None and self._understanding:
            return self._understanding(sentence)
        command = command or parse_command(sentence)
        return Understood(Request((Action(command.verb, target_of(command.object)),)), 1.0, True)

    def in_english(self, name: str) -> str:
        """What a thing is called in English; the name itself where nobody knows German."""
        return self._understanding.in_english(name) if self._understanding else name

    @property
    def labels(self) -> list[str]:
        """Names of the things in the tasks of the training."""
        return named_objects(self._config.tasks or [])

    @property
    def _reader(self) -> TaskReader:
        return TaskReader(tuple(self._config.tasks or ()), self._names_objects)

    @cached_property
    def _understanding(self) -> Understanding | None:
        """Loaded when something is said that no training had. It is no part of a checkpoint."""
        config = self._config
        if config.understanding == NO_UNDERSTANDING:
            return None
        if config.understanding == EMBEDDED:
            # Nothing was trained with it, so a checkpoint takes what the installed package has.
            return Understanding(EMBEDDED)
        understanding = Understanding(config.understanding, config.understanding_revision)
        config.understanding_revision = understanding.revision
        return understanding
