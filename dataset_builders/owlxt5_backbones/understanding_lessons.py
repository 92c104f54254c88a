# SPDX-License-Identifier: Apache-2.0
"""Lessons in understanding without end: what someone says, and the formal answer that is right.

Frames of sentences (`understanding_frames/`) are filled with things and clauses
(`understanding_grammar.py`), then said as people write: with fillers, slips and too few commas.
"""

import re
from collections.abc import Callable
from functools import cache
from importlib.resources import files

import numpy as np

from lerobot_owlxt5.commands.answer import (
    MOST_ACTIONS,
    REASONS,
    Action,
    Answer,
    Hold,
    Landmark,
    Question,
    Request,
    Target,
    format_answer,
    heard,
    said_words,
)
from lerobot_owlxt5.commands.prompts import understand_prompt
from lerobot_owlxt5.commands.pseudo_names import draw_name

from .frame_book import Frame, frame_book, words
from .grammar import Case
from .rng import choice
from .understanding_grammar import (
    WHERE,
    WHERE_DE,
    Clause,
    Thing,
    draw_clause,
    draw_colour,
    draw_german_clause,
    draw_german_thing,
    draw_noun,
    draw_plain_german_verb,
    draw_plain_verb,
    draw_thing,
)

HELD_OUT = tuple(f"held_out_sentences{part}.tsv" for part in ("", "_2", "_3", "_4", "_5", "_6", "_7"))
"""Files of sentences to measure on."""
SHARES = {
    **{"wish": 0.26, "two": 0.11, "correction": 0.04, "forbidden": 0.09, "conditional": 0.06},
    **{
        "not_now": 0.05,
        "not_an_action": 0.11,
        "beyond": 0.05,
        "beyond more": 0.005,
        "question ability": 0.02,
    },
    **{
        "question scene": 0.02,
        "question robot": 0.02,
        "ask verb": 0.03,
        "ask target": 0.025,
        "ask all": 0.01,
    },
    **{"contrast": 0.1},
}
"""Kinds of frames, and how often each is drawn."""
_SHARE_GERMAN, _SHARE_PLAIN = 0.35, 0.55


@cache
def held_out() -> frozenset[str]:
    """What `benchmarks/understanding.py` measures on: no lesson."""
    texts = (files(__package__).joinpath(name).read_text(encoding="utf-8") for name in HELD_OUT)
    lines = [line for text in texts for line in text.splitlines() if line[:1] not in "#"]
    return frozenset(normalised(line.split("\t")[2]) for line in lines)


def normalised(sentence: str) -> str:
    """The words alone."""
    return " ".join(said_words(sentence))


def draw_lesson(rng: np.random.Generator) -> tuple[str, str]:
    """Draw a prompt and the text of its answer."""
    sentence, answer = draw_understood(rng)
    return understand_prompt(sentence), format_answer(answer)


def draw_understood(rng: np.random.Generator) -> tuple[str, Answer]:
    """Draw a sentence and what it asks for."""
    while True:
        kind = choice(rng, [*SHARES], [*SHARES.values()])
        language = "de" if rng.random() < _SHARE_GERMAN else "en"
        found = frame_book().frames.get((kind, language))
        if not found:
            continue
        # Files have different authors. The few frames of one are not to drown in the many of another.
        weights = np.sqrt([len(frames) for frames in found])
        frames = choice(rng, found, (weights / weights.sum()).tolist())
        frame = choice(rng, choice(rng, frames))
        filling = _Filling(rng, frame, language)
        sentence, answer = _as_people_write(rng, filling.sentence, filling.answer, language)
        if normalised(sentence) not in held_out():
            return sentence, answer


_SLOT = re.compile(r"\{([\w=-]+)\}")
# "(please|kindly|)": one of these, without others inside.
_ALTERNATIVES = re.compile(r"\(([^()]*\|[^()]*)\)")
_GERMAN_CASES: dict[str, Case] = {"ding": "accusative", "der": "nominative", "dem": "dative"}


class _Filling:
    """A frame, filled, and the answer that follows from what was filled in."""

    def __init__(self, rng: np.random.Generator, frame: Frame, language: str) -> None:
        self._rng, self._frame, self._language = rng, frame, language
        self._actions: dict[str, list[Action]] = {}
        self._thing: Thing | None = None
        self._verb: str | None = None
        self._clause: Clause | None = None
        self._word = self._last_pronoun = ""
        self.sentence = self._fill(frame.text)

    @property
    def answer(self) -> Answer:
        """What the sentence asks for."""
        kind = self._frame.kind.removesuffix(" more")
        if kind in REASONS:
            return Hold(kind)
        if kind.startswith("question "):
            return Question(kind.removeprefix("question "))
        target = self._thing.target if self._thing else Target()
        if kind.startswith("ask"):
            verb = self._verb if kind == "ask target" else None
            return Request((Action(verb, target if kind == "ask verb" else Target()),))
        actions = [action for _, found in sorted(self._actions.items()) for action in found]
        return Request((*(actions or [Action(self._verb, target)]),)[:MOST_ACTIONS])

    def _fill(self, text: str) -> str:
        while _ALTERNATIVES.search(text):
            text = _ALTERNATIVES.sub(lambda found: choice(self._rng, found[1].split("|")), text)
        text = _SLOT.sub(lambda found: self._slot(found[1]), text)
        return re.sub(r" +(?=[,.!?;:]|$)", "", " ".join(text.split()))

    def _slot(self, slot: str) -> str:
        """What stands in a place; notes what it means, unless it begins with `x_`."""
        rng, counts = self._rng, not slot.startswith("x_")
        if slot.startswith("="):
            self._verb = slot.removeprefix("=")
            return ""
        name = slot.removeprefix("x_")
        number = name[-1] if name[-1].isdigit() else ""
        name = name.rstrip("12")
        if name in ("thing", "related", "ding", "verwandt", "der", "dem", "a", "name"):
            return self._draw_thing(name, counts)
        if name in ("where", "wohin"):
            places = WHERE if name == "where" else WHERE_DE
            verb = choice(rng, [*places])
            if counts:
                self._verb = self._verb or verb
            return choice(rng, places[verb])
        if name in ("verb", "verb_again", "verb_de", "verb_de_inf", "zu_verb_de"):
            return self._plain_verb(name, counts)
        if name == "colour":
            return (
                draw_colour(rng) if self._language == "en" else choice(rng, ("rot", "blau", "grün", "gelb"))
            )
        if name == "gibberish":
            return draw_name(rng)
        if (slot, self._language) in frame_book().lists:
            return self._fill(choice(rng, words(slot, self._language)))
        return self._do(name, number, counts)

    def _draw_thing(self, slot: str, counts: bool) -> str:
        rng = self._rng
        if slot == "name":
            noun = draw_noun(rng)
            said = noun.english if self._language == "en" else noun.german
            if counts and self._thing is None:
                self._thing = Thing(Target(" ".join(said_words(said))), {}, {"accusative": "it"})
            return said
        plain = slot == "a" or (
            self._frame.kind in ("wish", "correction", "ask verb") and rng.random() < _SHARE_PLAIN
        )
        case = _GERMAN_CASES.get(slot, "accusative")
        related = slot in ("related", "verwandt")
        drawn = (
            draw_thing(rng, plain=plain, related=related)
            if slot in ("thing", "related", "a")
            else draw_german_thing(rng, case, plain=plain, related=related)
        )
        said = drawn.texts[case]
        if slot == "a":
            said = re.sub(r"^(the|that|this|my|your|our) ", "", said)
            said = f"{'an' if said[:1] in [*'aeiou'] else 'a'} {said}"
        if counts and self._thing is None:
            self._thing = drawn
        return said

    def _plain_verb(self, slot: str, counts: bool) -> str:
        if slot == "verb_again":
            return self._word
        if slot == "verb":
            verb, word = draw_plain_verb(self._rng)
            self._word = word
        else:
            verb, imperative, infinitive = draw_plain_german_verb(self._rng)
            word = {"verb_de": imperative, "verb_de_inf": infinitive, "zu_verb_de": f"zu {infinitive}"}[slot]
        if counts:
            self._verb = self._verb or verb
        return word

    def _do(self, slot: str, number: str, counts: bool) -> str:
        """Something to do, in one of the forms of a clause."""
        rng, german = self._rng, self._language == "de"
        clause = draw_german_clause(rng) if german else draw_clause(rng)
        if slot in clause.forms and "{}" not in clause.forms[slot]:
            self._verb = self._verb or clause.verb
            return clause.forms[slot]
        if slot in ("do_it", "do_it_a", "tu_es"):
            said = next(iter(self._thing.pronouns.values())) if self._thing else "es" if german else "it"
            if german and self._thing:
                said = _accusative(said)
            target = self._thing.target if self._thing else Target(reference="it")
            self._note(number, Action(clause.verb, target))
            return clause.forms["tu" if german else "do"].format(said)
        if number == "2" and self._actions.get("1") and rng.random() < 0.3:
            self._note(number, Action(clause.verb, Target(reference="it")))
            before = self._last_pronoun
            return clause.forms[slot].format(before)
        things = [self._draw_object() for _ in range(self._how_many())]
        self._last_pronoun = things[0].pronouns["accusative"]
        if counts:
            for thing in things:
                self._note(number, Action(clause.verb, thing.target))
        said = _joined(rng, [thing.texts["accusative"] for thing in things], self._language)
        form = "do" if slot == "do_a" else slot
        if slot == "do_a":
            said = re.sub(r"^(the|that|this|my|your|our) ", "a ", said)
        return clause.forms[form].format(said)

    def _how_many(self) -> int:
        several = self._frame.kind == "wish" and not self._actions and self._rng.random() < 0.14
        return (3 if self._rng.random() < 0.35 else 2) if several else 1

    def _draw_object(self) -> Thing:
        plain = self._rng.random() < _SHARE_PLAIN
        if self._language == "de":
            return draw_german_thing(self._rng, "accusative", plain=plain)
        return draw_thing(self._rng, plain=plain)

    def _note(self, number: str, action: Action) -> None:
        self._actions.setdefault(number, []).append(action)


_JOINED_BY = {
    "en": (" and ", " and ", " and ", " and also ", " as well as ", " plus ", " & "),
    "de": (" und ", " und ", " und ", " und auch ", " sowie ", " plus ", " & "),
}
_BOTH = {"en": ("both {} and {}", "{} and {} both"), "de": ("sowohl {} als auch {}", "{} und {} beide")}


def _joined(rng: np.random.Generator, things: list[str], language: str) -> str:
    """Things in a row, as people list them."""
    *first, last = things
    if len(first) == 1 and rng.random() < 0.3:
        return choice(rng, _BOTH[language]).format(*things)
    return f"{', '.join(first)}{choice(rng, _JOINED_BY[language])}{last}" if first else last


def _accusative(pronoun: str) -> str:
    return {"er": "ihn", "ihm": "ihn", "ihr": "sie"}.get(pronoun, pronoun)


_SHARE_CHATTY, _SHARE_WITHOUT_UMLAUTS, _SHARE_SLIPPED = 0.06, 0.1, 0.2
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "ß": "ss"})


def _as_people_write(
    rng: np.random.Generator, sentence: str, answer: Answer, language: str
) -> tuple[str, Answer]:
    """The same with fillers, marks, and slips of the fingers, which a copied name has too."""
    if rng.random() < 0.12:
        sentence = f"{choice(rng, words('start', language))} {sentence}"
    if rng.random() < 0.08:
        sentence = f"{sentence} {choice(rng, words('end', language))}".replace(" ,", ",")
    question = isinstance(answer, Question) or bool(
        re.match(r"(can|could|would|will|kannst|könntest|würdest)\b", sentence)
    )
    if rng.random() < 0.6:
        sentence += choice(
            rng, ("?", "?", "?", "", "??", ".") if question else (".", ".", ".", "!", "!!", "...")
        )
    if rng.random() < 0.3:
        sentence = sentence.replace(",", "")
    if rng.random() < _SHARE_CHATTY:
        sentence = _chatty(rng, sentence, answer, language)
    if language == "de" and rng.random() < _SHARE_WITHOUT_UMLAUTS:
        sentence, answer = _rewritten(sentence, answer, lambda word: word.translate(_UMLAUTS))
    if rng.random() < _SHARE_SLIPPED:
        sentence, answer = _slipped(rng, sentence, answer)
    return sentence, answer


def _chatty(rng: np.random.Generator, sentence: str, answer: Answer, language: str) -> str:
    """Words as in short messages, such as "pls"; a name stays as it is."""
    short = _short_forms(language)
    names = {*said_words(format_answer(answer))}

    def shortened(word: str) -> str:
        return (
            choice(rng, short[word]) if word in short and word not in names and rng.random() < 0.7 else word
        )

    return _each_word(sentence, shortened)


@cache
def _short_forms(language: str) -> dict[str, list[str]]:
    """How a word is written in short messages, by the word."""
    return {word: forms.split("|") for word, forms in (line.split("=") for line in words("chat", language))}


def _slipped(rng: np.random.Generator, sentence: str, answer: Answer) -> tuple[str, Answer]:
    """One to five words misspelt, wherever they stand."""
    found = [word for word in dict.fromkeys(said_words(sentence)) if len(word) >= 3 and word.isalpha()]
    slips: dict[str, str] = {}
    for _ in range(min(len(found), int(rng.integers(1, 6)))):
        word = choice(rng, found)
        slips[word] = _misspell(rng, word)
    if {*slips.values()} & {*said_words(sentence)}:
        return sentence, answer
    return _rewritten(sentence, answer, lambda word: slips.get(word, word))


def _rewritten(sentence: str, answer: Answer, rewrite: Callable[[str], str]) -> tuple[str, Answer]:
    """Each word written in another way, in the sentence as in its answer."""

    def rewrite_all(text: str) -> str:
        return _each_word(text, rewrite)

    if isinstance(answer, Request):
        answer = Request(tuple(Action(a.verb, _with_slips(a.target, rewrite_all)) for a in answer.actions))
    return rewrite_all(heard(sentence)), answer


def _each_word(text: str, rewrite: Callable[[str], str]) -> str:
    return re.sub(r"[^\W_]+(?:'[^\W_]+)*", lambda found: rewrite(found[0]), text)


def _with_slips(target: Target, slip: Callable[[str], str]) -> Target:
    relation = target.relation
    if relation:
        marks = tuple(Landmark(slip(mark.name), slip(mark.colour)) for mark in relation.landmarks)
        relation = relation.__class__(relation.kind, marks)
    order, side = target.order, target.side
    return Target(slip(target.name), slip(target.colour), target.reference, side, order, relation)


def _misspell(rng: np.random.Generator, word: str) -> str:
    place, kind = int(rng.integers(1, len(word) - 1)), rng.random()
    if kind < 0.45:
        return word[:place] + word[place + 1] + word[place] + word[place + 2 :]
    if kind < 0.8:
        return word[:place] + word[place + 1 :]
    return word[:place] + word[place] + word[place:]
