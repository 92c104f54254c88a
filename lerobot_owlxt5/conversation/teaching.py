# SPDX-License-Identifier: Apache-2.0
"""Teach by showing: somebody says what a thing is called, and the robot remembers what it looks like."""

import logging
import re
from collections.abc import Callable

from ..commands.answer import Target, said_words
from ..commands.instruction import target_of
from ..commands.parser import object_name, plain, with_article
from ..commands.replies import listed
from ..scene import Scene, Search, Thing
from .fragments import which
from .steps import Forget, Situation, Teach

logger = logging.getLogger(__name__)

CANNOT_LEARN = "I cannot learn what things look like: my detector knows names alone."
NOTHING_THERE = "I see nothing there."
UNKNOWN = "I do not know what that is. Teach me, for example: this is a padlock."
NOT_WRITTEN = "But I could not write that into the file."
FULL = "I remember as many things as I can: tell me to forget one, for example: forget the {}."
MOST_WORDS, MOST_LETTERS = 3, 30
"""A name has no more: what is longer says something else (our decision)."""
MOST_THINGS = 20
"""So many things can be taught, as each makes a look longer (our decision)."""

Point = tuple[float, float]
"""Of an image: shares of its width and height."""

_BEFORE = r"(?:(?:no|nein|look|schau)\b[\s,!]*)?(?P<subject>.+?)"
_ARTICLES = r"(?:an?|the|my|our|eine?|einen|der|die|das|meine?|meinen|unsere?)\s+"
_LESSONS = [
    re.compile(_BEFORE + means + r"(?P<name>.+)", re.IGNORECASE)
    for means in (
        # "This is the mug" teaches nothing: what "the mug" is, both know.
        r"(?:\s+(?:is|ist)|['\u2019]s)\s+(?!the\b|der\b|die\b|das\b)" + _ARTICLES,
        rf"\s+(?:is\s+called|heißt)\s+(?:{_ARTICLES})?",
    )
]
_FORGET = re.compile(
    r"(?:forget|vergiss)\s+(?:the|my|a|die|der|das|den|mein|meine|meinen)\s+(?P<name>.+)", re.I
)
_THIS = {"this", "that", "this one", "that one", "this thing", "that thing", "das", "dies", "das hier"}
_THIS |= {"das da", "dies hier", "dieses ding", "das ding"}


def read_lesson(words: str, situation: Situation) -> Teach | Forget | None:
    """What somebody wants to teach: "this is a padlock", "the left one is a trophy"; None for other words."""
    sentence = " ".join(words.split()).rstrip(".! ")
    if (wish := _FORGET.fullmatch(sentence)) and (name := _name(wish["name"])):
        return Forget(name) if name in situation.taught else None
    found = next(filter(None, (lesson.fullmatch(sentence) for lesson in _LESSONS)), None)
    name = _name(found["name"]) if found else ""
    if not found or not name:
        return None
    subject = " ".join(said_words(found["subject"]))
    if subject in _THIS:
        return Teach(name)
    kinds = [target_of(kind) for kind in situation.seen if {*kind.split()} <= {*subject.split()}]
    targets = (which(subject, asked, situation.seen) for asked in (Target(), *kinds))
    target = next(filter(None, targets), None)
    return Teach(name, target) if target else None


def _name(words: str) -> str:
    """A name that can be taught; empty for words that say more."""
    said = said_words(words)
    name = object_name(plain(" ".join(said)))
    is_short = 0 < len(name) <= MOST_LETTERS and len(said) <= MOST_WORDS
    return name if is_short and all(word.isalpha() for word in name.split()) else ""


def point_out(scene: Scene, point: Point) -> Thing | str:
    """Find what somebody points at; or say why the robot has no name for it."""
    thing = scene.at(*point)
    if thing is None:
        return NOTHING_THERE
    return UNKNOWN if all(thing.apart_from(other) for other in scene.things) else thing


def teach(
    scene: Scene, lesson: Teach, point: Point | None, spoken_of: Thing | None
) -> tuple[str, Thing | None]:
    """Remember what a thing looks like.

    Args:
        scene: What is seen now.
        lesson: What the person said.
        point: Where they pointed before, since the last movement.
        spoken_of: What was spoken of last.

    Returns:
        What to say, and the thing under its new name; None if nothing was learnt.
    """
    if not scene.can_be_taught:
        return CANNOT_LEARN, None
    if len(scene.taught) >= MOST_THINGS and lesson.name not in scene.taught:
        return FULL.format(scene.taught[0]), None
    thing = _meant(scene, lesson, point, spoken_of)
    if isinstance(thing, str):
        return thing, None
    said = f"I called it {with_article(thing.name)}, and remember now what the {lesson.name} looks like."
    return _kept(said, lambda: scene.teach(thing, lesson.name)), Thing(lesson.name, thing.box)


def _meant(scene: Scene, lesson: Teach, point: Point | None, spoken_of: Thing | None) -> Thing | str:
    """Which thing is to be remembered; or what to say where that is not clear."""
    if lesson.subject:
        found = scene.find(Search(lesson.subject))
        return found.thing or found.problem
    thing = scene.at(*point) if point else _this(scene.things, spoken_of)
    if thing or not scene.things:
        return thing or NOTHING_THERE
    names = [f"the {each.name}" for each in scene.things]
    example = f"{names[0]} is {with_article(lesson.name)}"
    return f"I see {listed(names, 'and')}. Which one is it? Say, for example: {example}."


def _this(things: list[Thing], spoken_of: Thing | None) -> Thing | None:
    """The only thing, or the one that was spoken of last, if it stands where it stood."""
    if len(things) == 1:
        return things[0]
    there = [thing for thing in things if spoken_of and not thing.apart_from(spoken_of)]
    return there[0] if len(there) == 1 else None


def forget(scene: Scene, name: str) -> str:
    """Forget what a thing looks like that was taught; what to say."""
    return _kept(f"I no longer know what the {name} looks like.", lambda: scene.forget(name))


def _kept(said: str, change: Callable[[], None]) -> str:
    """What to say when something was learnt or forgotten; a file that cannot be used is said too."""
    try:
        change()
    except (OSError, ValueError) as error:
        logger.warning("%s", error)
        return f"{said} {NOT_WRITTEN}"
    return said
