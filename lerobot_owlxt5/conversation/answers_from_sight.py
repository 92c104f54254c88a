# SPDX-License-Identifier: Apache-2.0
"""Answers to questions from what is seen now: no robot claims what it does not see."""

from typing import NamedTuple

from ..commands.answer import Landmark, Relation, Target
from ..commands.parser import object_name, with_article
from ..commands.referring import APART, matching, side_of
from ..commands.replies import RELATIONS_IN_WORDS, SIDES_IN_WORDS, listed
from ..scene import Scene, Thing
from .fragments import SIDE_WORDS, colour_said
from .questions import Question, singular

NEAR = 0.3
"""Things whose places differ by less are beside each other, as a share of the image (our decision)."""
_DISTANCES = {"near": "nearest to me", "far": "farthest from me"}
_NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


class Answer(NamedTuple):
    """An answer.

    Attributes:
        text: A sentence.
        thing: The one thing that it speaks of, or None.
    """

    text: str
    thing: Thing | None = None


def answer(question: Question, scene: Scene) -> Answer:
    """Answer a question about what is seen."""
    if question.kind == "side":
        return _on_side(question.detail, scene)
    if question.kind == "count":
        return _count(question.name, scene)
    if question.kind == "scene" or not question.name:
        return Answer(scene.report())
    found = _called(question.name, scene)
    english = _english(question.name, found)
    if question.kind == "exists":
        if not found:
            return Answer(f"No, I see no {english}. {scene.report()}")
        what = with_article(english) if len(found) == 1 else f"{_number(len(found))} {plural(english)}"
        return Answer(f"Yes, I see {what}, {_places(found)}.", _only(found))
    if not found:
        return _unseen(question.name, scene)
    if question.kind == "beside":
        return _beside(question.detail, found, english, scene)
    if question.kind == "colour":
        return _colour(found, english, scene)
    if question.kind == "related":
        return _related(question, found, scene)
    if question.kind == "is":
        return _is(question, found, english, scene)
    if len(found) > 1:
        return _several(found)
    return Answer(f"The {english} is {where(found[0], scene)}.", found[0])


def where(thing: Thing, scene: Scene) -> str:
    """Where a thing is: its side, what is beside it, and whether it is the nearest or the farthest."""
    others = [other for other in scene.things if other.apart_from(thing)]
    said = [SIDES_IN_WORDS[side_of(thing.place)]]
    beside = min(others, key=thing.distance, default=None)
    if beside and thing.distance(beside) < NEAR:
        said.append(f"next to the {beside.name}")
    rows = [other.place.y for other in others]
    if rows and thing.place.y > max(rows) + APART:
        said.append("nearer to me than all else")
    if rows and thing.place.y < min(rows) - APART:
        said.append("farther from me than all else")
    return ", ".join(said)


def plural(name: str) -> str:
    """More than one of it."""
    return name if name == "dice" else f"{name}{'es' if name.endswith(('s', 'x', 'sh', 'ch')) else 's'}"


def _called(name: str, scene: Scene) -> list[Thing]:
    """All things of a name in English or German, with a side if one is given, from left to right."""
    first, _, rest = name.partition(" ")
    if rest and first in SIDE_WORDS:
        things = _called(rest, scene)
        side = Target(name=rest, side=SIDE_WORDS[first])
        return [things[index] for index in matching(side, [thing.place for thing in things], [], None)]
    for word in dict.fromkeys((name, singular(name))):
        if found := scene.called_in_any_language(object_name(word), ""):
            return sorted(found, key=lambda thing: thing.place.x)
    return []


def _english(name: str, found: list[Thing]) -> str:
    """What things are called that somebody asks about: as they were found, else as it was said."""
    return found[0].name if found else object_name(name)


def _number(count: int) -> str:
    return _NUMBERS[count] if count < len(_NUMBERS) else str(count)


def _only(things: list[Thing]) -> Thing | None:
    return things[0] if len(things) == 1 else None


def _places(things: list[Thing]) -> str:
    """Where things are, from left to right."""
    return listed([SIDES_IN_WORDS[side_of(thing.place)] for thing in things], "and")


def _unseen(name: str, scene: Scene) -> Answer:
    return Answer(f"I cannot see {with_article(object_name(name))}. {scene.report()}")


def _several(found: list[Thing]) -> Answer:
    return Answer(f"I see {_number(len(found))} {plural(found[0].name)}, {_places(found)}.")


def _name_one(found: list[Thing]) -> Answer:
    return Answer(f"I see {_number(len(found))} {plural(found[0].name)}: name one of them.")


def _with_names(things: list[Thing]) -> str:
    return listed([with_article(thing.name) for thing in things], "and")


def _on_side(side: str, scene: Scene) -> Answer:
    there = _those_on(side, scene.things)
    what = _with_names(there) if there else "nothing that I know"
    return Answer(f"{(_DISTANCES | SIDES_IN_WORDS)[side].capitalize()} I see {what}.", _only(there))


def _those_on(side: str, things: list[Thing]) -> list[Thing]:
    if side in _DISTANCES:
        chosen = matching(Target(side=side), [thing.place for thing in things], [], None)
        return [things[index] for index in chosen]
    return [thing for thing in things if side_of(thing.place) == side]


def _count(name: str, scene: Scene) -> Answer:
    found = _called(name, scene) if name else scene.things
    if not found:
        return Answer(f"I see no {_english(name, found) if name else 'object that I know'}.")
    of_what = _english(name, found) if name else "object"
    what = of_what if len(found) == 1 else plural(of_what)
    more = _places(found) if name else _with_names(found)
    return Answer(f"I see {_number(len(found))} {what}: {more}.", _only(found))


def _beside(relation: str, found: list[Thing], english: str, scene: Scene) -> Answer:
    if len(found) > 1:
        return _name_one(found)
    there = _those_beside(relation, found[0], scene.things)
    place = _beside_in_words(relation, english)
    what = _with_names(there) if there else "nothing that I know"
    return Answer(f"{place[:1].upper()}{place[1:]} I see {what}.", _only(there))


def _those_beside(relation: str, mark: Thing, things: list[Thing]) -> list[Thing]:
    others = [thing for thing in things if thing.apart_from(mark)]
    target = Target(relation=Relation(relation, (Landmark(mark.name),)))
    return [others[index] for index in matching(target, [each.place for each in others], [mark.place], None)]


def _beside_in_words(relation: str, name: str) -> str:
    to_the = "to the " if relation in ("left of", "right of") else ""
    return f"{to_the}{RELATIONS_IN_WORDS[relation]} the {name}"


def _is_on_side(side: str, found: list[Thing], english: str, scene: Scene) -> Answer:
    if len(found) > 1:
        return _several(found)
    fits = any(thing is found[0] for thing in _those_on(side, _with(found[0], scene)))
    said = (_DISTANCES | SIDES_IN_WORDS)[side] if fits else where(found[0], scene)
    return Answer(f"{'Yes' if fits else 'No'}, the {english} is {said}.", found[0])


def _related(question: Question, found: list[Thing], scene: Scene) -> Answer:
    others = _called(question.other, scene)
    if not others:
        return _unseen(question.other, scene)
    for things in found, others:
        if len(things) > 1:
            return _name_one(things)
    [thing], [mark] = found, others
    if any(there is thing for there in _those_beside(question.detail, mark, _with(thing, scene))):
        return Answer(f"Yes, the {thing.name} is {_beside_in_words(question.detail, mark.name)}.", thing)
    return Answer(f"No, the {thing.name} is {where(thing, scene)}.", thing)


def _with(thing: Thing, scene: Scene) -> list[Thing]:
    """A thing that was asked for by name, and all that stands elsewhere, under what each is called best."""
    return [thing, *(other for other in scene.things if other.apart_from(thing))]


def _colour(found: list[Thing], english: str, scene: Scene) -> Answer:
    colours = [scene.colour_of(thing) for thing in found]
    if len(found) == 1:
        said = f"is {colours[0]}" if colours[0] else "has a colour that I cannot tell"
        return Answer(f"The {english} {said}.", found[0])
    each = [
        f"the one {SIDES_IN_WORDS[side_of(thing.place)]} is {colour or 'of a colour that I cannot tell'}"
        for thing, colour in zip(found, colours, strict=True)
    ]
    return Answer(f"I see {_number(len(found))} {plural(english)}: {listed(each, 'and')}.")


def _is(question: Question, found: list[Thing], english: str, scene: Scene) -> Answer:
    if question.detail in _DISTANCES | SIDES_IN_WORDS:
        return _is_on_side(question.detail, found, english, scene)
    wanted = colour_said(question.detail)
    if wanted is None:
        return Answer(f"I cannot tell. {scene.report()}")
    said = _colour(found, english, scene)
    colour = scene.colour_of(found[0])
    if len(found) > 1 or colour is None:
        return said
    return Answer(f"{'Yes' if colour == wanted else 'No'}, {said.text[:1].lower()}{said.text[1:]}", found[0])
