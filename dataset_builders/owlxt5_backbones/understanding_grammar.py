# SPDX-License-Identifier: Apache-2.0
"""What lessons in understanding are made of, in English and German: things to move, and moving them.

Each thing comes with the target that it means, and each clause with its verb. All words are ours.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from lerobot_owlxt5.commands.answer import Landmark, Relation, Target, said_words
from lerobot_owlxt5.commands.pseudo_names import draw_name

from .catalogue import CATEGORIES, COLOURS
from .grammar import ADJECTIVES, COMPOUNDS, DEFINITE, INDEFINITE, Case, Gender, Noun, compound, nouns
from .rng import choice

_COLOURS = (
    *(name for names, _ in COLOURS.values() for name in names),
    *("turquoise", "beige", "light blue", "dark red", "pale pink", "lime", "maroon", "olive", "golden"),
    *("silver", "indigo", "magenta", "dark green", "bright yellow", "teal", "ruby", "sky blue", "lilac"),
)
_COLOURS_DE = (*[*ADJECTIVES.values()][:20], "dunkelrot", "hellblau", "dunkelgrün", "bunt", "hellrosa")
_QUALITIES = [*ADJECTIVES][20:]
_SHARE_INVENTED, _SHARE_COLOURED, _SHARE_QUALITY, _SHARE_MARKED = 0.25, 0.3, 0.1, 0.4

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
    "b",
    "ck",
    "f",
    "g",
    "ks",
    "l",
    "lt",
    "m",
    "n",
    "nd",
    "p",
    "r",
    "rm",
    "rt",
    "s",
    "t",
    "x",
)

_SIDE_BEFORE = {
    "left": ("left", "leftmost", "left hand"),
    "right": ("right", "rightmost", "right hand"),
    "middle": ("middle", "central", "centre"),
    "near": ("nearest", "closest", "front", "lower"),
    "far": ("farthest", "back", "rear", "upper", "most distant"),
}
_SIDE_BEHIND = {
    "left": ("on the left", "on the left side", "that is on the left", "at the left", "on your left"),
    "right": ("on the right", "on the right side", "that is on the right", "at the right", "on your right"),
    "middle": ("in the middle", "in the centre", "that stands in the middle"),
    "near": ("closest to you", "nearest to you", "in front", "right before you"),
    "far": ("farthest away", "at the back", "farthest from you", "at the very back"),
}
_SIDE_BEFORE_DE = {
    "left": ("link", "ganz link"),
    "right": ("recht", "ganz recht"),
    "middle": ("mittler",),
    "near": ("vorder", "vorderst", "nächst"),
    "far": ("hinter", "hinterst"),
}
_SIDE_BEHIND_DE = {
    "left": ("links", "ganz links", "auf der linken seite"),
    "right": ("rechts", "ganz rechts", "auf der rechten seite"),
    "middle": ("in der mitte",),
    "near": ("vorne", "ganz vorne"),
    "far": ("hinten", "ganz hinten"),
}
_RELATIONS = {
    "left of": ("left of", "to the left of", "on the left of", "on the left side of"),
    "right of": ("right of", "to the right of", "on the right of", "on the right side of"),
    "behind": ("behind", "just behind", "at the back of"),
    "before": ("in front of", "just in front of", "before"),
    "next to": ("next to", "beside", "close to", "near", "by"),
    "between": ("between",),
}
_RELATIONS_DE = {
    "left of": ("links von", "links neben"),
    "right of": ("rechts von", "rechts neben"),
    "behind": ("hinter", "direkt hinter"),
    "before": ("vor", "direkt vor"),
    "next to": ("neben", "bei"),
    "between": ("zwischen",),
}
_JOINED = ("", "", "that is ", "which is ", "standing ", "that stands ", "lying ")
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
    noun = choice(rng, nouns())
    if rng.random() < 0.15:
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


def draw_thing(rng: np.random.Generator, *, plain: bool = False) -> Thing:
    """An English thing; a plain one has a name and perhaps a colour."""
    if not plain and rng.random() < 0.06:
        other = rng.random() < 0.5
        said = choice(rng, ("the other one", "the other") if other else ("it", "that one", "the same one"))
        return _english(Target(reference="other" if other else "it"), said)
    name = draw_noun(rng).english
    if rng.random() < _SHARE_QUALITY:
        name = f"{choice(rng, _QUALITIES)} {name}"
    colour = draw_colour(rng) if rng.random() < _SHARE_COLOURED else ""
    if colour and rng.random() < 0.25:
        # "the red one", and CLANT's "red".
        said, name = choice(rng, (f"the {colour} one", f"the {colour} one", colour, f"the {colour}")), ""
    elif not plain and rng.random() < 0.08:
        name = choice(rng, ("thing", "object", "", ""))
        said = f"the {colour} {name or 'one'}".replace("  ", " ")
    else:
        head, _, tail = name.partition(" ") if name.split()[0] in _QUALITIES else ("", "", name)
        article = choice(rng, ("the", "the", "the", "the", "the", "that", "this", "my", ""))
        said = " ".join(f"{article} {head} {colour} {tail}".split())
        if colour and rng.random() < 0.12:
            that = choice(
                rng, ("the {} that is {}", "the {} which is {}", "the {} in {}", "the {} coloured {}")
            )
            said = that.format(name, colour)
    target = Target(name, colour)
    if plain or rng.random() > _SHARE_MARKED:
        return _english(target, said) if target != Target() else draw_thing(rng, plain=plain)
    return _english(*_marked(rng, target, said))


def _english(target: Target, said: str) -> Thing:
    target = replace(target, name=" ".join(said_words(target.name)), colour=target.colour)
    cases: tuple[Case, ...] = ("nominative", "accusative", "dative")
    return Thing(target, dict.fromkeys(cases, said), dict.fromkeys(cases, "it"))


def _marked(rng: np.random.Generator, target: Target, said: str) -> tuple[Target, str]:
    """The same with a side, a place in a row, a relation, or as the other one."""
    rest = said.removeprefix("the ") if said.startswith("the ") else ""
    if not rest:
        rest = " ".join(said.split()[1:]) if said.split()[0] in ("that", "this", "my") else said
        rest = rest if target.name else f"{target.colour} one"
    kind = rng.random()
    if kind < 0.2:
        side = choice(rng, [*_SIDE_BEFORE])
        return replace(target, side=side), f"the {choice(rng, _SIDE_BEFORE[side])} {rest}"
    if kind < 0.4:
        side = choice(rng, [*_SIDE_BEHIND])
        return replace(target, side=side), f"the {rest} {choice(rng, _SIDE_BEHIND[side])}"
    if kind < 0.52:
        rank, side = choice(rng, [*_RANKS]), choice(rng, ("left", "right"))
        counted = choice(rng, ("from the {}", "from {}", "counted from the {}", "from the {} side")).format(
            side
        )
        if rng.random() < 0.2:
            return replace(target, side=side), f"the first {rest} {counted}"
        return replace(target, order=(rank, side)), f"the {choice(rng, _RANKS[rank])} {rest} {counted}"
    if kind < 0.62:
        return replace(target, reference="other"), f"the other {rest}"
    kinds = [*_RELATIONS]
    relation = choice(rng, kinds)
    things = [draw_thing(rng, plain=True) for _ in range(2 if relation == "between" else 1)]
    marks = tuple(Landmark(thing.target.name, thing.target.colour) for thing in things)
    how = choice(rng, _JOINED) + choice(rng, _RELATIONS[relation])
    landmarks = " and ".join(thing.texts["dative"] for thing in things)
    return replace(target, relation=Relation(relation, marks)), f"the {rest} {how} {landmarks}"


_PRONOUNS: dict[Gender, dict[Case, str]] = {
    "m": {"nominative": "er", "accusative": "ihn", "dative": "ihm"},
    "f": {"nominative": "sie", "accusative": "sie", "dative": "ihr"},
    "n": {"nominative": "es", "accusative": "es", "dative": "ihm"},
}


def draw_german_thing(rng: np.random.Generator, case: Case, *, plain: bool = False) -> Thing:
    """A German thing in a case: names and colours are copied as said, with their endings."""
    noun = draw_noun(rng)
    if rng.random() < 0.06:
        noun = Noun("thing", "Ding", "n")
    if not plain and rng.random() < 0.04:
        said = _PRONOUNS[noun.gender][case]
        return Thing(Target(reference="it"), {case: said}, {case: said})
    definite = rng.random() < 0.95
    article, ending = (DEFINITE if definite else INDEFINITE)[case][noun.gender]
    name = " ".join(said_words(noun.german))
    colour, marks, behind = "", Target(), ""
    if rng.random() < _SHARE_COLOURED:
        colour = choice(rng, _COLOURS_DE) + ending
        name = "" if rng.random() < 0.25 else name
    before: list[str] = [colour] if colour else []
    if not plain and rng.random() < _SHARE_MARKED:
        kind = rng.random()
        if kind < 0.25:
            marks = Target(side=choice(rng, [*_SIDE_BEFORE_DE]))
            before.insert(0, choice(rng, _SIDE_BEFORE_DE[marks.side]) + ending)
        elif kind < 0.45:
            marks = Target(side=choice(rng, [*_SIDE_BEHIND_DE]))
            behind = choice(rng, _SIDE_BEHIND_DE[marks.side])
        elif kind < 0.57:
            rank, side = choice(rng, [*_RANKS_DE]), choice(rng, [*_SIDES_DE])
            marks, behind = Target(order=(rank, side)), f"von {_SIDES_DE[side]}"
            before.insert(0, _RANKS_DE[rank] + ending)
        elif kind < 0.7:
            marks = Target(reference="other")
            before.insert(0, f"ander{ending}")
        else:
            relation = choice(rng, [*_RELATIONS_DE])
            things = [
                draw_german_thing(rng, "dative", plain=True) for _ in range(2 if relation == "between" else 1)
            ]
            landmarks = tuple(Landmark(thing.target.name, thing.target.colour) for thing in things)
            marks = Target(relation=Relation(relation, landmarks))
            behind = choice(rng, _RELATIONS_DE[relation]) + " "
            behind += " und ".join(thing.texts["dative"] for thing in things)
        if before and rng.random() < 0.15:
            name = ""
    said = " ".join([article, *before, *([name] if name else []), *([behind] if behind else [])])
    target = replace(marks, name=name, colour=" ".join(said_words(colour)))
    return Thing(target, {case: said}, {case: _PRONOUNS[noun.gender][case]})


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
    )
}
WHERE = {
    "push": ("away", "away from you", "forward", "forwards", "further away", "farther from you", "ahead"),
    "pull": ("closer", "closer to you", "towards you", "back towards you", "nearer", "nearer to you", "back"),
    **{
        f"slide-to-{side}": (
            *(f"to the {side}", f"to the {side}", side, f"to your {side}", f"{side}wards", f"{side}ward"),
            *(f"over to the {side}", f"to the {side} side", f"further {side}", f"a bit to the {side}"),
            *(f"a little {side}", f"towards the {side}"),
        )
        for side in ("left", "right")
    },
}
"""Ways to say where a verb moves things."""
_ANYWHERE = ("ease", "inch", "scoot", "edge", "slip", "steer", "guide", "send", "transfer", "budge", "wheel")
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
    ),
    "pull": (
        *("pull", "pull", "pull", "drag", "drag", "move", "move", "bring", "shift", "get"),
        *("draw", "tow", "lug", "heave", "haul", *_ANYWHERE),
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
# Written together with the verb at the end of a clause.
_SEPARABLE = ("weg", "fort", "vor", "heran", "ran", "her", "zurück", "herbei")
WHERE_DE = {
    "push": ("weg", "weiter weg", "von dir weg", "nach vorn", "nach vorne", "weiter von dir weg", "fort"),
    "pull": ("heran", "ran", "her", "zu dir", "näher", "näher zu dir", "näher heran", "zurück", "zu dir her"),
    **{
        f"slide-to-{side}": (
            *(f"nach {way}", f"nach {way}", f"weiter nach {way}", f"ein bisschen nach {way}"),
            *(
                f"etwas nach {way}",
                f"rüber nach {way}",
                f"ein stück nach {way}",
                f"auf die {way[:-1]}e seite",
            ),
        )
        for side, way in _SIDES_DE.items()
    },
}
"""Ways to say in German where a verb moves things."""
_MOVED_DE = {
    "push": (
        *(_SCHIEBEN, _SCHIEBEN, _SCHIEBEN, _STOSSEN, _SCHUBSEN, _DRUECKEN, _BEWEGEN, _RUECKEN, _STUPSEN),
        *(_ROLLEN, _BEFOERDERN),
    ),
    "pull": (_ZIEHEN, _ZIEHEN, _ZIEHEN, _ZIEHEN, _HOLEN, _BEWEGEN, _RUECKEN, _ZERREN, _BRINGEN, _ROLLEN),
}
_SIDEWAYS_DE = (
    *(_SCHIEBEN, _SCHIEBEN, _SCHIEBEN, _RUECKEN, _BEWEGEN, _ZIEHEN, _DRUECKEN, _STUPSEN, _BRINGEN, _ROLLEN),
    *(_BEFOERDERN, _SCHUBSEN),
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
