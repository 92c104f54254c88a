# SPDX-License-Identifier: Apache-2.0
"""Words that no dataset of ours has."""

import numpy as np
import pytest

from lerobot_owlxt5.commands.verbs import VERBS
from lerobot_owlxt5.data.episode_store import EpisodeTexts
from lerobot_owlxt5.evaluation.rewording import (
    COMMAND_KINDS,
    LABEL_KINDS,
    misspell,
    reword_command,
    reword_labels,
)

OWN = {
    "push": ("push", "move up"),
    "pull": ("pull", "move down"),
    "slide-to-left": ("slide to left", "move sideways to left"),
    "slide-to-right": ("slide to right", "move sideways to right"),
}
TEXTS = {
    0: EpisodeTexts(("push red", "move-up red", "push scarlet", "move-up scarlet")),
    1: EpisodeTexts(("pull mug",)),
}


@pytest.mark.parametrize("kind", COMMAND_KINDS)
@pytest.mark.parametrize("verb", VERBS)
@pytest.mark.parametrize(("name", "full"), [("red", "red cube"), ("empty wine bottle", "empty wine bottle")])
def test_a_reworded_command_says_the_same_in_other_words(kind: str, verb: str, name: str, full: str) -> None:
    drawn = {reword_command(f"{verb} {name}", kind, np.random.default_rng(seed)) for seed in range(40)}
    assert len(drawn) >= 3
    for text in drawn:
        assert text not in {f"{own} {name}" for own in OWN[verb]}
        if kind != "typos":
            assert full in text
        if "slide" in verb:
            assert verb.removeprefix("slide-to-") in text
    if kind == "synonyms":
        assert not any(word in text.split() for text in drawn for word in ("push", "pull", "slide", "move"))


def test_the_same_seed_draws_the_same_words() -> None:
    for kind in COMMAND_KINDS:
        assert len({reword_command("pull mug", kind, np.random.default_rng((7, 3))) for _ in range(3)}) == 1


def test_a_command_without_a_verb_of_ours_is_refused() -> None:
    with pytest.raises(ValueError, match=r"'dance wildly'.*--robustness"):
        reword_command("dance wildly", "polite", np.random.default_rng(0))


@pytest.mark.parametrize("seed", range(20))
def test_a_typo_is_one_letter_dropped_or_two_swapped(seed: int) -> None:
    text = misspell("slide to left ball", {"slide", "ball"}, np.random.default_rng(seed))
    before, after = ["slide", "to", "left", "ball"], text.split()
    assert len(after) == 4
    [changed] = [index for index in range(4) if before[index] != after[index]]
    assert changed in (0, 3)
    old, new = before[changed], after[changed]
    if len(new) == len(old):
        assert sorted(new) == sorted(old)
        assert sum(a != b for a, b in zip(old, new, strict=True)) == 2
    else:
        assert any(old[:at] + old[at + 1 :] == new for at in range(len(old)))


def test_too_short_a_word_stays_as_it_is() -> None:
    assert misspell("TV", {"TV"}, np.random.default_rng(0)) == "TV"


def test_labels_are_reworded() -> None:
    labels = ["red", "mug"]
    reworded = {kind: reword_labels(labels, kind, TEXTS, np.random.default_rng(0)) for kind in LABEL_KINDS}
    assert reworded["synonyms"] == {"red": "scarlet", "mug": "mug"}
    assert reworded["full names"] == {"red": "the red cube", "mug": "the mug"}
    assert list(reworded["typos"]) == labels
    assert all(new != old for old, new in reworded["typos"].items())
