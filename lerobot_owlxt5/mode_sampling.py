# SPDX-License-Identifier: Apache-2.0
"""Which mode each sample of a training batch is in, what goes in as text and what should come out."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from .commands import pseudo_names
from .commands.parser import parse_command, spoken
from .commands.prompts import (
    DESCRIBE,
    MODES,
    REPEAT_LANGUAGE,
    TRANSLATE,
    describe_prompt,
    execute_prompt,
    repeat_action_prompt,
    repeat_language_prompt,
    translate_prompt,
)
from .data.episode_store import EpisodeTexts

# The fractional part of its multiples is spread evenly over [0, 1).
GOLDEN_RATIO = 0.6180339887498949


class ModeBatch(NamedTuple):
    """What each sample of a training batch is asked for.

    Attributes:
        mode: (batch,) int64, indices into `MODES`.
        prompts: Text that goes in.
        targets: Text that should come out. In translate that is the German sentence, or "" where the dataset
            has none; the mixed loss does not use it.
    """

    mode: Tensor
    prompts: list[str]
    targets: list[str]


class ModeSampler:
    """Draws a mode, a wording and now and then a pseudo-name for each sample.

    Args:
        probabilities: By mode, need not sum to 1. An episode without a sentence is never in translate.
        texts: Wordings and sentences by episode index.
        names_objects: Whether describe's prompt names the object.
        pseudo_names: Whether some objects get a pseudo-name, where a prompt names them.
        per_sample: Whether each sample has a mode of its own; else a batch has one, but for episodes that
            cannot be translated.
    """

    def __init__(
        self,
        probabilities: Mapping[str, float],
        texts: Mapping[int, EpisodeTexts],
        *,
        names_objects: bool,
        pseudo_names: bool,
        per_sample: bool = True,
    ) -> None:
        self._shares = [probabilities.get(mode, 0.0) for mode in MODES]
        self._texts = texts
        self._names_objects = names_objects
        self._pseudo_names = pseudo_names
        self._per_sample = per_sample

    def sample(self, batch: Mapping[str, Any], rngs: Sequence[np.random.Generator] | None) -> ModeBatch:
        """Draw the modes and texts of a batch.

        Args:
            batch: `task`, `episode_index` and `index`.
            rngs: Each sample's own random numbers. None: nothing is random, as in an evaluation: modes are
                spread evenly over the frames, and texts are the tasks themselves.
        """
        tasks: list[str] = batch["task"]
        texts = [
            self._texts.get(episode, EpisodeTexts()) for episode in batch["episode_index"].flatten().tolist()
        ]
        probabilities = torch.tensor(
            [
                [
                    share * (mode != "translate" or each.sentence is not None)
                    for mode, share in zip(MODES, self._shares, strict=True)
                ]
                for each in texts
            ]
        )
        if rngs is None:
            chance = spread(batch["index"].flatten().cpu())
        else:
            chance = torch.tensor([rng.random() for rng in rngs], dtype=torch.float64)
            chance = chance if self._per_sample else chance[:1].expand(len(rngs))
        mode = draw_modes(probabilities, chance)
        prompts, targets = [], []
        for sample, drawn in enumerate(mode.tolist()):
            task = wording = tasks[sample]
            if rngs is not None:
                # Without its name to look for, nobody can tell which object has got a pseudo-name.
                renames = self._pseudo_names and (self._names_objects or drawn == REPEAT_LANGUAGE)
                task, wording = _draw_words(task, texts[sample], rngs[sample], renames)
            label = parse_command(task).object if self._names_objects else ""
            prompts.append(
                (
                    execute_prompt(wording),
                    describe_prompt(label),
                    repeat_action_prompt(),
                    translate_prompt(texts[sample].sentence or ""),
                    repeat_language_prompt(wording),
                )[drawn]
            )
            if drawn == TRANSLATE:
                targets.append(texts[sample].translation or "")
            else:
                targets.append(spoken({DESCRIBE: task, REPEAT_LANGUAGE: wording}.get(drawn, "")))
        return ModeBatch(mode, prompts, targets)


def sample_rngs(seed: int, index: Tensor) -> list[np.random.Generator]:
    """Each frame's own random numbers for a step, whatever its place in the batch and its GPU.

    Args:
        seed: Differs from step to step.
        index: Of the frames in the dataset.
    """
    return [np.random.default_rng([seed, frame]) for frame in index.flatten().tolist()]


@contextmanager
def step_randomness(
    training_seed: Tensor, index: Tensor, *, enabled: bool
) -> Iterator[list[np.random.Generator] | None]:
    """Random numbers of one training step, which depend on the seed and its frames alone.

    Within it PyTorch's generator, which draws dropout, has a seed of its own; after it, nobody notices. The
    seed is that of the first sample, as the parts of a batch on several GPUs are to differ.

    Args:
        training_seed: (), int64, part of a checkpoint; counts the steps.
        index: Of the frames in the dataset, on the device that computes.
        enabled: If not, as in an evaluation, nothing of this happens.

    Yields:
        Each sample's own random numbers, or None.
    """
    if not enabled:
        yield None
        return
    training_seed += 1
    with torch.random.fork_rng([index.device] if index.device.type == "cuda" else []):
        [rng] = sample_rngs(int(training_seed), index.flatten()[:1])
        torch.manual_seed(int(rng.integers(2**63)))
        yield sample_rngs(int(training_seed), index)


def draw_modes(probabilities: Tensor, uniform: Tensor) -> Tensor:
    """Draw one mode per sample by inverting the cumulative distribution.

    Args:
        probabilities: (batch, modes), not negative, at least one above 0 in each row; need not sum to 1.
        uniform: (batch,) in [0, 1).

    Returns:
        (batch,) indices into `MODES`, int64.
    """
    cumulative = probabilities.cumsum(dim=1)
    threshold = uniform[:, None] * cumulative[:, -1:]
    return (cumulative <= threshold).sum(dim=1).clamp(max=len(MODES) - 1)


def spread(index: Tensor) -> Tensor:
    """Turn frame indices into evenly spread numbers in [0, 1): the same in each evaluation."""
    return torch.frac(index.double() * GOLDEN_RATIO)


def _draw_words(task: str, texts: EpisodeTexts, rng: np.random.Generator, renames: bool) -> tuple[str, str]:
    """Task and one of its wordings; now and then both with a pseudo-name, if it `renames`."""
    wordings = texts.wordings or (task,)
    wording = wordings[rng.integers(len(wordings))]
    if renames and rng.random() < pseudo_names.SHARE:
        name = pseudo_names.draw_name(rng)
        return pseudo_names.rename_object(task, name), pseudo_names.rename_object(wording, name)
    return task, wording
