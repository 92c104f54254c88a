# SPDX-License-Identifier: Apache-2.0
"""What the robot understands: python benchmarks/understanding.py [--understanding=FOLDER].

Each sentence of `owlxt5_backbones/held_out_sentences_2.tsv` is understood, and compared with what is right.
A clear wish is right; right in part, if nothing is wrong but something is missing; refused, if it is held
or asked back; or wrong. What is to be held, answered or asked back is right; held for another reason (in
part); not held or asked as it should be, but nothing moves (refused, asked back); or carried out. Prints
the table for each kind of sentence, and for English and German; rates with Wilson's 95 % intervals; and the
time a sentence. `--objects=claeo` takes the sentences of the protocol CLAEO-Plus about these objects instead.
"""

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import cycle
from pathlib import Path

from rich.console import Console
from rich.table import Table

from lerobot_owlxt5.backbones.pretrained import EMBEDDED
from lerobot_owlxt5.backbones.understanding import NOT_UNDERSTOOD, Understanding
from lerobot_owlxt5.command_line import command
from lerobot_owlxt5.commands.answer import (
    Action,
    Answer,
    Hold,
    Question,
    Request,
    Target,
    format_answer,
    parse_answer,
)
from lerobot_owlxt5.commands.colours import split_colour
from nico_tabletop.frames import PARAPHRASES, SYNONYMS
from nico_tabletop.objects import read_objects
from nico_tabletop.rates import wilson
from owlxt5_backbones.understanding_lessons import HELD_OUT

OUTCOMES = ("right", "in part", "refused", "asked back", "wrong", "carried out")
FOLDER = Path(__file__).parents[1] / "dataset_builders/owlxt5_backbones"
SENTENCES = [FOLDER / name for name in HELD_OUT]
GROUPS = ("clear wish", "to be held", "question", "to be asked back")


@dataclass
class UnderstandingConfig:
    """What to measure.

    Args:
        understanding: `embedded`, or the folder or Hub id of a T5.
        sentences: A file like `held_out_sentences_2.tsv`, whose author had seen no lesson.
        objects: A set of objects: take the synonyms and paraphrases of CLAEO-Plus about them, not the file.
        mistakes: Print what was not understood rightly.
    """

    understanding: str = EMBEDDED
    sentences: Path = SENTENCES[1]
    objects: str | None = None
    mistakes: bool = True


@dataclass(frozen=True)
class Sentence:
    """A sentence of the file; of several answers the first is the usual one."""

    kind: str
    language: str
    text: str
    answers: tuple[Answer, ...]

    @property
    def group(self) -> str:
        """One of `GROUPS`."""
        match self.answers[0]:
            case Hold():
                return "to be held"
            case Question():
                return "question"
            case Request() as request:
                return "clear wish" if request.clear else "to be asked back"


def read_sentences(path: Path) -> list[Sentence]:
    """Read a file of sentences."""
    rows = [
        line.split("\t") for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")
    ]
    return [
        Sentence(kind, language, text, tuple(parse_answer(answer) for answer in answers.split(" / ")))
        for kind, language, text, answers in rows
    ]


def protocol_sentences(objects: str) -> Iterator[Sentence]:
    """The sentences of CLAEO-Plus, each about one of a set's objects in turn."""
    phrases = cycle(item.phrase() for item in read_objects(objects))
    for kind, frames in {"synonyms": SYNONYMS, **PARAPHRASES}.items():
        for verb, sentences in frames.items():
            for sentence in sentences:
                phrase = next(phrases)
                colour, name = split_colour(phrase)
                targets = (Target(phrase), Target(name, colour)) if name else (Target(phrase),)
                answers = tuple(Request((Action(verb, target),)) for target in targets)
                yield Sentence(kind, "en", sentence.format(phrase), answers)


def judge(right: Answer, given: Answer) -> str:
    """One of `OUTCOMES`."""
    if given == right:
        return "right"
    if isinstance(given, Request) and not given.clear:
        if isinstance(right, Request):
            return "refused" if right.clear else "right"
        return "asked back"
    if isinstance(given, Request):
        if not isinstance(right, Request) or not right.clear:
            return "carried out"
        return "in part" if _is_part(given.actions, right.actions) else "wrong"
    if isinstance(right, Request):
        return "refused"
    return "in part" if isinstance(right, Hold) or isinstance(given, Question) else "refused"


def _is_part(given: Iterable[Action], right: Iterable[Action]) -> bool:
    """Whether each given action is one of the right ones, in their order, or that with less of a target."""
    remaining = iter(right)
    return all(any(_is_less(action, other) for other in remaining) for action in given)


def _is_less(given: Action, right: Action) -> bool:
    if given.verb != right.verb:
        return False
    ours, theirs = ({*f"{target.name} {target.colour}".split()} for target in (given.target, right.target))
    if not (ours <= theirs or theirs <= ours) or given.target.colour not in ("", right.target.colour):
        return False
    marks = [field.name for field in fields(Target) if field.name not in ("name", "colour")]
    return all(getattr(given.target, mark) in ("", None, getattr(right.target, mark)) for mark in marks)


def rate(count: int, total: int, digits: int = 0) -> str:
    """A share in percent with Wilson's 95 % interval."""
    low, high = wilson(count, total)
    return f"{count / total:.{digits}%} ({100 * low:.{digits}f} to {100 * high:.{digits}f})"


def _table(title: str, counts: dict[str, Counter[str]], rated: tuple[str, ...] = ()) -> Table:
    table = Table(title=title)
    for heading in ("sentences", "n", *(rated or OUTCOMES)):
        table.add_column(heading, justify="left" if heading == "sentences" else "right")
    for name, outcomes in counts.items():
        if not (total := outcomes.total()):
            continue
        shown = (rate(outcomes[o], total) if rated else str(outcomes[o] or "") for o in rated or OUTCOMES)
        table.add_row(name, str(total), *shown)
    return table


@command("understanding")
def main(config: UnderstandingConfig) -> None:
    """Understand all sentences and print the tables."""
    chosen = protocol_sentences(config.objects) if config.objects else read_sentences(config.sentences)
    understand = Understanding(config.understanding)
    understand("push the ball")  # what is done once
    kinds: dict[str, Counter[str]] = {}
    groups = {f"{group}, {language}": Counter[str]() for group in GROUPS for language in ("all", "en", "de")}
    seconds, console = [], Console(width=140)
    for sentence in chosen:
        began = time.perf_counter()
        understood = understand(sentence.text)
        seconds.append(time.perf_counter() - began)
        given = understood.answer
        if isinstance(given, Request) and not understood.sure:
            given = NOT_UNDERSTOOD
        outcome = min((judge(answer, given) for answer in sentence.answers), key=OUTCOMES.index)
        kinds.setdefault(sentence.kind, Counter())[outcome] += 1
        groups[f"{sentence.group}, all"][outcome] += 1
        groups[f"{sentence.group}, {sentence.language}"][outcome] += 1
        if config.mistakes and outcome != "right":
            best = f"{understood.confidence:.2f} {format_answer(understood.answer)}"
            print(outcome, sentence.text, f"→ {best}", sep="\t")
    console.print(_table(f"{config.understanding}: each kind", kinds))
    console.print(_table("Rates, with Wilson's 95 % intervals", groups, OUTCOMES))
    seconds.sort()
    median, worst = seconds[len(seconds) // 2], seconds[-1]
    console.print(f"time a sentence: median {1000 * median:.1f} ms, longest {1000 * worst:.1f} ms")


if __name__ == "__main__":
    main()
