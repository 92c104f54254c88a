# SPDX-License-Identifier: Apache-2.0
"""The planner by rules: what the understanding and few closed phrases say, and nothing else.

A movement comes from a request that was understood, from a yes to it, or from words that answer the robot's
own question and nothing else. What the understanding holds back, no rule makes a movement of.
"""

import re
from dataclasses import replace

from ..backbones.understanding import Understood
from ..commands import answer as meant
from ..commands.answer import Action, Request, Target
from ..commands.parser import plain
from ..commands.prompts import MAX_CHARACTERS
from ..commands.replies import HOLDS, NOTHING_ASKED, TOO_LONG, ask_back, ask_whether
from ..commands.verbs import opposite
from .courtesies import courtesy
from .fragments import how, which
from .phrases import (
    AGAIN,
    CARRY_ON,
    DONE,
    HOME,
    IMITATE,
    NO,
    OTHER_WAY,
    STOP,
    WATCH,
    YES,
    added,
    corrected,
    says,
)
from .questions import read_question
from .steps import (
    Ask,
    Describe,
    Do,
    GoHome,
    Imitate,
    Open,
    Remark,
    Say,
    Situation,
    Step,
    Stop,
    Translate,
    Watch,
)
from .teaching import read_lesson

NOTHING_TO_REPEAT = "I hold still, because there is nothing yet that I could do again."
_TRANSLATE = "translate:"
_IT = Target(reference="it")
_FIRST_CLAUSE = re.compile(r"[,.!;:?]")


def plan_by_rules(words: str, situation: Situation) -> Step:
    """What to do about some words; see `Planner`."""
    return plan_by_phrases(words, situation) or plan_new(words, situation.understand(words), situation)


def plan_by_phrases(words: str, situation: Situation) -> Step | None:
    """What few closed phrases say, answer or correct; None for a sentence that has to be understood."""
    if len(words) > MAX_CHARACTERS:
        return Say(TOO_LONG)
    if not plain(words):
        return Say(NOTHING_ASKED)
    if words.strip().lower().startswith(_TRANSLATE):
        return Translate(words.strip()[len(_TRANSLATE) :].strip())
    if says(words, STOP):
        return Stop()
    if says(words, HOME):
        return GoHome()
    if says(words, WATCH):
        return Watch()
    if situation.watching and says(words, DONE):
        return Describe()
    if says(words, IMITATE):
        return Imitate()
    if says(words, AGAIN):
        return Do(situation.last) if situation.last else Say(NOTHING_TO_REPEAT)
    if lesson := read_lesson(words, situation):
        return lesson
    reply = _reply_to(situation.open, words, situation) if situation.open else None
    step = reply or _correction(words, situation)
    said = None if step else courtesy(words, situation.seen)
    return Remark(said) if said else step


def _reply_to(asked: Open, words: str, situation: Situation) -> Step | None:
    """What an answer to what waits for one leads to; None if the words are none."""
    if asked.kind == "stopped":
        return Do(asked.request) if says(words, CARRY_ON) else None
    if says(words, NO):
        return Say(HOLDS["forbidden"])
    action = asked.action
    if asked.kind == "whether":
        return Do(asked.request) if says(words, YES) else None
    if asked.kind == "how":
        understood = situation.understand(words)
        verb = None if _holds_back(understood) else how(words)
        if verb is None:
            same = _single(understood)
            verb = same.verb if same and same.target in (_IT, action.target) else None
        return _checked(asked.completed(replace(action, verb=verb))) if verb else None
    understood = situation.understand(words)
    target = _marked(words, action.target, understood, situation)
    if target is None:
        said = _single(understood)
        if said is None or said.verb is not None or said.target in (Target(), _IT):
            return None
        target = said.target
        if asked.kind == "which" and not target.name:
            target = replace(target, name=action.target.name)
    return _checked(asked.completed(replace(action, target=target)))


def _correction(words: str, situation: Situation) -> Step | None:
    """The last command with another thing or another way; None for words that correct nothing.

    "No, the mug" and "and the mug too" name another thing, "no, to the left" and "the other way" another way.
    """
    said, last = corrected(words) or added(words) or words, situation.last
    if last is None:
        return None
    before = last.actions[0]
    if len(last.actions) == 1 and before.verb and says(said, OTHER_WAY):
        return Do(Request((Action(opposite(before.verb), _IT),)))
    if said == words:
        return None
    action = _another(said, before, situation)
    if action is None:
        return None
    if _holds_back(situation.understand(words)):
        return Say(ask_whether(action, ()), Open("whether", Request((action,))))
    return _checked(Request((action,)))


def _another(said: str, before: Action, situation: Situation) -> Action | None:
    """The action that a correction makes of the one before; None for words that say something else."""
    understood = situation.understand(said)
    if not _holds_back(understood) and (verb := how(said)):
        return Action(verb, _IT)
    plain_target = replace(before.target, side="", colour="", order=None, reference="", relation=None)
    target = _marked(said, plain_target, understood, situation)
    if target is None:
        action = _single(understood)
        if action is None or action.verb or action.target == Target():
            return None
        named = action.target.name or action.target.reference
        target = action.target if named else replace(action.target, name=before.target.name)
    return Action(before.verb, target)


def _marked(words: str, asked: Target, understood: Understood, situation: Situation) -> Target | None:
    """What a few known words tell of a target; None where the understanding has a reason to hold still.

    That "the left one" alone is nothing to do is no such reason: it answers a question.
    """
    return None if _holds_back(understood) else which(words, asked, situation.seen)


def _holds_back(understood: Understood) -> bool:
    """Whether there is a reason not to move, more than that nothing was asked for."""
    answer = understood.answer
    return isinstance(answer, meant.Hold) and answer.reason != "not_an_action"


def plan_new(words: str, understood: Understood, situation: Situation) -> Step:
    """What a sentence leads to that answers nothing and corrects nothing."""
    match understood.answer:
        case meant.Hold(reason):
            # The rest was not understood: "okay, enough". So it ends a movement, which a courtesy does not.
            if reason == "not_an_action" and (
                said := courtesy(_FIRST_CLAUSE.split(words)[0], situation.seen)
            ):
                return Say(said)
            question = read_question("scene", words) if reason in ("not_an_action", "beyond") else None
            return Ask(question) if question and question.kind != "scene" else Say(HOLDS[reason])
        case meant.Question(kind):
            return Ask(read_question(kind, words))
        case request:
            first = request.actions[0]
            if not first.clear:
                return _asked(request)
            if not understood.sure:
                first = replace(first, target=situation.respelt(first.target) or first.target)
                request = Request((first, *request.actions[1:]))
                return Say(ask_whether(first, understood.unknown), Open("whether", request))
            return Do(request, words)


def _checked(request: Request) -> Step:
    """Do what is clear, and ask back what is not."""
    return Do(request) if request.actions[0].clear else _asked(request)


def _asked(request: Request) -> Step:
    first = request.actions[0]
    if first.verb is None and first.target == Target():
        return Say(ask_back(first))
    return Say(ask_back(first), Open("how" if first.verb is None else "what", request))


def _single(understood: Understood) -> Action | None:
    """The one action of a request that was understood for sure; None for all else."""
    answer = understood.answer
    if not isinstance(answer, Request) or not understood.sure or len(answer.actions) > 1:
        return None
    return answer.actions[0]
