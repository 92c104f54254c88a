# SPDX-License-Identifier: Apache-2.0
"""The words of commands (our choice); `verbs.py` has those of each verb, `parser.py` joins them."""

from .verbs import VERBS


def _list(phrases: str) -> list[str]:
    return phrases.split(", ")


# CLANT calls its cubes by their colour alone, or by a synonym of it.
COLOURS = {"red", "green", "blue", "yellow", "cyan", "violet"}
COLOURS |= {"scarlet", "harlequin", "azure", "blonde", "greenish blue", "purple"}

# The verbs that a phrase may stand for; where that is more than one, a direction has to choose.
VERB_PHRASES = {
    phrase: tuple(name for name, verb in VERBS.items() if phrase in verb.phrases)
    for phrase in dict.fromkeys(phrase for verb in VERBS.values() for phrase in verb.phrases)
}
GERUNDS = {
    **{"pushing": "push", "shoving": "shove", "thrusting": "thrust", "nudging": "nudge"},
    **{"pulling": "pull", "dragging": "drag", "tugging": "tug", "drawing": "draw"},
    **{"sliding": "slide", "gliding": "glide", "sweeping": "sweep", "moving": "move", "shifting": "shift"},
}
VERB_WORDS = {*GERUNDS, *GERUNDS.values()}

DIRECTIONS = {
    how + phrase: name
    for how in ("", "over ", "sideways ", "straight ", "further ")
    for name, verb in VERBS.items()
    for phrase in verb.directions
}

ENDINGS = {",", ", robot", ", nico"}.union(
    _list("please, thanks, thank you, for me, now, right now, right away, at once, again, a bit, a little"),
    _list("slightly, gently, carefully, slowly, can you, could you, will you, would you, if you can"),
    _list("if you could, if you please, if you would, if you like, if you don't mind, if you do not mind"),
)
OPENINGS = ENDINGS.union(
    _list("kindly, robot, nico, hey, hi, hello, ok, okay, so, just, do, go ahead and, try to, let's, let us"),
    _list("would you mind, do you mind, are you able to, be so kind as to, be so good as to, you should"),
    _list("you can, i want you to, i need you to, i would like you to, i'd like you to, i ask you to"),
    _list("may i ask you to, i wonder if you could, is it possible to, would it be possible to"),
)

ARTICLES = {"the", "a", "an", "this", "that", "these", "those"}
PRONOUNS = {"it", "them", "something", "anything", "everything"}
NEGATIONS = {"not", "never", "dont", "cannot", "without"}
# With one of these, a name would be more than a name: a goal, a choice, a condition, one more command.
IN_NO_NAME = {"to", "toward", "towards", "from", "into", "onto", "against", "off", "over", "sideways"}
IN_NO_NAME |= {"or", "but", "then", "if", "when", "until", "me", "my", "your"}
# Behind one of these, a phrase is part of a longer one: "the ball on the left", "to the right now".
UNFINISHED = {"the", "to", "your"}
# Behind "and" or a comma, one of these begins another command or names another object.
BEGINNINGS = VERB_WORDS | ARTICLES | {opening.split()[0] for opening in OPENINGS}

LONGEST_PHRASE = max(len(phrase.split()) for phrase in (*VERB_PHRASES, *DIRECTIONS, *OPENINGS))

# The one slip that is forgiven, two letters swapped, makes no English word that could stand there. One letter
# left out or replaced does: "shoe" is not "shove", nor "light" "right".
SLIPS = {
    word[:i] + word[i + 1] + word[i] + word[i + 2 :]: word
    for word in VERB_WORDS.union(*(phrase.split() for phrase in (*VERB_PHRASES, *DIRECTIONS)))
    for i in range(len(word) - 1)
    if len(word) > 3 and word[i] != word[i + 1]
}
