# SPDX-License-Identifier: Apache-2.0
"""Wordings that no dataset of ours has, to see how far a policy depends on the words it was trained on."""

from collections.abc import Iterable, Mapping

import numpy as np

from ..commands.parser import object_name, parse_command, spoken
from ..commands.verbs import VERBS
from ..data.episode_store import EpisodeTexts

COMMAND_KINDS = ("synonyms", "polite", "typos")
LABEL_KINDS = ("synonyms", "full names", "typos")

_POLITE = (
    "could you please {}?",
    "please {}",
    "can you {} for me?",
    "I would like you to {}.",
    "would you be so kind as to {}?",
)
# Dropping or swapping a letter of a shorter word leaves nothing to recognise.
_SHORTEST_WORD = 3


def reword_command(text: str, kind: str, rng: np.random.Generator) -> str:
    """Say a command in other words.

    Args:
        text: A command whose verb is one of `verbs.VERBS`, such as "push red".
        kind: One of `COMMAND_KINDS`: `synonyms` ("shove the red cube"), `polite` ("please push the red
            cube"), or `typos` ("psuh red": one letter dropped or two neighbours swapped in verb or name).
        rng: Draws among the possibilities.

    Raises:
        ValueError: If the verb is not known.
    """
    command = parse_command(text)
    if command.verb is None:
        raise ValueError(
            f"--robustness rewords commands with the verbs {', '.join(VERBS)}, and the task {text!r} has "
            "none of them. Evaluate this dataset without --robustness."
        )
    name = object_name(command.object)
    if kind == "synonyms":
        return str(rng.choice(VERBS[command.verb].unseen)).format(name)
    if kind == "polite":
        return str(rng.choice(_POLITE)).format(VERBS[command.verb].imperative.format(f"the {name}"))
    text = spoken(text)
    return misspell(text, {text.split()[0], *command.object.split()}, rng)


def reword_labels(
    labels: Iterable[str], kind: str, texts: Mapping[int, EpisodeTexts], rng: np.random.Generator
) -> dict[str, str]:
    """Other names for the objects that `describe` looks for.

    Args:
        labels: The objects' names in the dataset's tasks.
        kind: One of `LABEL_KINDS`: `synonyms` (the dataset's own second name, such as "scarlet", which
            `describe` never has as a label in training; objects without one keep their name), `full names`
            ("the red cube"), or `typos`.
        texts: Texts of the episodes, which have the synonyms.
        rng: Draws the typos.

    Returns:
        The new name of each label, in the order of `labels`.
    """
    if kind == "synonyms":
        synonyms = {}
        for episode in texts.values():
            names = list(dict.fromkeys(parse_command(wording).object for wording in episode.wordings))
            if len(names) > 1:
                synonyms[names[0]] = names[1]
        return {label: synonyms.get(label, label) for label in labels}
    if kind == "full names":
        return {label: f"the {object_name(label)}" for label in labels}
    return {label: misspell(label, set(label.split()), rng) for label in labels}


def misspell(text: str, words: set[str], rng: np.random.Generator) -> str:
    """Drop a letter, or swap two neighbours, in one of those of a text's words that have three letters.

    Args:
        text: The text.
        words: The words of it in which an error may be made.
        rng: Draws the word and the error.
    """
    parts = text.split()
    eligible = [index for index, part in enumerate(parts) if part in words and len(part) >= _SHORTEST_WORD]
    if not eligible:
        return text
    chosen = int(rng.choice(eligible))
    parts[chosen] = str(rng.choice(_errors(parts[chosen])))
    return " ".join(parts)


def _errors(word: str) -> list[str]:
    """All words that differ from `word` by a dropped letter or by two neighbours that are swapped."""
    dropped = [word[:at] + word[at + 1 :] for at in range(len(word))]
    swapped = [word[:at] + word[at + 1] + word[at] + word[at + 2 :] for at in range(len(word) - 1)]
    return [error for error in dict.fromkeys([*dropped, *swapped]) if error != word]
