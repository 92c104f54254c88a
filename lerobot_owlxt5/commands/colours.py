# SPDX-License-Identifier: Apache-2.0
"""Words for colours: a detector is asked for few of them, and people use many (our list)."""

COLOURS: dict[str, tuple[str, ...]] = {
    "red": ("scarlet", "crimson", "ruby", "cherry"),
    "orange": ("amber", "tangerine"),
    "yellow": ("blonde", "golden", "gold", "lemon yellow", "mustard yellow"),
    "green": ("harlequin", "emerald", "lime", "olive"),
    "cyan": ("greenish blue", "turquoise", "aqua", "teal"),
    "blue": ("azure", "navy", "sky blue", "cobalt"),
    "violet": ("purple", "lilac", "indigo", "lavender", "mauve"),
    "pink": ("rosy", "rose", "magenta", "fuchsia"),
    "brown": ("maroon", "chestnut", "chocolate"),
    "white": ("ivory", "cream"),
    "black": ("jet",),
    "grey": ("gray", "silver"),
}
"""The colours that compete for a thing, and other words for each."""

_BASIC = {word: colour for colour, others in COLOURS.items() for word in (colour, *others)}
_SHADES = {"light", "dark", "bright", "pale", "deep"}
_LONGEST = max(len(word.split()) for word in _BASIC) + 1


def basic_colour(phrase: str) -> str | None:
    """Which of `COLOURS` a phrase such as "dark red" or "crimson" means; None for another phrase."""
    words = phrase.replace("-", " ").split()
    while words[1:] and words[0] in _SHADES:
        words = words[1:]
    return _BASIC.get(" ".join(words))


def split_colour(phrase: str) -> tuple[str, str]:
    """Split a phrase such as "dark red mug" into its colour, or "", and the rest."""
    words = phrase.split()
    for count in range(min(_LONGEST, len(words)), 0, -1):
        if basic_colour(" ".join(words[:count])):
            return " ".join(words[:count]), " ".join(words[count:])
    return "", phrase
