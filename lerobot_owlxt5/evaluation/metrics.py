# SPDX-License-Identifier: Apache-2.0
"""The figures that count: BLEU-2, sentence accuracy, NRMSE, and their bootstrap intervals."""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from nltk.translate.bleu_score import sentence_bleu
from numpy.typing import NDArray

RESAMPLES = 1000
CONFIDENCE = 0.95

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Estimate:
    """A figure over all episodes, with its bootstrap interval.

    Attributes:
        value: The figure.
        low: Lower end of the 95 % interval.
        high: Upper end of the 95 % interval.
    """

    value: float
    low: float
    high: float


def is_accepted(prediction: str, references: Sequence[str]) -> bool:
    """Whether a text equals one of the accepted ones, but for the space between its words."""
    return prediction.split() in [reference.split() for reference in references]


def bleu2(prediction: str, references: Sequence[str]) -> float:
    """Sentence BLEU with the weights (1/2, 1/2), in [0, 1]; 1 for a text that equals an accepted one.

    Tokens are what stands between spaces, in their case. There is no smoothing (our decision): a text that
    shares no pair of words with any reference scores 0, as in the paper, where a wrong object is 0.00 %.

    Args:
        prediction: The text to judge.
        references: Accepted texts, at least one.
    """
    if is_accepted(prediction, references):
        return 1.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # NLTK advises smoothing each time
        return float(
            sentence_bleu(
                [reference.split() for reference in references], prediction.split(), weights=(0.5, 0.5)
            )
        )


def squared_errors(predicted: Array, true: Array, lengths: NDArray[np.int64]) -> Array:
    """Sum of squared errors over the true steps and all joints of each episode, (batch,).

    Of a plan of L steps the first n count, n being the steps of the episode (our decision).

    Args:
        predicted: (batch, L, joints).
        true: (batch, L, joints), in the same unit.
        lengths: (batch,) steps n of each episode, at most L.
    """
    steps = np.arange(true.shape[1])
    error = np.square(predicted - true).sum(axis=2)
    return (error * (steps < lengths[:, None])).sum(axis=1)


def nrmse(squared_error: Array, numbers: Array, joint_range: float) -> Array:
    """Root mean squared error in percent of the range of the joints, pooled over the episodes.

        100 * sqrt(sum of squared errors / number of joint values) / (max - min)

    Args:
        squared_error: (..., episodes) sums of squared errors.
        numbers: (..., episodes) how many joint values each sum is made of.
        joint_range: max - min of all joints over the whole dataset, in the unit of the errors.

    Returns:
        (...).
    """
    return 100 * np.sqrt(squared_error.sum(axis=-1) / numbers.sum(axis=-1)) / joint_range


def steps_until_still(actions: Array) -> NDArray[np.int64]:
    """Steps of a plan until its last pose is reached and held, (batch,), at least 1.

    Args:
        actions: (batch, L, joints); the action at which the stop output fires is repeated to the end.
    """
    changes = (actions[:, 1:] != actions[:, :-1]).any(axis=2)
    return (changes * np.arange(2, actions.shape[1] + 1)).max(axis=1, initial=1)


def mean(values: Array) -> Array:
    """Mean over the episodes, (..., episodes) to (...)."""
    return values.mean(axis=-1)


def bootstrap(statistic: Callable[..., Array], *columns: Array, seed: int) -> Estimate:
    """A statistic of the episodes, with the percentile bootstrap's 95 % interval.

    Args:
        statistic: Reduces the last axis of its arguments, (..., episodes) to (...).
        *columns: What is known of each episode, (episodes,) each and at least one episode.
        seed: Seed of the resampling; with the same seed, all figures of a run see the same resamples.
    """
    n = len(columns[0])
    drawn = np.random.default_rng(seed).integers(n, size=(RESAMPLES, n))
    tails = (1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2
    low, high = np.quantile(statistic(*(column[drawn] for column in columns)), tails)
    return Estimate(float(statistic(*columns)), float(low), float(high))
