# SPDX-License-Identifier: Apache-2.0
"""Commands such as "push the red cube": which verb, which object."""

import re
from dataclasses import dataclass

# CLANT calls its cubes by their colour alone, or by a synonym of it.
_COLOURS = ("red", "green", "blue", "yellow", "cyan", "violet")
_SYNONYMS = ("scarlet", "harlequin", "azure", "blonde", "greenish blue", "purple")

# In each pattern, spaces stand for hyphens too, articles are gone, and the group is the object.
_VERBS: dict[str, tuple[re.Pattern[str], str]] = {
    verb: (re.compile(pattern), done)
    for verb, pattern, done in (
        ("push", r"(?:push|move up) (?P<object>.+)", "I pushed the {}."),
        ("pull", r"(?:pull|move down) (?P<object>.+)", "I pulled the {}."),
        (
            "slide-to-left",
            r"(?:slide|move sideways) (?:to left (?P<object>.+)|(?P<before>.+) to left)",
            "I slid the {} to the left.",
        ),
        (
            "slide-to-right",
            r"(?:slide|move sideways) (?:to right (?P<object>.+)|(?P<before>.+) to right)",
            "I slid the {} to the right.",
        ),
    )
}
VERBS = tuple(_VERBS)


@dataclass(frozen=True)
class Command:
    """What a text asks for.

    Attributes:
        verb: One of `VERBS`, or None if the text begins with no verb that we know.
        object: The object's name as the text has it; the whole text if there is no known verb.
    """

    verb: str | None
    object: str

    @property
    def done(self) -> str:
        """A sentence that says that the command was carried out."""
        return _VERBS[self.verb][1].format(object_name(self.object)) if self.verb else "I did it."


def spoken(text: str) -> str:
    """Write a text as it is said: the hyphens of CLANT's phrases become spaces."""
    return " ".join(text.replace("-", " ").split())


def plain(text: str) -> str:
    """Reduce a phrase to what counts in a comparison: lower case, no hyphens, punctuation or articles."""
    words = re.sub(r"[^\w\s']", " ", spoken(text).lower()).split()
    return " ".join(word for word in words if word not in ("the", "a", "an"))


def parse_command(text: str) -> Command:
    """Find verb and object in a command.

    "push red", "Push the red cube!", "move-sideways-to-left scarlet" and "slide the mug to the right" are all
    understood. A text of another kind is one object phrase, so that the tasks of any dataset can be used.
    """
    phrase = plain(text)
    for verb, (pattern, _) in _VERBS.items():
        match = pattern.fullmatch(phrase)
        if match:
            return Command(verb, next(group for group in match.groups() if group is not None))
    return Command(None, phrase)


def object_name(phrase: str) -> str:
    """Name an object in full: "red" is the red cube."""
    name = plain(phrase)
    return f"{name} cube" if name in _COLOURS + _SYNONYMS else name


def with_article(name: str) -> str:
    """Put "a" or "an" before a name."""
    return f"{'an' if name[:1] in tuple('aeiou') else 'a'} {name}"
