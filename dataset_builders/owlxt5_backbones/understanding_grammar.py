# SPDX-License-Identifier: Apache-2.0
"""What lessons in understanding are made of, in English and German: things to move, and moving them.

Each thing comes with the target that it means, and each clause with its verb. All words are ours.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lerobot_owlxt5.commands.answer import RELATIONS, SIDES, Landmark, Relation, Target, said_words
from lerobot_owlxt5.commands.colours import COLOURS as COLOUR_WORDS
from lerobot_owlxt5.commands.pseudo_names import draw_name

from .catalogue import CATEGORIES, COLOURS
from .frame_book import words
from .grammar import ADJECTIVES, COMPOUNDS, DEFINITE, INDEFINITE, Case, Gender, Noun, compound, nouns
from .rng import choice

_COLOURS = (
    *(name for names, _ in COLOURS.values() for name in names),
    *("turquoise", "beige", "light blue", "dark red", "pale pink", "lime", "maroon", "olive", "golden"),
    *("silver", "indigo", "magenta", "dark green", "bright yellow", "teal", "ruby", "sky blue", "lilac"),
    *(word for others in COLOUR_WORDS.values() for word in others),
    *(
        "navy blue",
        "forest green",
        "salmon",
        "coral",
        "khaki",
        "plum",
        "burgundy",
        "apricot",
        "charcoal",
        "copper",
    ),
    *(
        "mint green",
        "off white",
        "jet black",
        "royal blue",
        "baby pink",
        "tan",
        "rust",
        "wine red",
        "light green",
    ),
    *("light grey", "deep purple", "pale yellow", "dark brown", "bronze", "mint", "peach", "sand"),
)
_COLOURS_DE = (*[*ADJECTIVES.values()][:20], "dunkelrot", "hellblau", "dunkelgrün", "bunt", "hellrosa")
# Nouns of two words, the first of which would mean something else by itself.
_TWO_WORDS = (
    *(
        "push pin",
        "pull cord",
        "slide rule",
        "drawing pin",
        "moving box",
        "left shoe",
        "right glove",
        "front door",
    ),
    *("can opener", "tape measure", "remote control", "coffee mug", "top hat", "stop sign", "back scratcher"),
    *(
        "pushing stick",
        "middle piece",
        "far sight",
        "near light",
        "close up lens",
        "light switch",
        "red wine bottle",
    ),
)
_SHARE_INVENTED, _SHARE_COLOURED, _SHARE_QUALITY, _SHARE_MARKED = 0.25, 0.3, 0.1, 0.4
_SHARE_USUAL, _SHARE_SIDE_ALONE = 0.45, 0.04

# fmt: off
_ONSETS = (
    "b", "bl", "d", "dr", "f", "fl", "g", "gr", "h", "k", "kl", "l", "m", "n", "p",
    "pr", "qu", "r", "s", "sch", "sp", "spl", "st", "t", "tr", "v", "w", "x", "z", "zw",
)
# fmt: on
_CODAS = (
    "",
    "",
    "",
    *("b", "ck", "f", "g", "ks", "l", "lt", "m", "n", "nd", "p", "r", "rm", "rt", "s", "t", "x"),
)

_STANDING_DE = ("stehend", "stehend", "liegend", "befindlich")
_RANKS = {"second": ("second", "2nd"), "third": ("third", "3rd"), "fourth": ("fourth", "4th")}
_RANKS_DE = {"second": "zweit", "third": "dritt", "fourth": "viert"}
_SIDES_DE = {"left": "links", "right": "rechts"}


class Thing(NamedTuple):
    """A thing as a sentence has it, and what it means.

    Attributes:
        target: What it means.
        texts: How it is said in a case; English has one for all.
        pronouns: What stands for it in a case.
    """

    target: Target
    texts: dict[Case, str]
    pronouns: dict[Case, str]


def draw_colour(rng: np.random.Generator) -> str:
    """An English name of a colour."""
    return choice(rng, _COLOURS)


def draw_noun(rng: np.random.Generator) -> Noun:
    """A noun of the list or the catalogue, a compound, or an invented one of any gender."""
    if rng.random() < _SHARE_INVENTED:
        name = draw_name(rng) if rng.random() < 0.4 else _draw_word(rng)
        return Noun(name, name, choice(rng, ("m", "f", "n")))
    noun, kind = choice(rng, nouns()), rng.random()
    if kind < 0.18:
        first = choice(rng, nouns())
        return Noun(f"{first.english} {noun.english}", first.german + noun.german.lower(), noun.gender)
    if kind < 0.21:
        return Noun(choice(rng, _TWO_WORDS), noun.german, noun.gender)
    if kind < 0.33:
        name = choice(rng, CATEGORIES[choice(rng, [*CATEGORIES])][0])
        return Noun(name, noun.german, noun.gender)
    return compound(choice(rng, [*COMPOUNDS]), noun) if rng.random() < 0.15 else noun


def _draw_word(rng: np.random.Generator) -> str:
    """A word that might be one, such as "splomket"."""
    syllables = (
        choice(rng, _ONSETS) + choice(rng, ("a", "e", "i", "o", "u", "oo", "ei")) + choice(rng, _CODAS)
        for _ in range(int(rng.integers(1, 4)))
    )
    return "".join(syllables)


def draw_thing(rng: np.random.Generator, *, plain: bool = False, related: bool = False) -> Thing:
    """An English thing; a plain one has a name and perhaps a colour, a related one stands beside another."""
    if not plain and not related and rng.random() < 0.06:
        other = rng.random() < 0.5
        said = choice(
            rng,
            ("the other one", "the other", "the remaining one")
            if other
            else ("it", "it", "that one", "the same one", "that", "this one", "that thing", "the same thing"),
        )
        return _english(Target(reference="other" if other else "it"), said)
    if not plain and not related and rng.random() < _SHARE_SIDE_ALONE:
        side, before = choice(rng, SIDES), rng.random() < 0.7
        where = words(f"{side} {'before' if before else 'behind'}", "en")[0]
        return _english(Target(side=side), f"the {where} one" if before else f"the one {where}")
    name = draw_noun(rng).english
    if rng.random() < _SHARE_QUALITY:
        name = f"{choice(rng, words('quality', 'en'))} {name}"
    colour = draw_colour(rng) if rng.random() < _SHARE_COLOURED else ""
    if colour and rng.random() < 0.25:
        # "the red one", and CLANT's "red".
        said, name = choice(rng, (f"the {colour} one", f"the {colour} one", colour, f"the {colour}")), ""
    elif not plain and rng.random() < 0.18:
        name = choice(rng, ("thing", "thing", "object", "object", "item", "", "", ""))
        said = f"the {colour} {name or 'one'}".replace("  ", " ")
    else:
        head, _, tail = name.partition(" ") if name.split()[0] in words("quality", "en") else ("", "", name)
        article = choice(rng, ("the", "the", "the", "the", "the", "that", "this", "my", "your", "our", ""))
        said = " ".join(f"{article} {head} {colour} {tail}".split())
        if colour and rng.random() < 0.15:
            said = choice(rng, words("in colour", "en")).format(name, colour)
    target = Target(name, colour)
    if not related and (plain or rng.random() > _SHARE_MARKED):
        return _english(target, said) if target != Target() else draw_thing(rng, plain=plain)
    return _english(*_marked(rng, target, said, related))


def _way(rng: np.random.Generator, name: str, language: str) -> str:
    """A way to say something: the list's first, which is the usual one, more often than any other."""
    ways = words(name, language)
    return ways[0] if rng.random() < _SHARE_USUAL else choice(rng, ways)


_ARTICLES = ("that", "this", "my", "your", "our")


def _english(target: Target, said: str) -> Thing:
    target = replace(target, name=" ".join(said_words(target.name)), colour=target.colour)
    cases: tuple[Case, ...] = ("nominative", "accusative", "dative")
    return Thing(target, dict.fromkeys(cases, said), dict.fromkeys(cases, "it"))


def _marked(rng: np.random.Generator, target: Target, said: str, related: bool = False) -> tuple[Target, str]:
    """The same with a side, a place in a row, a relation, or as the other one."""
    rest = said.removeprefix("the ") if said.startswith("the ") else ""
    if not rest:
        rest = " ".join(said.split()[1:]) if said.split()[0] in _ARTICLES else said
        rest = rest if target.name else f"{target.colour} one"
    kind = 1.0 if related else rng.random()
    if kind < 0.4:
        side, how = choice(rng, SIDES), rng.random()
        if how < 0.15:
            forms = [form for form in words(f"{side} said", "en") if rest != "one" or "the {}" not in form]
            return replace(target, side=side), choice(rng, forms).format(rest)
        if how < 0.6:
            return replace(target, side=side), f"the {rest} {_way(rng, f'{side} behind', 'en')}"
        before = _way(rng, f"{side} before", "en")
        alone = rest == "one" and before.endswith("st") and rng.random() < 0.3
        return replace(target, side=side), f"the {before}" if alone else f"the {before} {rest}"
    if kind < 0.52:
        rank, (side, other) = choice(rng, [*_RANKS]), choice(rng, (("left", "right"), ("right", "left")))
        counted = _way(rng, "counted", "en").format(side, other)
        if rng.random() < 0.2:
            return replace(target, side=side), f"the first {rest} {counted}"
        word = choice(rng, _RANKS[rank])
        often = "the {rank} {rest} {counted}"
        form = often if rng.random() < 0.7 else _way(rng, "ranked said", "en")
        said = form.format(rank=word, rest=rest, counted=counted, side=side)
        return replace(target, order=(rank, side)), said
    if kind < 0.62:
        return replace(target, reference="other"), _way(rng, "other said", "en").format(rest)
    relation = choice(rng, RELATIONS)
    things = [draw_thing(rng, plain=True) for _ in range(2 if relation == "between" else 1)]
    marks = tuple(Landmark(thing.target.name, thing.target.colour) for thing in things)
    joined = _way(rng, "joined", "en") if rng.random() < 0.7 else ""
    landmarks = " and ".join(thing.texts["dative"] for thing in things)
    place = _way(rng, relation, "en")
    if place.endswith(" than"):
        # Else "push the mug further left than the can" would be a place to go to.
        joined = joined or "that is"
    start = f"the {rest} {joined}"
    if rest == "one" and rng.random() < 0.15:
        start = _way(rng, "nameless", "en")
    said = " ".join(f"{start} {place} {landmarks}".split())
    return replace(target, relation=Relation(relation, marks)), said


_PRONOUNS: dict[Gender, dict[Case, str]] = {
    "m": {"nominative": "er", "accusative": "ihn", "dative": "ihm"},
    "f": {"nominative": "sie", "accusative": "sie", "dative": "ihr"},
    "n": {"nominative": "es", "accusative": "es", "dative": "ihm"},
}


def draw_german_thing(
    rng: np.random.Generator, case: Case, *, plain: bool = False, related: bool = False
) -> Thing:
    """A German thing in a case: names and colours are copied as said, with their endings."""
    noun = draw_noun(rng)
    if rng.random() < 0.1:
        noun = Noun("thing", "Ding", "n") if rng.random() < 0.7 else Noun("object", "Gegenstand", "m")
    if not plain and not related and rng.random() < 0.04:
        said = _PRONOUNS[noun.gender][case]
        return Thing(Target(reference="it"), {case: said}, {case: said})
    definite = rng.random() < 0.95
    article, ending = (DEFINITE if definite else INDEFINITE)[case][noun.gender]
    if definite and rng.random() < 0.06:
        article = {"der": "dieser", "den": "diesen", "dem": "diesem", "die": "diese", "das": "dieses"}[
            article
        ]
    name = " ".join(said_words(noun.german))
    if rng.random() < _SHARE_QUALITY:
        name = f"{choice(rng, words('quality', 'de'))}{ending} {name}"
    colour, marks, behind = "", Target(), ""
    if rng.random() < _SHARE_COLOURED:
        colour = choice(rng, _COLOURS_DE) + ending
        name = "" if rng.random() < 0.25 else name
    before: list[str] = [colour] if colour else []
    if related or (not plain and rng.random() < _SHARE_MARKED):
        marks, first, behind = _german_marks(rng, ending, noun.gender, related)
        before = [*first, *before]
        if before and rng.random() < 0.15:
            name = ""
    said = " ".join([article, *before, *([name] if name else []), *([behind] if behind else [])])
    said = said.replace(" ,", ",")
    target = replace(marks, name=name, colour=" ".join(said_words(colour)))
    if target == Target():
        return draw_german_thing(rng, case, plain=plain, related=related)
    return Thing(target, {case: said}, {case: _PRONOUNS[noun.gender][case]})


def _german_marks(
    rng: np.random.Generator, ending: str, gender: Gender, related: bool
) -> tuple[Target, list[str], str]:
    """A side, a place in a row, a relation, or the other one: what stands before the name, and behind it."""
    kind = 1.0 if related else rng.random()
    if kind < 0.22:
        side = choice(rng, SIDES)
        return Target(side=side), [_way(rng, f"{side} before", "de") + ending], ""
    if kind < 0.3:
        side = choice(rng, SIDES)
        how = f"{_way(rng, f'{side} standing', 'de')} {choice(rng, _STANDING_DE)}{ending}"
        return Target(side=side), [how], ""
    if kind < 0.45:
        side = choice(rng, SIDES)
        if rng.random() < 0.25:
            return Target(side=side), [], _clause(rng, gender, _way(rng, f"{side} standing", "de"))
        return Target(side=side), [], _way(rng, f"{side} behind", "de")
    if kind < 0.57:
        rank, (side, other) = choice(rng, [*_RANKS_DE]), choice(rng, (("left", "right"), ("right", "left")))
        way = _SIDES_DE[side]
        counted = _way(rng, "counted", "de").format(way, _SIDES_DE[other], f"{way[:-1]}en")
        if rng.random() < 0.2:
            return Target(side=side), [f"erst{ending}"], counted
        if rng.random() < 0.15:
            return Target(order=(rank, side)), [], f"an {_RANKS_DE[rank]}er stelle {counted}"
        return Target(order=(rank, side)), [f"{_RANKS_DE[rank]}{ending}"], counted
    if kind < 0.68:
        return Target(reference="other"), [f"ander{ending}"], ""
    relation = choice(rng, RELATIONS)
    things = [draw_german_thing(rng, "dative", plain=True) for _ in range(2 if relation == "between" else 1)]
    landmarks = tuple(Landmark(thing.target.name, thing.target.colour) for thing in things)
    how = f"{_way(rng, relation, 'de')} {' und '.join(thing.texts['dative'] for thing in things)}"
    marks = Target(relation=Relation(relation, landmarks))
    if rng.random() < 0.15:
        return marks, [f"{how} {choice(rng, _STANDING_DE)}{ending}"], ""
    return marks, [], _clause(rng, gender, how) if rng.random() < 0.2 else how


def _clause(rng: np.random.Generator, gender: Gender, where: str) -> str:
    """Where a thing is, said in a German clause."""
    return _way(rng, "clause", "de").format(DEFINITE["nominative"][gender][0], where)


@dataclass(frozen=True)
class Clause:
    """Something to do, without the thing: a verb of ours and how it is said, by slot, with a place for it."""

    verb: str
    forms: dict[str, str]


_ENGLISH_VERBS = {
    base: (doing, did, does)
    for base, doing, did, does in (
        *(("push", "pushing", "pushed", "pushes"), ("shove", "shoving", "shoved", "shoves")),
        *(("thrust", "thrusting", "thrust", "thrusts"), ("nudge", "nudging", "nudged", "nudges")),
        *(("pull", "pulling", "pulled", "pulls"), ("drag", "dragging", "dragged", "drags")),
        *(("tug", "tugging", "tugged", "tugs"), ("bring", "bringing", "brought", "brings")),
        *(("slide", "sliding", "slid", "slides"), ("move", "moving", "moved", "moves")),
        *(("shift", "shifting", "shifted", "shifts"), ("get", "getting", "got", "gets")),
        *(("glide", "gliding", "glided", "glides"), ("sweep", "sweeping", "swept", "sweeps")),
        *(("roll", "rolling", "rolled", "rolls"), ("press", "pressing", "pressed", "presses")),
        *(("haul", "hauling", "hauled", "hauls"), ("push", "pushing", "pushed", "pushes")),
        *(("poke", "poking", "poked", "pokes"), ("yank", "yanking", "yanked", "yanks")),
        *(("bump", "bumping", "bumped", "bumps"), ("prod", "prodding", "prodded", "prods")),
        *(("ram", "ramming", "rammed", "rams"), ("knock", "knocking", "knocked", "knocks")),
        *(("propel", "propelling", "propelled", "propels"), ("force", "forcing", "forced", "forces")),
        *(("jostle", "jostling", "jostled", "jostles"), ("send", "sending", "sent", "sends")),
        *(("tow", "towing", "towed", "tows"), ("lug", "lugging", "lugged", "lugs")),
        *(("reel in", "reeling in", "reeled in", "reels in"), ("draw", "drawing", "drew", "draws")),
        *(("heave", "heaving", "heaved", "heaves"), ("ease", "easing", "eased", "eases")),
        *(("inch", "inching", "inched", "inches"), ("scoot", "scooting", "scooted", "scoots")),
        *(("edge", "edging", "edged", "edges"), ("slip", "slipping", "slipped", "slips")),
        *(("steer", "steering", "steered", "steers"), ("guide", "guiding", "guided", "guides")),
        *(("brush", "brushing", "brushed", "brushes"), ("flick", "flicking", "flicked", "flicks")),
        *(("swipe", "swiping", "swiped", "swipes"), ("whisk", "whisking", "whisked", "whisks")),
        *(("transfer", "transferring", "transferred", "transfers"), ("budge", "budging", "budged", "budges")),
        *(("tap", "tapping", "tapped", "taps"), ("wheel", "wheeling", "wheeled", "wheels")),
        *(("relocate", "relocating", "relocated", "relocates"), ("coax", "coaxing", "coaxed", "coaxes")),
        *(
            ("reposition", "repositioning", "repositioned", "repositions"),
            ("hustle", "hustling", "hustled", "hustles"),
        ),
        *(("displace", "displacing", "displaced", "displaces"), ("usher", "ushering", "ushered", "ushers")),
        *(
            ("transport", "transporting", "transported", "transports"),
            ("boost", "boosting", "boosted", "boosts"),
        ),
        *(("haul", "hauling", "hauled", "hauls"), ("fetch", "fetching", "fetched", "fetches")),
        *(
            ("retract", "retracting", "retracted", "retracts"),
            ("scooch", "scooching", "scooched", "scooches"),
        ),
        *(("advance", "advancing", "advanced", "advances"), ("elbow", "elbowing", "elbowed", "elbows")),
        *(
            ("manoeuvre", "manoeuvring", "manoeuvred", "manoeuvres"),
            ("propel", "propelling", "propelled", "propels"),
        ),
        *(("bulldoze", "bulldozing", "bulldozed", "bulldozes"), ("put", "putting", "put", "puts")),
        *(("work", "working", "worked", "works"), ("direct", "directing", "directed", "directs")),
    )
}
WHERE = {
    "push": (
        *(
            "away",
            "away",
            "away from you",
            "forward",
            "forwards",
            "further away",
            "farther from you",
            "ahead",
        ),
        *("away from yourself", "a bit further away", "farther off", "off", "further out", "out of your way"),
        *(
            "a little farther away",
            "further from you",
            "out",
            "further back from you",
            "farther away from you",
        ),
    ),
    "pull": (
        *("closer", "closer to you", "towards you", "back towards you", "nearer", "nearer to you", "back"),
        *(
            "closer to yourself",
            "towards yourself",
            "toward you",
            "to you",
            "a bit closer",
            "in",
            "over to you",
        ),
        *("a little nearer to yourself", "in your direction", "back to you", "closer in", "right up to you"),
    ),
    **{
        f"slide-to-{side}": (
            *(f"to the {side}", f"to the {side}", side, f"to your {side}", f"{side}wards", f"{side}ward"),
            *(f"over to the {side}", f"to the {side} side", f"further {side}", f"a bit to the {side}"),
            *(f"a little {side}", f"towards the {side}", f"towards your {side}", f"to the {side} hand side"),
            *(f"to your {side} side", f"a bit {side}", f"a bit further to the {side}", f"more to the {side}"),
            *(
                f"a little to the {side}",
                f"in the {side} direction",
                f"off to the {side}",
                f"across to the {side}",
            ),
        )
        for side in ("left", "right")
    },
}
"""Ways to say where a verb moves things."""
_ANYWHERE = (
    *(
        "ease",
        "inch",
        "scoot",
        "edge",
        "slip",
        "steer",
        "guide",
        "send",
        "transfer",
        "budge",
        "wheel",
        "relocate",
    ),
    *("coax", "reposition", "displace", "usher", "transport", "scooch", "manoeuvre", "work", "direct", "put"),
)
_SIDEWAYS = (
    *("slide", "slide", "slide", "move", "push", "shift", "nudge", "glide", "sweep", "roll", "drag", "pull"),
    *("brush", "flick", "swipe", "whisk", "bump", "prod", "knock", "tow", "tap", *_ANYWHERE),
)
_PLAIN = {
    "push": ("push", "push", "push", "shove", "thrust", "nudge", "poke", "bump", "prod", "ram", "jostle"),
    "pull": ("pull", "pull", "pull", "drag", "tug", "yank", "haul", "tow", "lug", "reel in", "heave"),
}
_MOVED = {
    "push": (
        *("push", "push", "push", "shove", "shove", "move", "move", "shift", "nudge", "press", "get"),
        *("bump", "prod", "propel", "force", "knock", "flick", "brush", "tap", *_ANYWHERE),
        *("hustle", "boost", "advance", "elbow", "bulldoze"),
    ),
    "pull": (
        *("pull", "pull", "pull", "drag", "drag", "move", "move", "bring", "shift", "get"),
        *("draw", "draw", "tow", "lug", "heave", "haul", "fetch", "retract", *_ANYWHERE),
    ),
}
_CLANT = {
    "push": "move up {}",
    "pull": "move down {}",
    "slide-to-left": "move sideways to left {}",
    "slide-to-right": "slide to right {}",
}


def draw_clause(rng: np.random.Generator) -> Clause:
    """An English clause: its slots are do, doing, did, does, passive and passive_only."""
    verb = choice(rng, [*WHERE])
    if verb in _PLAIN and rng.random() < 0.5:
        base, rest = choice(rng, _PLAIN[verb]), "{}"
    elif rng.random() < 0.04:
        base, _, rest = _CLANT[verb].partition(" ")
    else:
        base, where = choice(rng, _MOVED.get(verb, _SIDEWAYS)), choice(rng, WHERE[verb])
        rest = (
            f"{where} {{}}"
            if where in ("away", "back", "forward") and rng.random() < 0.2
            else f"{{}} {where}"
        )
    doing, did, does = _ENGLISH_VERBS[base]
    forms = {form: f"{word} {rest}" for form, word in (("do", base), ("doing", doing), ("did", did))}
    only = f"{did} {rest.replace('{}', '').strip()}".strip()
    return Clause(verb, forms | {"does": f"{does} {rest}", "passive_only": only, "passive": f"{{}} {only}"})


def draw_plain_verb(rng: np.random.Generator) -> tuple[str, str]:
    """A verb of ours and one English word for it."""
    verb = choice(rng, [*_PLAIN])
    return verb, choice(rng, _PLAIN[verb])


class _GermanVerb(NamedTuple):
    imperative: str
    infinitive: str
    du: str
    er: str
    participle: str
    ich: str


_SCHIEBEN = _GermanVerb("schieb", "schieben", "schiebst", "schiebt", "geschoben", "schiebe")
_ZIEHEN = _GermanVerb("zieh", "ziehen", "ziehst", "zieht", "gezogen", "ziehe")
_RUECKEN = _GermanVerb("rück", "rücken", "rückst", "rückt", "gerückt", "rücke")
_BEWEGEN = _GermanVerb("beweg", "bewegen", "bewegst", "bewegt", "bewegt", "bewege")
_STOSSEN = _GermanVerb("stoß", "stoßen", "stößt", "stößt", "gestoßen", "stoße")
_SCHUBSEN = _GermanVerb("schubs", "schubsen", "schubst", "schubst", "geschubst", "schubse")
_DRUECKEN = _GermanVerb("drück", "drücken", "drückst", "drückt", "gedrückt", "drücke")
_HOLEN = _GermanVerb("hol", "holen", "holst", "holt", "geholt", "hole")
_STUPSEN = _GermanVerb("stups", "stupsen", "stupst", "stupst", "gestupst", "stupse")
_ZERREN = _GermanVerb("zerr", "zerren", "zerrst", "zerrt", "gezerrt", "zerre")
_BRINGEN = _GermanVerb("bring", "bringen", "bringst", "bringt", "gebracht", "bringe")
_ROLLEN = _GermanVerb("roll", "rollen", "rollst", "rollt", "gerollt", "rolle")
_BEFOERDERN = _GermanVerb("beförder", "befördern", "beförderst", "befördert", "befördert", "befördere")
_BUGSIEREN = _GermanVerb("bugsier", "bugsieren", "bugsierst", "bugsiert", "bugsiert", "bugsiere")
_SCHAFFEN = _GermanVerb("schaff", "schaffen", "schaffst", "schafft", "geschafft", "schaffe")
_LENKEN = _GermanVerb("lenk", "lenken", "lenkst", "lenkt", "gelenkt", "lenke")
_SCHLEIFEN = _GermanVerb("schleif", "schleifen", "schleifst", "schleift", "geschleift", "schleife")
_WUCHTEN = _GermanVerb("wucht", "wuchten", "wuchtest", "wuchtet", "gewuchtet", "wuchte")
_TREIBEN = _GermanVerb("treib", "treiben", "treibst", "treibt", "getrieben", "treibe")
_SCHLEPPEN = _GermanVerb("schlepp", "schleppen", "schleppst", "schleppt", "geschleppt", "schleppe")
_MANOEVRIEREN = _GermanVerb(
    "manövrier", "manövrieren", "manövrierst", "manövriert", "manövriert", "manövriere"
)
_VERFRACHTEN = _GermanVerb(
    "verfracht", "verfrachten", "verfrachtest", "verfrachtet", "verfrachtet", "verfrachte"
)
_TUN = _GermanVerb("tu", "tun", "tust", "tut", "getan", "tue")
_ANYWHERE_DE = (_BUGSIEREN, _SCHAFFEN, _LENKEN, _WUCHTEN, _MANOEVRIEREN, _BEFOERDERN, _VERFRACHTEN, _TUN)
# Written together with the verb at the end of a clause.
_SEPARABLE = ("weg", "fort", "vor", "heran", "ran", "her", "zurück", "herbei")
WHERE_DE = {
    "push": (
        *("weg", "weg", "weiter weg", "von dir weg", "nach vorn", "nach vorne", "weiter von dir weg", "fort"),
        *("von dir fort", "ein stück weg", "ein bisschen weiter weg", "etwas von dir weg", "in die ferne"),
    ),
    "pull": (
        *("heran", "ran", "her", "zu dir", "näher", "näher zu dir", "näher heran", "zurück", "zu dir her"),
        *(
            "an dich heran",
            "an dich ran",
            "zu dir hin",
            "näher an dich heran",
            "in deine richtung",
            "zu dir zurück",
        ),
        *("ein stück näher", "etwas näher zu dir", "dichter an dich ran", "näher an dich ran"),
    ),
    **{
        f"slide-to-{side}": (
            *(f"nach {way}", f"nach {way}", f"weiter nach {way}", f"ein bisschen nach {way}"),
            *(
                f"etwas nach {way}",
                f"rüber nach {way}",
                f"ein stück nach {way}",
                f"auf die {way[:-1]}e seite",
            ),
            *(
                f"nach {way} rüber",
                f"nach {way} hinüber",
                f"in richtung {way}",
                f"weiter {way}",
                f"zur {way[:-1]}en seite",
            ),
            *(
                f"ein wenig nach {way}",
                f"{way} rüber",
                f"zu deiner {way[:-1]}en seite",
                f"ein stückchen nach {way}",
            ),
        )
        for side, way in _SIDES_DE.items()
    },
}
"""Ways to say in German where a verb moves things."""
_MOVED_DE = {
    "push": (
        *(_SCHIEBEN, _SCHIEBEN, _SCHIEBEN, _STOSSEN, _SCHUBSEN, _DRUECKEN, _BEWEGEN, _RUECKEN, _STUPSEN),
        *(_ROLLEN, _TREIBEN, *_ANYWHERE_DE),
    ),
    "pull": (
        *(_ZIEHEN, _ZIEHEN, _ZIEHEN, _ZIEHEN, _HOLEN, _BEWEGEN, _RUECKEN, _ZERREN, _BRINGEN, _ROLLEN),
        *(_SCHLEIFEN, _SCHLEPPEN, *_ANYWHERE_DE),
    ),
}
_SIDEWAYS_DE = (
    *(_SCHIEBEN, _SCHIEBEN, _SCHIEBEN, _RUECKEN, _BEWEGEN, _ZIEHEN, _DRUECKEN, _STUPSEN, _BRINGEN, _ROLLEN),
    *(_SCHUBSEN, _SCHLEIFEN, _TREIBEN, *_ANYWHERE_DE),
)


def draw_german_clause(rng: np.random.Generator) -> Clause:
    """A German clause, with the slots of the frames."""
    verb = choice(rng, [*WHERE_DE])
    where = choice(rng, WHERE_DE[verb])
    word = choice(rng, _MOVED_DE.get(verb, _SIDEWAYS_DE))
    if word in (_SCHIEBEN, _ZIEHEN) and verb in _MOVED_DE and rng.random() < 0.15:
        where = ""

    def joined(form: str) -> str:
        return where + form if where in _SEPARABLE else f"{where} {form}".strip()

    together = f"{where}zu{word.infinitive}" if where in _SEPARABLE else joined(f"zu {word.infinitive}")
    imperative = word.imperative if rng.random() < 0.7 or word is _STOSSEN else word.ich
    last = {
        **{"tun": joined(word.infinitive), "zutun": together, "tust": joined(word.du)},
        **{"tut": joined(word.er), "getan": joined(word.participle)},
    }
    forms = {slot: f"{{}} {end}" for slot, end in last.items()} | {f"{slot}_p": last[slot] for slot in last}
    first = {
        **{"tu": f"{imperative} {{}}", "tue": f"{word.ich} {{}}", "er_tut": f"{word.er} {{}}"},
        **{"tu_nicht": f"{imperative} {{}} nicht", "tu_noch_nicht": f"{imperative} {{}} noch nicht"},
        **{"tust_v": f"{word.du} {{}}", "tust_du_nicht": f"{word.du} du {{}} nicht"},
    }
    return Clause(verb, forms | {slot: f"{start} {where}".strip() for slot, start in first.items()})


def draw_plain_german_verb(rng: np.random.Generator) -> tuple[str, str, str]:
    """A verb of ours, and its German imperative and infinitive."""
    verb, word = choice(rng, (("push", _SCHIEBEN), ("pull", _ZIEHEN)))
    return verb, word.imperative, word.infinitive
