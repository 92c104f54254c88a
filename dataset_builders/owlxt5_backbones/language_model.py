# SPDX-License-Identifier: Apache-2.0
"""The language model: a small T5, transformers' own class, and the examples that it is trained on."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.utils.data import IterableDataset, get_worker_info
from transformers import AutoTokenizer, PreTrainedTokenizerBase, T5Config, T5ForConditionalGeneration

from lerobot_owlxt5.backbones.language_model import IGNORED
from lerobot_owlxt5.backbones.small_t5 import SmallT5Config, make_small_t5
from lerobot_owlxt5.commands import prompts
from lerobot_owlxt5.commands.verbs import VERBS

from .catalogue import COLOURS
from .grammar import capital, draw_thing, draw_translation
from .rng import choice
from .understanding_lessons import draw_lesson

TEXTS_FOR_THE_TOKENIZER = 20_000
_SORTED = 8

_MORE = {"push": ("shove the {}", "push the {} away"), "pull": ("drag the {}", "pull the {} closer")}
COMMANDS = {
    verb.phrases[0]: (
        f"{verb.phrases[0]} {{}}",
        f"{next(phrase for phrase in verb.phrases if phrase.startswith('move '))} {{}}",
        verb.imperative.format("the {}"),
        *_MORE.get(verb.name, ()),
    )
    for verb in VERBS.values()
}
"""For each of CLANT's verbs the ways to say it: CLANT's own two, and others."""

Example = tuple[str, str]
Kinds = Mapping[str, tuple[Callable[[np.random.Generator], Example], float]]
"""Kinds of examples, how each is drawn, and how often."""


def draw_example(rng: np.random.Generator, kinds: Kinds) -> Example:
    """Draw a prompt, as the policies write them, and what a T5 answers that neither sees nor moves.

    A command is told again in the words of the datasets, so that its encoding holds what it means; a thing
    to describe is named. What was done to it is for the policy to add. What is to be understood gets its
    formal answer.
    """
    draws, shares = zip(*kinds.values(), strict=True)
    return choice(rng, draws, shares)(rng)


class Examples(IterableDataset[Example]):
    """Examples without end, the same for the same seed; each is drawn by itself, so any can be the first.

    The examples of a batch are of similar length: little work goes into padding, and a step takes 0.6 of the
    time. So many are drawn at once as fill `_SORTED` batches, sorted, and given in batches of any order.

    Args:
        kinds: What is drawn.
        seed: Of what is drawn.
        batch_size: Examples in a batch.
        first: How many have been used before.
    """

    def __init__(self, kinds: Kinds, seed: int, batch_size: int = 1, first: int = 0) -> None:
        self._kinds, self._seed, self._batch_size, self._first = kinds, seed, batch_size, first

    def __iter__(self) -> Iterator[Example]:
        worker = get_worker_info()
        start, step = (worker.id, worker.num_workers) if worker else (0, 1)
        window = _SORTED * self._batch_size
        skipped, used = divmod(self._first, window)
        for place in count(skipped + start, step):
            examples = self._window(place, window)
            yield from examples[used if place == skipped else 0 :]

    def _window(self, place: int, size: int) -> list[Example]:
        drawn = [
            draw_example(np.random.default_rng((self._seed, index)), self._kinds)
            for index in range(place * size, (place + 1) * size)
        ]
        drawn.sort(key=lambda example: len(example[0]) + 2 * len(example[1]))
        order = np.random.default_rng((self._seed, place)).permutation(_SORTED)
        return [
            example
            for batch in order.tolist()
            for example in drawn[batch * self._batch_size : (batch + 1) * self._batch_size]
        ]


class ExampleCollator:
    """Makes a batch of examples.

    Args:
        tokenizer: The language model's.
    """

    def __init__(self, tokenizer: PreTrainedTokenizerBase) -> None:
        self._tokenizer = tokenizer

    def __call__(self, examples: Sequence[Example]) -> dict[str, Tensor]:
        """`input_ids`, `attention_mask` and `labels` as T5 takes them."""
        prompts, answers = zip(*examples, strict=True)
        inputs = self._tokenizer(list(prompts), padding=True, return_tensors="pt")
        targets = self._tokenizer(list(answers), padding=True, return_tensors="pt")
        labels = targets["input_ids"].masked_fill(targets["attention_mask"] == 0, IGNORED)
        return {
            "input_ids": inputs["input_ids"],
            "attention_mask": inputs["attention_mask"],
            "labels": labels,
        }


def make_language_model(sizes: SmallT5Config) -> T5ForConditionalGeneration:
    """A T5 with random weights, in the folder of its configuration, whose tokenizer fits the examples."""
    rng = np.random.default_rng(sizes.seed)
    texts = [text for _ in range(TEXTS_FOR_THE_TOKENIZER) for text in draw_example(rng, KINDS)]
    return make_small_t5(sizes, texts)


def load_language_model(name: str, folder: Path, layers: int | None = None) -> T5ForConditionalGeneration:
    """A T5 to go on with, from a folder or the Hub; its tokenizer is copied into the folder of the result.

    It has no dropout: no example comes twice, so there is nothing to learn by heart.

    Args:
        name: Folder, or the Hub's id.
        folder: Of the result.
        layers: Layers of the encoder, if it is to have more. Those that come on top change nothing at first.
    """
    AutoTokenizer.from_pretrained(name).save_pretrained(folder)
    sizes = T5Config.from_pretrained(name, dropout_rate=0.0)
    before, sizes.num_layers = sizes.num_layers, layers or sizes.num_layers
    model = T5ForConditionalGeneration.from_pretrained(name, config=sizes, dtype=torch.float32)
    encoder: Any = model.encoder
    for block in encoder.block[before:]:
        attention, feed_forward = block.layer
        nn.init.zeros_(attention.SelfAttention.o.weight)
        nn.init.zeros_(feed_forward.DenseReluDense.wo.weight)
    return model


def shipped_sizes(folder: Path, seed: int) -> SmallT5Config:
    """Sizes of the language model that is shipped."""
    return SmallT5Config(
        folder, vocab_size=1000, d_model=192, d_kv=32, d_ff=768, num_layers=3, num_heads=6, seed=seed
    )


def _name(rng: np.random.Generator) -> str:
    """What a command may name: a thing, or a cube by its colour alone."""
    if rng.random() < 0.2:
        return choice(rng, choice(rng, [*COLOURS.values()])[0])
    return draw_thing(rng).english


def _translate(rng: np.random.Generator) -> Example:
    english, german = draw_translation(rng)
    return prompts.translate_prompt(capital(english) if rng.random() < 0.7 else english), german


def _name_in_english(rng: np.random.Generator) -> Example:
    """What a thing is called, said in German or in English; a policy does not know which."""
    thing, case = draw_thing(rng), choice(rng, ("nominative", "accusative", "dative"))
    german = thing.german(case).partition(" ")[2].lower()  # type: ignore[arg-type]
    english = thing.english
    if thing.adjective and rng.random() < 0.2:  # a colour alone
        german, english = german.split()[0], thing.adjective
    return prompts.name_in_english_prompt(german if rng.random() < 0.5 else english), english


def _execute(rng: np.random.Generator) -> Example:
    verb, name = choice(rng, [*COMMANDS]), _name(rng)
    return prompts.execute_prompt(choice(rng, COMMANDS[verb]).format(name)), f"{verb} {name}"


def _describe(rng: np.random.Generator) -> Example:
    name = _name(rng)
    return prompts.describe_prompt(name), name


def _describe_with_verb(rng: np.random.Generator) -> Example:
    """Shows the decoder what the policy will ask of it: a verb that the prompt's encoding has in it."""
    verb, name = choice(rng, [*COMMANDS]), _name(rng)
    return prompts.describe_prompt(f"{verb} {name}"), f"{verb} {name}"


def _repeat(rng: np.random.Generator) -> Example:
    said = choice(rng, COMMANDS[choice(rng, [*COMMANDS])]).format(_name(rng))
    return prompts.repeat_language_prompt(said), said


def _repeat_action(rng: np.random.Generator) -> Example:
    return prompts.repeat_action_prompt(), ""


KINDS: Kinds = {
    "translate": (_translate, 0.5),
    "execute": (_execute, 0.15),
    "describe": (_describe, 0.1),
    "describe with a verb": (_describe_with_verb, 0.1),
    "repeat language": (_repeat, 0.14),
    "repeat action": (_repeat_action, 0.01),
}
"""What the policies' language model learns."""
UNDERSTANDING_KINDS: Kinds = {
    "understand": (draw_lesson, 0.92),
    "name in English": (_name_in_english, 0.08),
}
"""What the model learns that understands people."""
