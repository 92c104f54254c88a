# SPDX-License-Identifier: Apache-2.0
"""The words of tasks (our choice); `verbs.py` has those of each verb, `parser.py` joins them."""

from .verbs import VERBS

# CLANT calls its cubes by their colour alone, or by a synonym of it.
CUBE_NAMES = {"red", "green", "blue", "yellow", "cyan", "violet"}
CUBE_NAMES |= {"scarlet", "harlequin", "azure", "blonde", "greenish blue", "purple"}

# The verbs that a phrase may stand for; where that is more than one, a direction has to choose.
VERB_PHRASES = {
    phrase: tuple(name for name, verb in VERBS.items() if phrase in verb.phrases)
    for phrase in dict.fromkeys(phrase for verb in VERBS.values() for phrase in verb.phrases)
}
DIRECTIONS = {
    how + phrase: name
    for how in ("", "over ", "sideways ", "straight ", "further ")
    for name, verb in VERBS.items()
    for phrase in verb.directions
}

ARTICLES = {"the", "a", "an", "this", "that", "these", "those"}
# With one of these, a name would be more than a name: a goal, a choice, a condition, one more command.
IN_NO_NAME = {"to", "toward", "towards", "from", "into", "onto", "against", "off", "over", "sideways"}
IN_NO_NAME |= {"or", "but", "then", "if", "when", "until", "me", "my", "your"}
# And these alone are no name: they point at things, or at people.
NO_NAMES = {"it", "them", "this", "that", "one", "other", "thing", "object", "left", "right", "middle"}
NO_NAMES |= {"near", "far", "please", "me", "you", "nothing", "everything", "something", "anything"}
# With one of these, a command is more than a formal one: "push mug later", "push no mug".
INFORMAL = {"no", "not", "never", "none", "nor", "neither", "and", "both", "all", "every", "some", "any"}
INFORMAL |= {"later", "now", "soon", "today", "tomorrow", "tonight", "yet", "again", "together", "back"}
INFORMAL |= {"away", "forward", "up", "down", "closer", "further", "harder", "gently", "slowly", "by", "with"}
INFORMAL |= {"at", "in", "on", "of", "is", "was", "are", "its", "their", "his", "her", "first", "second"}
INFORMAL |= ARTICLES | NO_NAMES | IN_NO_NAME
# Behind one of these, a phrase is part of a longer one: "the ball on the left", "to the right now".
UNFINISHED = {"the", "to", "your"}
LONGEST_PHRASE = max(len(phrase.split()) for phrase in (*VERB_PHRASES, *DIRECTIONS))

# What it looks for, beside the objects of its training, when it is asked what it sees or sees no such thing.
THINGS = (
    *("cube", "ball", "can", "mug", "wine bottle", "water bottle", "mustard bottle", "ketchup bottle"),
    *("chess piece", "bowl", "plate", "glass", "jar", "box", "book", "candle", "traffic cone", "cone"),
    *("pyramid", "cylinder", "ring", "donut", "egg", "apple", "orange fruit", "pear", "lemon", "banana"),
    *("carrot", "mushroom", "ice cream cone", "dice", "light bulb", "lamp", "toy car", "spray can", "vase"),
    *("toy house", "toy tree", "snowman", "pen", "hammer", "spoon"),
)
