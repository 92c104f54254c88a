# SPDX-License-Identifier: Apache-2.0
"""The tongue: a small T5, transformers' own class, and what it learns to say."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from torch import Tensor
from torch.utils.data import IterableDataset, get_worker_info
from transformers import PreTrainedTokenizerBase, T5ForConditionalGeneration

from lerobot_owlxt5.backbones.language_model import IGNORED
from lerobot_owlxt5.backbones.small_t5 import SmallT5Config, make_small_t5
from lerobot_owlxt5.commands import prompts

from .catalogue import COLOURS
from .dice import pick
from .grammar import capital, draw_thing, draw_translation

TEXTS_FOR_THE_TOKENIZER = 20_000

COMMANDS = {
    "push": ("push {}", "move up {}", "push the {}", "shove the {}", "push the {} away"),
    "pull": ("pull {}", "move down {}", "pull the {}", "drag the {}", "pull the {} closer"),
    "slide to left": ("slide to left {}", "move sideways to left {}", "slide the {} to the left"),
    "slide to right": ("slide to right {}", "move sideways to right {}", "slide the {} to the right"),
}
"""Ways to say what CLANT says in few words."""

Lesson = tuple[str, str]


def draw_lesson(random: np.random.Generator) -> Lesson:
    """Draw a prompt, as the policies write them, and what a T5 answers that neither sees nor moves.

    A command is told again in the words of the data sets, so that its encoding holds what it means; a thing
    to describe is named. What was done to it is for the policy to add.
    """
    kinds, shares = zip(*KINDS.values(), strict=True)
    draw: Callable[[np.random.Generator], Lesson] = kinds[int(random.choice(len(kinds), p=shares))]
    return draw(random)


class Lessons(IterableDataset[Lesson]):
    """Lessons without end, the same for the same seed.

    Args:
        seed: Of what is drawn.
    """

    def __init__(self, seed: int) -> None:
        self._seed = seed

    def __iter__(self) -> Iterator[Lesson]:
        worker = get_worker_info()
        random = np.random.default_rng((self._seed, worker.id if worker else 0))
        while True:
            yield draw_lesson(random)


class Tokens:
    """Makes a batch of lessons.

    Args:
        tokenizer: The tongue's.
    """

    def __init__(self, tokenizer: PreTrainedTokenizerBase) -> None:
        self._tokenizer = tokenizer

    def __call__(self, lessons: Sequence[Lesson]) -> dict[str, Tensor]:
        """`input_ids`, `attention_mask` and `labels` as T5 takes them."""
        prompts, answers = zip(*lessons, strict=True)
        inputs = self._tokenizer(list(prompts), padding=True, return_tensors="pt")
        targets = self._tokenizer(list(answers), padding=True, return_tensors="pt")
        labels = targets["input_ids"].masked_fill(targets["attention_mask"] == 0, IGNORED)
        return {
            "input_ids": inputs["input_ids"],
            "attention_mask": inputs["attention_mask"],
            "labels": labels,
        }


def make_tongue(sizes: SmallT5Config) -> T5ForConditionalGeneration:
    """A T5 with random weights, in the folder of its configuration, whose tokenizer fits the lessons."""
    random = np.random.default_rng(sizes.seed)
    texts = [text for _ in range(TEXTS_FOR_THE_TOKENIZER) for text in draw_lesson(random)]
    return make_small_t5(sizes, texts)


def shipped_sizes(folder: Path, seed: int) -> SmallT5Config:
    """Sizes of the tongue that is shipped."""
    return SmallT5Config(
        folder, vocab_size=1000, d_model=192, d_kv=32, d_ff=768, num_layers=3, num_heads=6, seed=seed
    )


def _name(random: np.random.Generator) -> str:
    """What a command may name: a thing, or a cube by its colour alone."""
    if random.random() < 0.2:
        return pick(random, pick(random, [*COLOURS.values()])[0])
    return draw_thing(random).english


def _translate(random: np.random.Generator) -> Lesson:
    english, german = draw_translation(random)
    return prompts.translate_prompt(capital(english) if random.random() < 0.7 else english), german


def _execute(random: np.random.Generator) -> Lesson:
    verb, name = pick(random, [*COMMANDS]), _name(random)
    return prompts.execute_prompt(pick(random, COMMANDS[verb]).format(name)), f"{verb} {name}"


def _describe(random: np.random.Generator) -> Lesson:
    name = _name(random)
    return prompts.describe_prompt(name), name


def _describe_with_verb(random: np.random.Generator) -> Lesson:
    """Shows the decoder what the policy will ask of it: a verb that the prompt's encoding has in it."""
    verb, name = pick(random, [*COMMANDS]), _name(random)
    return prompts.describe_prompt(f"{verb} {name}"), f"{verb} {name}"


def _repeat(random: np.random.Generator) -> Lesson:
    said = pick(random, COMMANDS[pick(random, [*COMMANDS])]).format(_name(random))
    return prompts.repeat_language_prompt(said), said


def _repeat_action(random: np.random.Generator) -> Lesson:
    return prompts.repeat_action_prompt(), ""


KINDS: dict[str, tuple[Callable[[np.random.Generator], Lesson], float]] = {
    "translate": (_translate, 0.5),
    "execute": (_execute, 0.15),
    "describe": (_describe, 0.1),
    "describe with a verb": (_describe_with_verb, 0.1),
    "repeat language": (_repeat, 0.14),
    "repeat action": (_repeat_action, 0.01),
}
"""Kinds of lessons, how each is drawn, and how often."""
