# SPDX-License-Identifier: Apache-2.0
"""The figures that count, against values worked out by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from lerobot_owlxt5.evaluation.metrics import (
    bleu2,
    bootstrap,
    is_accepted,
    mean,
    nrmse,
    squared_errors,
    steps_until_still,
)

words = st.lists(st.sampled_from(["push", "pull", "red", "blue", "cube"]), min_size=1, max_size=6).map(
    " ".join
)


@pytest.mark.parametrize(
    ("prediction", "references", "expected"),
    [
        ("push red", ["pull red", "push red"], 1.0),
        ("red", ["red"], 1.0),  # although it has no pair of words
        ("push  red ", ["push red"], 1.0),
        ("Push red", ["push red"], 0.0),  # one word in two, no pair: no smoothing
        ("push blue", ["push red"], 0.0),
        ("", ["push red"], 0.0),
        ("a b x d", ["a b c d"], 0.5),  # sqrt(3/4 * 1/3)
        ("the red", ["the red cube here"], math.exp(1 - 4 / 2)),  # all right, but too short
        ("a b c", ["a b x", "y b c"], 1.0),  # all words and both pairs, over the two references
    ],
)
def test_bleu2(prediction: str, references: list[str], expected: float) -> None:
    assert bleu2(prediction, references) == pytest.approx(expected, abs=1e-12)


@given(words, st.lists(words, min_size=1, max_size=4))
def test_bleu2_is_a_share_and_1_for_what_is_accepted(prediction: str, references: list[str]) -> None:
    assert 0 <= bleu2(prediction, references) <= 1 + 1e-12
    assert bleu2(references[-1], references) == 1
    assert is_accepted(prediction, references) == (prediction in references)
    assert bleu2(prediction, [*references, prediction]) == 1


def test_nrmse_pools_the_true_steps_of_all_episodes() -> None:
    true = np.zeros((2, 4, 2))
    predicted = np.full((2, 4, 2), 99.0)
    predicted[0, :3], predicted[1, :1] = 2.0, 4.0  # the rest lies behind the episodes' ends
    lengths = np.array([3, 1])
    errors = squared_errors(predicted, true, lengths)
    assert errors.tolist() == [3 * 2 * 4.0, 1 * 2 * 16.0]
    # (24 + 32) / 8 values = 7, and the root of it in percent of 200 degrees
    assert nrmse(errors, lengths * 2.0, joint_range=200.0) == pytest.approx(100 * math.sqrt(7) / 200)


def test_steps_until_still() -> None:
    plans = np.array([[0, 1, 2, 2, 2], [5, 5, 5, 5, 5], [0, 1, 1, 2, 3], [1, 0, 0, 0, 0]])[..., None]
    assert steps_until_still(plans).tolist() == [3, 1, 5, 2]


def test_bootstrap_is_repeatable_and_as_wide_as_theory_says() -> None:
    tosses = np.arange(400) % 2 * 1.0
    first, again, other = (bootstrap(mean, tosses, seed=seed) for seed in (1, 1, 2))
    assert first == again != other
    assert first.value == 0.5
    assert first.low == pytest.approx(0.5 - 1.96 * 0.5 / 20, abs=0.01)
    assert first.high == pytest.approx(0.5 + 1.96 * 0.5 / 20, abs=0.01)


def test_bootstrap_of_what_does_not_vary_has_no_width() -> None:
    estimate = bootstrap(mean, np.full(3, 100.0), seed=0)
    assert (estimate.value, estimate.low, estimate.high) == (100, 100, 100)


def test_bootstrap_keeps_the_columns_of_an_episode_together() -> None:
    # Errors are four times the numbers in each episode: their ratio is the same in every resample.
    numbers = np.array([10.0, 20.0, 70.0])
    estimate = bootstrap(lambda e, n: nrmse(e, n, 100.0), 4 * numbers, numbers, seed=0)
    assert [estimate.low, estimate.value, estimate.high] == pytest.approx([2.0] * 3)
