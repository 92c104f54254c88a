# SPDX-License-Identifier: Apache-2.0
"""A robot's few actions as tools that a language model may call, and what a call leads to.

No call is trusted. What is no call of these, or names what was neither said nor seen, moves nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ..commands.answer import MOST_ACTIONS, MOST_NAME_WORDS, SIDES, Action, Request, Target, said_words
from ..commands.colours import COLOURS, basic_colour
from ..commands.instruction import target_of
from ..commands.parser import plain, with_article
from ..commands.replies import ask_back
from ..commands.verbs import VERBS
from ..commands.vocabulary import INFORMAL, VERB_PHRASES
from .chat_server import Call
from .fragments import SIDE_WORDS, colour_said
from .questions import Question, singular
from .steps import Ask, Do, GoHome, Open, Say, Step, Stop

MOST_SAID = 200
"""A model says no more characters than these (our decision)."""
UNUSABLE = "I hold still, because my planner's answer is none that I can use: say it in other words."
TOO_MANY = f"I hold still, because I do at most {MOST_ACTIONS} things one after another: ask me for fewer."
ITS_WORDS = "My planner says: {}"
"""The robot has not seen what a model says, so it does not say it as its own."""
QUESTIONS = ("scene", "where", "count", "exists", "colour", "did", "worked", "why", "doing", "ability")
"""Kinds of `questions.Question` that need nothing but a name."""
_NO_NAMES = {"thing", "object", "one", "something"}
_IN_NO_NAME = INFORMAL | {*VERB_PHRASES}


def _tool(name: str, description: str, needed: Sequence[str] = (), **properties: Any) -> dict[str, Any]:
    parameters = {"type": "object", "properties": properties, "required": [*needed]}
    return {
        "type": "function",
        "function": {"name": name, "description": description, "parameters": parameters},
    }


_NAME = {"type": "string", "description": "A name that the robot sees, or that the person said"}
TOOLS = [
    _tool(
        "move",
        "Move one thing; call it once for each, in the order of the movements.",
        ["verb"],
        verb={"type": "string", "enum": [*VERBS], "description": "push: away from the robot; pull: closer"},
        object=_NAME,
        colour={"type": "string", "enum": [*COLOURS], "description": "Only if it was said"},
        side={"type": "string", "enum": [*SIDES], "description": "Which of several, only if it was said"},
    ),
    _tool("stop", "Hold still at once."),
    _tool("home", "Move the arms where movements begin."),
    _tool(
        "answer",
        "Let the robot answer a question from what it sees or remembers.",
        ["kind"],
        kind={"type": "string", "enum": [*QUESTIONS]},
        object=_NAME,
    ),
    _tool(
        "say",
        "Ask back, or say that the robot cannot do it; one short sentence in English.",
        ["text"],
        text={"type": "string", "maxLength": MOST_SAID},
    ),
]
"""Schemas for the chat-completions API."""
_ARGUMENTS = {tool["function"]["name"]: tool["function"]["parameters"] for tool in TOOLS}


@dataclass(frozen=True)
class Known:
    """What a call may name.

    Attributes:
        said: Sentences that the person said.
        seen: What things are called that the robot sees.
    """

    said: tuple[str, ...]
    seen: tuple[str, ...]

    def has_name(self, name: str) -> bool:
        """Whether a name was seen, or said in the singular or the plural: its words one after another."""
        if name in self.seen:
            return True
        if _IN_NO_NAME & {*name.split()}:
            return False
        said = [[singular(word) for word in said_words(sentence)] for sentence in self.said]
        texts = (*self.seen, *map(" ".join, said), *(" ".join(said_words(each)) for each in self.said))
        return any(f" {name} " in f" {text} " for text in texts)

    def has_colour(self, colour: str) -> bool:
        """Whether one of `COLOURS` was said, in whatever word, or is part of a name that was seen."""
        return colour in {colour_said(word) for text in (*self.said, *self.seen) for word in said_words(text)}

    def has_side(self, side: str) -> bool:
        """Whether one of `SIDES` was said."""
        return side in {SIDE_WORDS.get(word) for sentence in self.said for word in said_words(sentence)}


def read_calls(calls: Sequence[Call], known: Known) -> Step:
    """What calls lead to: movements one after another, or one step of another kind.

    Args:
        calls: In their order.
        known: What they may name.
    """
    calls = [Call(call.name, _given(call.arguments)) for call in calls]
    if not calls or not all(_has_form(call) for call in calls):
        return Say(UNUSABLE)
    names = [call.name for call in calls]
    if "stop" in names:
        return Stop()
    if {*names} == {"move"}:
        return _movements(calls, known) if len(calls) <= MOST_ACTIONS else Say(TOO_MANY)
    return _single(calls[0], known) if len(calls) == 1 else Say(UNUSABLE)


def _given(arguments: dict[str, Any]) -> dict[str, Any]:
    """Arguments without those that a model left empty."""
    return {name: value for name, value in arguments.items() if value not in (None, "")}


def _has_form(call: Call) -> bool:
    """Whether a call fits a tool's schema."""
    schema = _ARGUMENTS.get(call.name)
    if schema is None or not {*schema["required"]} <= {*call.arguments} <= {*schema["properties"]}:
        return False
    return all(
        isinstance(value, str)
        and value.isprintable()
        and len(value) <= MOST_SAID
        and value in schema["properties"][name].get("enum", (value,))
        for name, value in call.arguments.items()
    )


def _single(call: Call, known: Known) -> Step:
    if call.name == "home":
        return GoHome()
    if call.name == "say":
        return Say(ITS_WORDS.format(" ".join(call.arguments["text"].split())))
    name = _name(call)
    if name and not known.has_name(name):
        return Say(f"{_unknown(with_article(name))} What do you want to know?")
    return Ask(Question(call.arguments["kind"], name))


def _movements(calls: Sequence[Call], known: Known) -> Step:
    actions = []
    for call in calls:
        target, problem = _target(call, known)
        action = Action(call.arguments["verb"], target)
        if not action.clear:
            return Say(f"{problem} {ask_back(action)}".strip(), Open("what", Request((action,))))
        actions.append(action)
    return Do(Request(tuple(actions)))


def _target(call: Call, known: Known) -> tuple[Target, str]:
    """What a movement is of; `Target()`, and why, if the person has to say that."""
    name, colour, side = _name(call), call.arguments.get("colour", ""), call.arguments.get("side", "")
    if name and (len(name.split()) > MOST_NAME_WORDS or not known.has_name(name)):
        return Target(), _unknown(with_article(name))
    target = target_of(name) if name else Target()
    if colour and not known.has_colour(colour):
        return Target(), _unknown(f"something {colour}")
    if colour and target.colour and basic_colour(target.colour) != colour:
        return Target(), _unknown(with_article(f"{colour} {name}"))
    if side and not known.has_side(side):
        return Target(), "You did not say which one."
    return replace(target, colour=target.colour or colour, side=side), ""


def _unknown(what: str) -> str:
    return f"I neither see nor heard of {what}."


def _name(call: Call) -> str:
    """The name that a call has; empty for one that is none."""
    name = plain(" ".join(said_words(call.arguments.get("object", ""))))
    return "" if name in _NO_NAMES else name
