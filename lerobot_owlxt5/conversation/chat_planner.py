# SPDX-License-Identifier: Apache-2.0
"""The planner that asks a language model on a server, within what the rules allow.

It is used only where somebody has set a server's address. Rules still take the closed phrases, such as
"stop", and answers to the robot's own questions. What the understanding says must not be done, or not now, is
not even asked about. The model's movements begin at once only where the understanding is sure of the same
verbs, and of the same things if it knows what is meant; else the person is asked first (our decision).
"""

import logging
from collections.abc import Mapping, Sequence

from ..backbones.understanding import Understood
from ..commands.answer import Action, Hold, Request, Target
from ..commands.parser import with_article
from ..commands.replies import HOLDS, in_words, listed
from .chat_server import ChatServer, NotReachedError, UnusableError
from .lines import Line
from .rules import plan_by_phrases, plan_new
from .steps import Do, GoHome, Open, Remark, Say, Situation, Step
from .tools import TOOLS, UNUSABLE, Known, read_calls

URL, MODEL, KEY = "OWLXT5_PLANNER_URL", "OWLXT5_PLANNER_MODEL", "OWLXT5_PLANNER_KEY"
"""The environment variables."""
WHETHER_HOME = "Should I move my arms back? If so, say: home."
NOT_REACHED = "My planner does not answer, so I go by my own rules."
_IT = Target(reference="it")
_NEVER = ("forbidden", "conditional", "not_now")
_PROMPT = """You plan for a robot with two arms at a table. Call tools; write nothing else.
The robot sees, from left to right: {things}.
It can only push, pull or slide a thing. Call `move` only if the person wants that now, at most three times.
Name things as the robot sees them, or else in the person's own words; never name others.
If a thing, a colour or a direction is not clear, or the robot cannot do it, call `say`.
You get the last lines of the conversation. Plan for the last one."""

logger = logging.getLogger(__name__)


class ChatPlanner:
    """See `steps.Planner`.

    Args:
        server: Which model is asked.
    """

    def __init__(self, server: ChatServer) -> None:
        self.server = server

    def __call__(self, words: str, situation: Situation) -> Step:
        """What to do about some words."""
        if known := plan_by_phrases(words, situation):
            return known
        understood = situation.understand(words)
        answer = understood.answer
        if isinstance(answer, Hold) and answer.reason in _NEVER:
            return Say(HOLDS[answer.reason])
        try:
            calls = self.server.ask(_messages(words, situation), TOOLS)
        except NotReachedError as error:
            logger.warning("The planner's server did not answer: %s", error)
            return Remark(NOT_REACHED, plan_new(words, understood, situation))
        except UnusableError as error:
            logger.warning("The planner's server answered what cannot be used: %s", error)
            return Say(UNUSABLE)
        said = (line.text for line in situation.before if line.speaker == "person")
        step = read_calls(calls, Known((*said, words), situation.seen))
        match step:
            case Do(request) if not _is_sure_of(request, understood, situation.seen):
                return _asked_first(request)
            case GoHome():
                return Say(WHETHER_HOME)
        return step


def planner_of(environment: Mapping[str, str]) -> ChatPlanner | None:
    """The planner that environment variables choose; None without an address.

    Args:
        environment: Such as `os.environ`.

    Raises:
        ValueError: If an address or a key is none, or the model is missing.
    """
    url = environment.get(URL, "").strip()
    if not url:
        return None
    model = environment.get(MODEL, "").strip()
    if not model:
        raise ValueError(
            f"{URL} is set, and {MODEL} is not; set it to the name of a model that the server has"
        )
    try:
        return ChatPlanner(ChatServer(url, model, environment.get(KEY, "").strip()))
    except ValueError as error:
        raise ValueError(f"{error}; set {URL} and {KEY} anew") from None


def _messages(words: str, situation: Situation) -> list[dict[str, str]]:
    """Two messages: some models' templates take no other order of roles."""
    things = (
        listed([with_article(name) for name in situation.seen], "and") if situation.seen else "nothing yet"
    )
    lines = [f"{line.speaker}: {line.text}" for line in (*situation.before, Line("person", words))]
    return [
        {"role": "system", "content": _PROMPT.format(things=things)},
        {"role": "user", "content": "\n".join(lines)},
    ]


def _is_sure_of(planned: Request, understood: Understood, seen: Sequence[str]) -> bool:
    """Whether the understanding is sure that these movements are asked for, in this order."""
    own = understood.answer
    return (
        isinstance(own, Request)
        and understood.sure
        and own.clear
        and len(own.actions) == len(planned.actions)
        and all(_agree(*pair, seen) for pair in zip(own.actions, planned.actions, strict=True))
    )


def _agree(own: Action, planned: Action, seen: Sequence[str]) -> bool:
    """Whether a planned action is what was understood.

    "It", and a name alone that nothing seen is called by, may be anything seen; "the left one" may not.
    """
    name = own.target.phrase
    is_called = any(f" {name} " in f" {thing} " for thing in seen)
    plain = own.target == Target(name=own.target.name, colour=own.target.colour)
    may_be_any = own.target == _IT or bool(name and plain and not is_called)
    return own.verb == planned.verb and (own.target == planned.target or may_be_any)


def _asked_first(request: Request) -> Say:
    wishes = ", and then ".join(in_words(action) for action in request.actions)
    return Say(f"I am not sure what you mean. Did you mean: {wishes}?", Open("whether", request))
