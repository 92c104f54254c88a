# SPDX-License-Identifier: Apache-2.0
"""Which question a question is, and about which thing: few clear rules, in English and German.

That a sentence is a question at all, the understanding says.
"""

import re
from dataclasses import dataclass

ALL = {"object", "thing", "item", "objekt", "objekte", "ding", "dinge", "gegenstand", "gegenstände", "sache"}
ALL |= {"sachen", "stuff", "teil", "teile"}
_PLURALS = {"boxes": "box", "glasses": "glass", "dice": "dice", "bälle": "ball", "bällen": "ball"}
# What may follow a thing's name and is none of it: "are there on the table", "siehst du".
_TAIL = (
    r"(?:\s+(?:on|in|at|auf|vor|there|da|dort|hier|here|do you|can you|are|is|siehst|gibt|liegen|stehen|now"
    r"|jetzt|right now|please|bitte|you|table|tisch|standing|lying|gerade|denn|eigentlich)\b.*)?$"
)
IT = "it"
"""What was spoken of last, as the name of a question's thing."""
_IT = {"it", "es", "sie", "er"}
_OF_IT = ("where", "colour", "beside", "is", "related")
_NO_THING = {"you", "me", "us", "mich", "uns", "yourself", "it", "there", "this", "that", "one", "any"}
_NO_THING |= {"some", "the", "der", "die", "das", "den"}
_ARTICLE = (
    r"(?:(?:an?|the|any|some|one|my|your|this|that|der|die|das|den|dem|eine?[nmrs]?|irgendeine?n?)\s+)?"
)


@dataclass(frozen=True)
class Question:
    """A question.

    Attributes:
        kind: Of what is seen: "scene", "where", "count", "exists", "colour", "is", "related", "side" or
            "beside". Of memory: "did", "worked", "why" or "doing". Of the robot: "ability" or "robot".
        name: Of the thing that it is about, as said, or `IT`; empty for all things.
        detail: What "is" it, on which "side", or how "beside" it or "related" (one of
            `commands.answer.RELATIONS`).
        other: To what it is "related", as said.
    """

    kind: str
    name: str = ""
    detail: str = ""
    other: str = ""


_SIDES = {"left": "left", "right": "right", "middle": "middle", "center": "middle", "centre": "middle"}
_SIDES |= {"links": "left", "rechts": "right", "mitte": "middle"}
_SIDES |= {"nearest": "near", "closest": "near", "nächsten": "near", "farthest": "far", "furthest": "far"}
_SIDES |= {"weitesten": "far"}
_RELATIONS = {"left of": "left of", "right of": "right of", "next to": "next to", "beside": "next to"}
_RELATIONS |= {"near": "next to", "close to": "next to"}
_RELATIONS |= {"behind": "behind", "in front of": "before", "links von": "left of", "rechts von": "right of"}
_RELATIONS |= {"links neben": "left of", "rechts neben": "right of", "neben": "next to", "hinter": "behind"}
_COLOUR = r"(?:colou?r|farbe)"
_NAME = r"(?P<name>.+?)"
_DEFINITE = r"(?:the|der|die|das|den|dem)\s+.+?"
_THE_ONE = rf"(?P<name>{_DEFINITE}|{'|'.join(sorted(_IT))})"
_WHICH = r"(?:what|which|was|welche\w*)\b"
_BE = r"(?:is|are|ist|sind|steht|liegt|stehen|liegen)"

_SCENE: tuple[tuple[str, str], ...] = (
    ("count", rf"(?:how many|wie ?viele?)\s+{_NAME}{_TAIL}"),
    ("colour", rf"(?:what|which)\s+{_COLOUR}\s+(?:is|has|does)\s+{_NAME}(?:\s+have)?{_TAIL}"),
    ("colour", rf"(?:what is|what's|whats)\s+the\s+{_COLOUR}\s+of\s+{_NAME}{_TAIL}"),
    ("colour", rf"(?:welche|was für eine)\s+{_COLOUR}\s+(?:hat|haben)\s+{_NAME}{_TAIL}"),
    ("where", rf"(?:where|wo)\s+{_NAME}\s+{_BE}$"),
    ("where", rf"(?:where(?:'s)?|wo)\s+(?:{_BE}\s+)?{_NAME}{_TAIL}"),
    ("beside", rf"{_WHICH}.*?\b(?P<detail>{'|'.join(_RELATIONS)})\s+{_NAME}{_TAIL}"),
    ("side", rf"{_WHICH}.*\b(?P<detail>{'|'.join(_SIDES)})\b.*"),
    ("exists", rf"(?:is there|are there|do you see|can you see|do you have|have you got)\s+{_NAME}{_TAIL}"),
    (
        "exists",
        rf"(?:gibt es|gibt's|siehst du|kannst du)\s+(?:hier\s+|da\s+)?{_NAME}(?:\s+sehen)?{_TAIL}",
    ),
    (
        "related",
        rf"{_BE}\s+{_THE_ONE}\s+(?:to the\s+)?(?P<detail>{'|'.join(_RELATIONS)})\s+"
        rf"(?P<other>{_DEFINITE}){_TAIL}",
    ),
    (
        "is",
        rf"{_BE}\s+{_THE_ONE}\s+(?:(?:on|to|in|at|auf|in der)\s+)?(?:(?:the|der|your|my|deiner|meiner)\s+)?"
        rf"(?P<detail>{'|'.join(_SIDES)})(?:\s+(?:hand\s+)?side|\s+seite)?$",
    ),
    (
        "exists",
        rf"{_BE}\s+(?:there\s+|da\s+|hier\s+)?(?P<name>(?:an?|any|eine?n?)\s+.+?){_TAIL}",
    ),
    ("is", rf"(?:is|ist)\s+{_THE_ONE}\s+(?P<detail>[^\s]+)$"),
)
# Who asks this does not ask about the robot.
_OF_A_THING = re.compile(rf"(?:(?:where|wo)\s+)?{_BE}\s+(?:{'|'.join(_IT)}|the|der|die|das|my)\b")
_MEMORY: tuple[tuple[str, str], ...] = (
    ("why", r"\b(?:why|warum|wieso|weshalb)\b|\bhow come\b"),
    ("doing", r"\bwhat are you doing\b|\bwas (?:machst|tust) du\b|\bare you (?:pushing|pulling|moving)\b"),
    ("did", r"\bwhat (?:did|have) you\b(?! got)|\bwhat (?:just )?happened\b|\bwhat was that\b"),
    ("did", r"\bwas hast du\b|\bwas ist passiert\b"),
    ("worked", r"\b(?:did|has) (?:it|that|this) work|\b(?:it|that|this) worked\b|\bsuccess"),
    ("worked", r"\bgeklappt\b|\bfunktioniert\b|\bgelungen\b"),
    ("worked", r"\bdid you\b|\bhave you (?:pushed|pulled|moved|slid|managed)\b"),
    ("worked", r"\bhast du .*\b(?:geschoben|gezogen|geschafft|bewegt)\b"),
)


def read_question(kind: str, sentence: str) -> Question:
    """Which question a sentence is.

    Args:
        kind: What the understanding takes it for: one of `commands.answer.QUESTIONS`.
        sentence: The question.
    """
    text = " ".join(re.findall(r"[\w'-]+", sentence.lower().replace("\u2019", "'")))
    text = re.sub(r"^(?:please|and|und|hey|nico|so|ok|okay|now)\s+", "", text)
    text = re.sub(r"^(?:(?:can|could|would) you )?(?:please )?tell me (?:please )?", "", text)
    if kind == "ability":
        return Question("ability")
    memory = (Question(name) for name, pattern in _MEMORY if re.search(pattern, text))
    robot = kind == "robot"
    for name, pattern in _SCENE:
        if robot and name != "side" and not _OF_A_THING.match(text):
            continue  # "what is nearest to you" is about no robot, whoever takes it for that
        if found := re.fullmatch(pattern, text):
            groups = {"detail": "", "other": ""} | found.groupdict()
            if name == "side":
                return Question("side", detail=_SIDES[groups["detail"]])
            detail = (_RELATIONS | _SIDES).get(groups["detail"], groups["detail"])
            thing = singular(_bare(groups["name"])) if name == "count" else _bare(groups["name"])
            other = _bare(groups["other"])
            if thing in _IT and name in _OF_IT:
                return Question(name, IT, detail, other)
            if thing and thing not in _NO_THING:
                return Question(name, "" if singular(thing) in ALL else thing, detail, other)
    # "Did it work?" may be taken for a question about the table.
    return next(memory, Question("robot" if robot else "scene"))


def _bare(phrase: str) -> str:
    return re.sub(rf"^{_ARTICLE}", "", phrase.strip()).strip()


def singular(phrase: str) -> str:
    """A plural's singular, as far as its end tells; other words as they are."""
    *first, last = phrase.split() or [""]
    if last in _PLURALS:
        last = _PLURALS[last]
    elif (last.endswith("s") and not last.endswith("ss") and len(last) > 3) or (
        last.endswith("en") and len(last) > 5
    ):
        last = last[:-1]
    return " ".join([*first, last])
