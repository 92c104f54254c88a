# SPDX-License-Identifier: Apache-2.0
"""The results as pictures, if matplotlib is there."""

from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from nico_tabletop.scoring import Outcome

from .results import Share

_COLOURS = {Outcome.PERFECT: "#3b7d3b", Outcome.SUCCESSFUL: "#a9cf8f", Outcome.FAILURE: "#c9c9c9"}
_MARKERS = "osD^vPX*"


def draw_outcomes(bars: Mapping[str, Counter[str]], path: Path) -> None:
    """The paper's figure 3: a stacked bar of the outcomes, in percent, for each policy and set of objects.

    Args:
        bars: Outcomes by title of the bar.
        path: PNG file to write.
    """
    figure = Figure(figsize=(1.6 + 1.3 * len(bars), 4), layout="constrained")
    axes = figure.subplots()
    below = np.zeros(len(bars))
    for outcome in Outcome:
        heights = [100 * counts[outcome] / sum(counts[each] for each in Outcome) for counts in bars.values()]
        drawn = axes.bar([*bars], heights, bottom=below, color=_COLOURS[outcome], label=outcome, width=0.6)
        axes.bar_label(drawn, [f"{each:.0f}" if each >= 4 else "" for each in heights], label_type="center")
        below += heights
    axes.set(ylabel="episodes, %", ylim=(0, 100))
    figure.legend(loc="outside upper center", ncols=len(Outcome), frameon=False)
    figure.savefig(path, dpi=110)


def draw_efficiency(
    curves: Mapping[str, Mapping[str, Mapping[int, Share]]],
    lines: Mapping[str, Mapping[str, Share]],
    path: Path,
) -> None:
    """Success against the number of demonstrations, a panel for each set of objects.

    Args:
        curves: By objects, by policy, by number of demonstrations.
        lines: By objects, by policy: those that learn from no demonstration.
        path: PNG file to write.
    """
    figure = Figure(figsize=(5 * len(curves), 3.6), layout="constrained")
    panels = figure.subplots(1, len(curves), sharey=True, squeeze=False)[0]
    for panel, (objects, policies) in zip(panels, curves.items(), strict=True):
        for (policy, shares), marker in zip(policies.items(), _MARKERS, strict=False):
            ends = np.array([share.interval for share in shares.values()]).T
            values = np.array([share.percent for share in shares.values()])
            around = np.abs(ends - values)
            panel.errorbar([*shares], values, around, marker=marker, capsize=3, label=policy)
        for policy, share in lines.get(objects, {}).items():
            panel.axhline(share.percent, color="black", linestyle="--", linewidth=1, label=policy)
            panel.axhspan(*share.interval, color="black", alpha=0.06)
        numbers = sorted({number for shares in policies.values() for number in shares})
        panel.set(title=objects, xlabel="demonstrations", xscale="log", ylim=(-3, 103))
        panel.set_xticks(numbers, [str(number) for number in numbers])
        panel.minorticks_off()
        panel.grid(alpha=0.3)
        panel.legend()
    panels[0].set_ylabel("perfect or successful, %")
    figure.savefig(path, dpi=110)


def draw_cells(table: Mapping[str, Mapping[str, Share]], path: Path) -> None:
    """How often a policy moves rightly in each situation, as a heat map.

    Args:
        table: Shares by policy, by cell.
        path: PNG file to write.
    """
    cells = [*dict.fromkeys(cell for row in table.values() for cell in row)]
    percent = np.array(
        [[row[cell].percent if cell in row else np.nan for row in table.values()] for cell in cells]
    )
    figure = Figure(figsize=(2.4 + 1.5 * len(table), 1 + 0.3 * len(cells)), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(percent, cmap="RdYlGn", vmin=0, vmax=100, aspect="auto")
    axes.set_xticks(range(len(table)), [*table])
    axes.set_yticks(range(len(cells)), cells)
    for (row, column), value in np.ndenumerate(percent):
        if not np.isnan(value):
            axes.text(column, row, f"{value:.0f}", ha="center", va="center")
    figure.colorbar(image, label="moved rightly, %")
    figure.savefig(path, dpi=110)
