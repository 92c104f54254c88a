# SPDX-License-Identifier: Apache-2.0
"""Words find things: what a detector sees of one image, and which of it is meant."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from torch import Tensor

from .backbones.detections import SAME_PLACE, Candidates, Detector, Look
from .commands.answer import Landmark, Target
from .commands.colours import COLOURS, basic_colour, split_colour
from .commands.parser import object_name, with_article
from .commands.referring import Place, are_apart, distance, matching, side_of
from .commands.replies import RELATIONS_IN_WORDS, SIDES_IN_WORDS, listed
from .commands.vocabulary import THINGS

_LARGEST = 0.25
"""What fills more of the image is no thing on the table (our decision)."""
_GENERIC = {"", "thing", "object", "item", "one"}


@dataclass(frozen=True)
class Thing:
    """Something that was seen.

    Attributes:
        name: What to call it, such as "red cube".
        box: (4,), left, upper, right and lower edge as shares of the image.
    """

    name: str
    box: Tensor

    @property
    def place(self) -> Place:
        """Where it stands."""
        left, _, right, lower = self.box.tolist()
        return Place((left + right) / 2, lower)

    def distance(self, other: "Thing") -> float:
        """How far apart two things stand, as a share of the image."""
        return distance(self.place, other.place)

    def apart_from(self, other: "Thing") -> bool:
        """Whether it is another thing at another place."""
        return are_apart(self.place, other.place)


Moved = tuple[Thing, ...]
"""What a robot has moved, each thing where it was seen then."""


@dataclass(frozen=True)
class Found:
    """The thing that is meant, or why there is none.

    Attributes:
        thing: What is meant; None if nothing is, or more than one thing may be.
        problem: A sentence that asks back or says what is seen; empty if it is clear what is meant.
    """

    thing: Thing | None
    problem: str = ""


@dataclass(frozen=True)
class Search:
    """What somebody wants to be found.

    Attributes:
        target: Something that was said, not "it"; None for nothing.
        before: What was spoken of before, which is not "the other one".
        takes_best: Of several things that fit, take the one that fits best, as training does; do not ask.
        wants_report: Where there is no target: say what is seen.
    """

    target: Target | None
    before: Target | None = None
    takes_best: bool = False
    wants_report: bool = False

    @property
    def needs_objects(self) -> bool:
        """Whether more than a name and a colour is needed to find it."""
        plain = Target(name=self.target.name, colour=self.target.colour) if self.target else None
        return self.wants_report or self.target != plain


class Scene:
    """One image as a detector sees it, for as long as somebody speaks of it.

    Args:
        detector: Finds what it is asked for.
        observation: Features `observation.*` of one sample, (1, ...).
        labels: Names of what may be there, beside everyday things.
        in_english: What a name is called in English. It returns an English or unknown one as it is.

    Attributes:
        moved: What the robot has moved, each thing where it saw it then. What stands there keeps its name.
    """

    moved: Moved = ()

    def __init__(
        self,
        detector: Detector,
        observation: Mapping[str, Any],
        labels: Sequence[str],
        in_english: Callable[[str], str],
    ) -> None:
        self._detector, self._observation = detector, observation
        self._labels = [*dict.fromkeys([*self.taught, *map(object_name, labels), *THINGS])]
        self._in_english = in_english

    @cached_property
    def _look(self) -> Look:
        return self._detector.look(self._observation)

    @cached_property
    def _proposed(self) -> Candidates:
        """All boxes, scored for all labels."""
        return self._look([self._labels])

    def find(self, search: Search) -> Found:
        """Find the one thing that is meant, or say what is seen."""
        target = search.target
        if target is None:
            return Found(None, self.report() if search.wants_report else "")
        if target.phrase and not self._can_read(target.phrase, in_english=not search.takes_best):
            return Found(None, f"I cannot look for a name as long as {target.phrase!r}: use fewer words.")
        # A dataset's own names are taken as they are.
        look = self._called if search.takes_best else self.called_in_any_language
        called = look(target.name, target.colour)
        if not called:
            return Found(None, self._missing(target))
        if search.takes_best:
            return Found(called[0])
        landmarks = []
        for mark in target.relation.landmarks if target.relation else ():
            others = look(mark.name, mark.colour)
            if len(others) != 1:
                return Found(None, self._which(others) if others else self._missing(mark))
            landmarks += others
        last = self.find(Search(search.before)).thing if target.reference == "other" else None
        places, marks = ([thing.place for thing in things] for things in (called, landmarks))
        left = matching(target, places, marks, last.place if last else None)
        if not left:
            return Found(None, _contradiction(target, called))
        if len(left) > 1:
            return Found(None, self._which([called[index] for index in left]))
        return Found(called[left[0]])

    @property
    def can_be_taught(self) -> bool:
        """Whether the detector can remember what a thing looks like."""
        return self._detector.taught is not None

    @property
    def taught(self) -> list[str]:
        """Names that the detector was taught, the oldest first."""
        return [*(self._detector.taught or ())]

    def forget(self, name: str) -> None:
        """Forget what a thing looks like that was taught.

        Raises:
            ValueError, OSError: If the file of what was taught cannot be used.
        """
        assert self._detector.taught is not None
        self._detector.taught.remove(name)

    def teach(self, thing: Thing, name: str) -> None:
        """Remember what a thing looks like under a name; only for a detector that can be taught.

        Raises:
            ValueError, OSError: If the file of what was taught cannot be used.
        """
        self._detector.teach(name, self._observation, thing.box)

    def report(self) -> str:
        """Say what is seen."""
        if not self.things:
            return "I see nothing that I know."
        return f"I see {listed([with_article(thing.name) for thing in self.things], 'and')}."

    @property
    def things(self) -> list[Thing]:
        """All that is seen, each by its best label, from left to right."""
        return [self._as_moved(thing) or thing for thing in self._labelled]

    def _as_moved(self, thing: Thing) -> Thing | None:
        """A thing under the name of what the robot has moved, if it is that; a red cube is also a cube."""
        here = (moved.name for moved in self.moved if thing.distance(moved) < SAME_PLACE)
        return next((Thing(name, thing.box) for name in here if not name.endswith(thing.name)), None)

    @cached_property
    def _labelled(self) -> list[Thing]:
        """All that is seen, each by the detector's best label, from left to right.

        What looks most like a thing that was taught has its name, though it may look still more like another.
        """
        found = self._proposed.things(self._detector.threshold)
        best = found.score.argmax(dim=1).tolist()
        taught = {*self.taught} if best else set[str]()
        for label in (label for label, name in enumerate(self._labels) if name in taught):
            place = int(found.score[:, label].argmax())
            if found.score[place, label] >= self._detector.threshold:
                best[place] = label
        things = [Thing(self._labels[label], found.box[place, label]) for place, label in enumerate(best)]
        return sorted(things, key=lambda thing: thing.place.x)

    def at(self, x: float, y: float) -> Thing | None:
        """What stands at a point of the image, as shares of its width and height, under its best label.

        It may score too little to be among `things`: then somebody has to point at it.
        """
        box, score = self._proposed.box[0], self._proposed.score[0]
        point = box.new_tensor([x, y])
        there = ((box[:, :2] <= point) & (point <= box[:, 2:])).all(dim=1)
        there &= (box[:, 2:] - box[:, :2]).prod(dim=1) < _LARGEST
        if not there.any():
            return None
        best = int((score.amax(dim=1) * there).argmax())
        return Thing(self._labels[int(score[best].argmax())], box[best])

    def called(self, name: str) -> list[Thing]:
        """All things that fit an English name, such as "red cube"; what fits best comes first."""
        return self._called(name, "")

    def called_in_any_language(self, name: str, colour: str) -> list[Thing]:
        """All things of a name that was said in English or German, in a colour if one is given."""
        phrase = f"{colour} {name}".strip()
        if phrase in self.taught:
            # Two things that were taught may look a little alike.
            return self._best_called(phrase, self.taught)
        english = self._in_english(phrase) if phrase else ""
        found: list[Thing] = []
        if english.split()[-1:] != phrase.split()[-1:]:
            # The detector knows English; a word that it does not know may be any thing to it.
            their_colour, their_name = split_colour(english)
            found = self._called(their_name if name else "", their_colour if colour else "")
        return found if found or not self._can_read(phrase) else self._called(name, colour)

    def _can_read(self, phrase: str, in_english: bool = False) -> bool:
        """Whether the detector can look for a phrase, or for its English name."""
        phrases = {phrase, self._in_english(phrase)} if in_english and phrase else {phrase}
        return any(self._detector.can_read([each]) for each in phrases)

    def colour_of(self, thing: Thing) -> str | None:
        """The one of `COLOURS` that a thing has; None if its colour is not clear."""
        kind = split_colour(thing.name)[1] or thing.name
        names = [f"{colour} {kind}" for colour in COLOURS]
        found = self._look([names]).things(self._detector.threshold)
        for place, box in enumerate(found.box[:, 0]):
            best = int(found.score[place].argmax())
            if not Thing("", found.box[place, best]).apart_from(thing) or not Thing("", box).apart_from(
                thing
            ):
                return [*COLOURS][best]
        return None

    def _called(self, name: str, colour: str) -> list[Thing]:
        """All things of an English name, in a colour if one is given; what fits best comes first."""
        if not colour and name not in self._labels:
            # Whoever understood the words took the colour for a part of the name.
            its_colour, rest = split_colour(name)
            colour, name = (its_colour, rest) if rest else (colour, name)
        hue = basic_colour(colour) if colour else None
        if colour and not hue:
            return []
        if name not in _GENERIC:
            return self._of_kind(name, hue)
        if not hue:
            return self.things
        kinds = dict.fromkeys(split_colour(thing.name)[1] for thing in self.things)
        return _apart([thing for kind in kinds for thing in self._of_kind(kind, hue)])

    def _of_kind(self, kind: str, hue: str | None) -> list[Thing]:
        """All things of a kind, in one of `COLOURS` if it is given.

        Colours compete: a detector scores a blue cube as a cyan one too, but as a blue one higher.
        """
        rivals = [f"{colour} {kind}" for colour in COLOURS] if hue else [kind]
        return self._best_called(f"{hue} {kind}" if hue else kind, rivals)

    def _best_called(self, name: str, rivals: Sequence[str]) -> list[Thing]:
        """All things that a name fits, and none of its rivals better; what fits best comes first."""
        found = self._detected(name, rivals)
        if found or all(moved.name != name for moved in self.moved):
            return found
        return [thing for thing in map(self._as_moved, self._labelled) if thing and thing.name == name]

    def _detected(self, name: str, rivals: Sequence[str]) -> list[Thing]:
        """The same, as the detector sees it."""
        found = self._look([rivals]).things(self._detector.threshold)
        wanted = rivals.index(name)
        score = found.score[:, wanted]
        fits = (score >= self._detector.threshold) & (score >= found.score.amax(dim=1))
        order = [place for place in score.argsort(descending=True).tolist() if fits[place]]
        return [Thing(name, found.box[place, wanted]) for place in order]

    def _missing(self, target: Target | Landmark) -> str:
        """Say that there is no such thing, and what there is."""
        colour = target.colour
        if colour and not basic_colour(colour) and not basic_colour(self._in_english(colour)):
            return f"I do not know the colour {colour}. {self.report()}"
        name = object_name(f"{colour} {target.name or 'thing'}".strip())
        return f"I cannot see {with_article(name)}. {self.report()}"

    def _which(self, things: Sequence[Thing]) -> str:
        """Ask which of several things is meant: by their labels, or by their order where these are alike."""
        things = sorted(things, key=lambda thing: thing.place.x)
        labels = [self._label(thing) for thing in things]
        if len({*labels}) < len(labels):
            labels = [f"{side} one" for side in _row(len(things))]
        choices = listed([f"the {label}" for label in labels], "or")
        return (
            f"Which {things[0].name if len({t.name for t in things}) == 1 else 'one'} do you mean: {choices}?"
        )

    def _label(self, thing: Thing) -> str:
        """The best label of what stands at a thing's place."""
        there = (other.name for other in self.things if not other.apart_from(thing))
        return next(there, thing.name)


def _apart(things: Sequence[Thing]) -> list[Thing]:
    """The same, each place once."""
    kept: list[Thing] = []
    for thing in things:
        if all(thing.apart_from(other) for other in kept):
            kept.append(thing)
    return kept


def _row(count: int) -> list[str]:
    return {2: ["left", "right"], 3: ["left", "middle", "right"]}.get(
        count, [f"{number}." for number in range(1, count + 1)]
    )


def _contradiction(target: Target, called: Sequence[Thing]) -> str:
    """Say what was said of a thing and is not so."""
    name = called[0].name
    if target.side in SIDES_IN_WORDS and len(called) == 1:
        where, said = SIDES_IN_WORDS[side_of(called[0].place)], SIDES_IN_WORDS[target.side]
        return f"I see one {name}, and it is {where}, not {said}: say it again without a side."
    if target.relation:
        marks = [f"the {object_name(mark.phrase)}" for mark in target.relation.landmarks]
        kind = RELATIONS_IN_WORDS[target.relation.kind]
        return f"I see {with_article(name)}, but none {kind} {listed(marks, 'and')}."
    if target.order:
        return f"I see only {len(called)} of these, so none is the {' from the '.join(target.order)}."
    return f"I see only one {name}, and no other one."
