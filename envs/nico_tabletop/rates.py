# SPDX-License-Identifier: Apache-2.0
"""Rates of the protocol CLAEO-Plus with Wilson's intervals, and two policies compared by a paired test."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import NormalDist

from rich.table import Table

from .record import Episode
from .words import ABSENT

_Z = NormalDist().inv_cdf(0.975)


class PairingError(ValueError):
    """Two records are not of the same episodes."""


def wilson(count: int, total: int) -> tuple[float, float]:
    """Wilson's 95 % interval of a rate (Wilson, JASA 1927), between 0 and 1; of nothing it is 0 to 1."""
    if not total:
        return 0.0, 1.0
    rate, square = count / total, _Z**2 / total
    middle = (rate + square / 2) / (1 + square)
    half = _Z / (1 + square) * math.sqrt(rate * (1 - rate) / total + square / (4 * total))
    return max(0.0, middle - half), min(1.0, middle + half)


def mcnemar(only_first: int, only_second: int) -> float:
    """McNemar's exact test, two-sided: how likely pairs that differ are split at least so unevenly by chance.

    Args:
        only_first: Pairs of which only the first is right.
        only_second: Pairs of which only the second is right.

    Returns:
        The p-value: twice the binomial sum of the smaller share at one half, at most 1.
    """
    total, least = only_first + only_second, min(only_first, only_second)
    return min(1.0, 2 * sum(math.comb(total, count) for count in range(least + 1)) / 2**total)


def rate(hits: Iterable[bool]) -> str:
    """A rate in percent, its interval and n; a dash where there is nothing to count."""
    counted = [*hits]
    if not counted:
        return "-"
    low, high = wilson(sum(counted), len(counted))
    return f"{sum(counted) / len(counted):.1%} ({100 * low:.1f} to {100 * high:.1f}), n {len(counted)}"


def _cells(episodes: Iterable[Episode]) -> dict[str, list[Episode]]:
    """Episodes by what they have in common: set of objects, number of distractors, kind of words."""
    cells: dict[str, list[Episode]] = {}
    for episode in episodes:
        further = f" + {len(episode.distractors)}" if episode.distractors else ""
        cells.setdefault(f"{episode.objects}{further}, {episode.words}", []).append(episode)
    return cells


def rates_table(records: Sequence[tuple[str, Sequence[Episode]]]) -> Table:
    """The protocol's rates, a row for each file and kind of words; records are (name, episodes)."""
    table = Table(title="Rates, with Wilson's 95 % intervals and n")
    headings = ("file", "cell", "moved rightly", "some object moved", "refused rightly", "refused wrongly")
    for heading in headings:
        table.add_column(heading, overflow="fold")
    for name, episodes in records:
        for cell, found in _cells(episodes).items():
            present = [episode for episode in found if episode.words != ABSENT]
            absent = [episode for episode in found if episode.words == ABSENT]
            table.add_row(
                name,
                cell,
                rate(episode.moved_rightly for episode in present),
                rate(episode.some_object_moved for episode in found),
                rate(episode.refused for episode in absent),
                rate(episode.refused for episode in present),
            )
    return table


@dataclass(frozen=True)
class Pairs:
    """Two policies in the same episodes: how often both, one or none of them was right.

    Attributes:
        both: Both were right.
        only_first: Only the first was.
        only_second: Only the second was.
        neither: None was.
    """

    both: int
    only_first: int
    only_second: int
    neither: int

    @property
    def total(self) -> int:
        """All pairs."""
        return self.both + self.only_first + self.only_second + self.neither


def pair(first: Sequence[Episode], second: Sequence[Episode]) -> Pairs:
    """Pair episodes of the same seed and action.

    Raises:
        PairingError: If an episode has no seed or stands twice, none has a partner, or partners do not begin
            alike.
    """
    one, other = _by_seed(first), _by_seed(second)
    shared = [key for key in one if key in other]
    if not shared:
        raise PairingError("no episode of one file has the seed and the action of one of the other")
    for seed, action in shared:
        differing = [
            name
            for name in ("objects", "words", "task", "arrangement", "poses", "conditions", "distractors")
            if getattr(one[seed, action], name) != getattr(other[seed, action], name)
        ]
        if differing:
            raise PairingError(
                f"seed {seed} of {action} has other {' and '.join(differing)} in the two files: compare runs "
                "with the same --env options"
            )
    right = [(one[key].right, other[key].right) for key in shared]
    return Pairs(
        *(right.count(each) for each in ((True, True), (True, False), (False, True), (False, False)))
    )


def _by_seed(episodes: Iterable[Episode]) -> dict[tuple[int, str], Episode]:
    found: dict[tuple[int, str], Episode] = {}
    for episode in episodes:
        if episode.seed is None:
            raise PairingError(f"an episode of {episode.action} has no seed, so that it has no partner")
        if (key := (episode.seed, episode.action)) in found:
            raise PairingError(f"seed {episode.seed} of {episode.action} stands twice in one file")
        found[key] = episode
    return found


def comparison_table(names: tuple[str, str], first: Sequence[Episode], second: Sequence[Episode]) -> Table:
    """What became of the pairs of two files, with McNemar's exact test.

    Raises:
        PairingError: See `pair`.
    """
    pairs = pair(first, second)
    table = Table(title="Paired by seed and action; right: moved rightly, or refused what is absent")
    for heading in ("file", "right", "only this one right"):
        table.add_column(heading, overflow="fold")
    for name, only in zip(names, (pairs.only_first, pairs.only_second), strict=True):
        right = [True] * (pairs.both + only) + [False] * (pairs.total - pairs.both - only)
        table.add_row(name, rate(right), str(only))
    left_out = len(first) + len(second) - 2 * pairs.total
    table.caption = (
        f"{pairs.total} pairs: both right {pairs.both}, neither {pairs.neither}; McNemar's exact test: "
        f"p = {mcnemar(pairs.only_first, pairs.only_second):.3g}"
        + (f". Without a partner: {left_out} episodes" if left_out else "")
    )
    return table
