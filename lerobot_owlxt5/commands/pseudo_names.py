# SPDX-License-Identifier: Apache-2.0
"""Made-up names of objects, for small language models: the embedded one, or one that is trained along.

A pretrained T5 knows that "ball" is a name as "red" is one. A small T5 knows few names, and one that begins
with random weights those of its training data alone: any other name would disturb the movement. Where the
object is comes from the detector, and what to call it stands in the prompt: so any name may take the place of
the true one, and the policy learns to move whatever the name is and to repeat names that it never saw. This
is our addition to the paper.
"""

import string

import numpy as np

from .parser import parse_command, plain

# Share of the samples whose object gets a made-up name.
SHARE = 0.1
_MOST_WORDS = 3
# Long enough to be hardly ever a word with a meaning in commands, such as an article.
_SHORTEST_WORD, _LONGEST_WORD = 4, 7


def draw_name(dice: np.random.Generator) -> str:
    """Draw one to three words of random letters."""
    lengths = dice.integers(
        _SHORTEST_WORD, _LONGEST_WORD, dice.integers(1, _MOST_WORDS, endpoint=True), endpoint=True
    )
    return " ".join("".join(dice.choice([*string.ascii_lowercase], length)) for length in lengths)


def rename_object(text: str, name: str) -> str:
    """Put another name in place of a command's object; a text without a known verb stays as it is."""
    command = parse_command(text)
    if command.verb is None:
        return text
    before, _, after = plain(text).rpartition(command.object)
    return f"{before}{name}{after}"
