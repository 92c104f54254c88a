# SPDX-License-Identifier: Apache-2.0
"""What a policy makes of a task: what to look for, what to ask the language model, and what to answer."""

from dataclasses import dataclass
from functools import cache

from .answer import Action, Answer, Hold, Question, Request, Target
from .colours import split_colour
from .parser import Command, formal_command, object_name, parse_command, plain
from .prompts import MAX_CHARACTERS, execute_prompt
from .replies import (
    AT_HOME,
    HOLDS,
    NOTHING_ASKED,
    REPLIES,
    TOO_FAR,
    TOO_LONG,
    ask_back,
    ask_whether,
    in_words,
    verb_phrase,
)

HOME = "home"
"""The task to move the arms where movements begin, and nothing else."""


@dataclass(frozen=True)
class Instruction:
    """A task, understood or not.

    Attributes:
        prompt: What the language model is asked to execute; it has no word of a task that is not carried out.
        target: What to move; None where nothing is looked for.
        verb: How to move it, one of `VERBS`; None for a task of other training data.
        reply: What is said in place of a movement; empty if there is something to do.
        wants_report: Whether a look at the table is the reply.
        later: What was asked for besides, to be done after it.
        trained: Whether it is a task of the training data, which is carried out as it was trained.
        asks: Whether it is a question.
        goes_home: Whether it is the arms' way home, and nothing else.
    """

    prompt: str
    target: Target | None = None
    verb: str | None = None
    reply: str = ""
    wants_report: bool = False
    later: tuple[Action, ...] = ()
    trained: bool = False
    asks: bool = False
    goes_home: bool = False

    @property
    def needs_home(self) -> bool:
        """Whether arms that are far from where movements begin have to go there first."""
        return self.verb is not None or self.goes_home

    def request(self, target: Target | None = None) -> Request | None:
        """What it asks for, and what is to be done after it; None where nothing is to be moved.

        Args:
            target: What is meant, in other words than those that were said.
        """
        target = target or self.target
        if self.verb is None or target is None:
            return None
        return Request((Action(self.verb, target), *self.later))

    def obstacle(self, problem: str, far: bool) -> str:
        """A sentence on why nothing is done, or in place of it; empty if the robot may move.

        A task of the training data without a verb of ours names no object that could be missed.

        Args:
            problem: Why it is not clear what is meant, or what is seen.
            far: Whether the arms are far from where the movements of the training data begin.
        """
        seen = "" if self.trained and self.verb is None else problem
        return self.reply or seen or (TOO_FAR if far else "")

    def intention(self, name: str) -> str:
        """A sentence that says what is going to be done.

        Args:
            name: What the thing is called that was found.
        """
        if self.verb is None:
            return "I will do it."
        first = f"I will {verb_phrase(self.verb, f'the {object_name(name)}')}"
        if not self.later:
            return f"{first}."
        more = " and then ".join(in_words(action) for action in self.later)
        return f"{first}, and then {more}."


@dataclass(frozen=True)
class TaskReader:
    """Makes instructions out of tasks, for a policy.

    Attributes:
        trained: Tasks of the training data.
        names_objects: Whether a detector looks for an object by its name. Else the prompt alone can have it.
    """

    trained: tuple[str, ...]
    names_objects: bool

    def read_task(self, task: str) -> Instruction | None:
        """Read a task as datasets have it; None if somebody has to understand what was said.

        A task of the training data is always carried out, whatever its words, if it has any. A command in
        CLANT's own form is no free wording either.
        """
        if len(task) > MAX_CHARACTERS:
            return _reply(TOO_LONG)
        if not plain(task):
            return _reply(NOTHING_ASKED)
        trained = task in self.trained
        if task == HOME and not trained:
            return Instruction(execute_prompt(""), reply=AT_HOME, goes_home=True)
        command = self.command(task)
        if command is None:
            return None
        target = target_of(command.object) if command.verb else Target(name=command.object)
        keeps_words = trained and not (command.verb and self.names_objects)
        prompt = execute_prompt(task) if keeps_words else self._prompt(command)
        return Instruction(prompt, target, command.verb, trained=trained)

    def command(self, task: str) -> Command | None:
        """The command of a task of the training data, or in CLANT's own form; None for free wording."""
        return parse_command(task) if task in self.trained else formal_command(task)

    def read_words(self, task: str) -> Instruction:
        """Take the words as they are, as the paper does: they go to the language model and to the detector.

        The detector looks for what is behind the verb, or for all of it.
        """
        command = parse_command(task)
        return Instruction(execute_prompt(task), target_of(command.object), command.verb)

    def read_answer(
        self, answer: Answer, sure: bool, before: Target | None, unknown: tuple[str, ...] = ()
    ) -> Instruction:
        """Make an instruction of what was understood.

        Args:
            answer: What a sentence asks for.
            sure: Whether that was understood with enough confidence to act on.
            before: What was spoken of before: "it".
            unknown: Words of it that nobody knows.
        """
        match answer:
            case Hold(reason):
                return _reply(HOLDS[reason])
            case Question("scene"):
                return Instruction(execute_prompt(""), wants_report=True, asks=True)
            case Question(kind):
                return Instruction(execute_prompt(""), reply=REPLIES[kind], asks=True)
        first, *later = answer.actions
        if not first.clear:
            return _reply(ask_back(first))
        if not sure:
            return _reply(ask_whether(first, unknown))
        target, verb = first.target, first.verb or ""
        if target.reference == "it":
            if before is None:
                return _reply(f"What do you mean by it? Name what I should {verb_phrase(verb, '')}.")
            target = before
        prompt = self._prompt(Command(verb, target.phrase or "thing"))
        return Instruction(prompt, target, verb, later=(*later,))

    def _prompt(self, command: Command) -> str:
        wanted = trained_task(command, self.trained) if self.names_objects else command.canonical
        return execute_prompt(wanted)


def target_of(name: str) -> Target:
    """What the name of an object in a dataset means: CLANT's "red" is a red cube."""
    colour, kind = split_colour(object_name(name))
    return Target(name=kind, colour=colour)


def spoken_of(target: Target | None, name: str) -> Target | None:
    """What "it" means after a target was found: the same, or what it was called then.

    Args:
        target: What was said; "the other one" is another one the next time.
        name: What the thing is called that was found.
    """
    return target if target is None or (target.phrase and not target.reference) else target_of(name)


def _reply(sentence: str) -> Instruction:
    return Instruction(execute_prompt(""), reply=sentence)


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
