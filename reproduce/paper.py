# SPDX-License-Identifier: Apache-2.0
"""The figures that the paper publishes (OWLxT5, ESANN 2025), by policy, objects and mode.

Its figure 3 is a picture without numbers, so there is none of outcomes here.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Line:
    """A line of our table beside the paper's.

    Attributes:
        mode: As `owlxt5-evaluate` calls it.
        variant: The same.
        figure: Key of its figure.
        objects: `clant` or `claeo`.
        title: For readers.
        published: The paper's figure in percent, by policy.
        where: Where in the paper it stands; empty: nowhere.
    """

    mode: str
    variant: str
    figure: str
    objects: str
    title: str
    published: dict[str, float]
    where: str


AS_TRAINED = "dataset"
"""The words of the dataset: the variant of `owlxt5-evaluate` that the paper has."""
_TABLE, _TEXT = "table 1", "section 4"

LINES = (
    Line(
        "translate",
        "vs. T5 alone",
        "bleu2",
        "clant",
        "translate, BLEU-2 against T5 alone",
        {"crosst5": 86.75, "owlxt5": 91.68},
        _TABLE,
    ),
    Line(
        "translate",
        "vs. dataset",
        "bleu2",
        "clant",
        "translate, BLEU-2 against the dataset",
        {"owlxt5": 40.42},
        _TEXT,
    ),
    Line(
        "T5 alone",
        "vs. dataset",
        "bleu2",
        "clant",
        "T5 alone, BLEU-2 against the dataset",
        {"owlxt5": 42.12},
        _TEXT,
    ),
    Line(
        "describe",
        AS_TRAINED,
        "bleu2",
        "clant",
        "describe, BLEU-2",
        {"crosst5": 100.0, "owlxt5": 100.0},
        _TABLE,
    ),
    Line(
        "describe",
        AS_TRAINED,
        "bleu2",
        "claeo",
        "describe, BLEU-2",
        {"crosst5": 0.0, "owlxt5": 100.0},
        _TABLE,
    ),
    Line(
        "repeat action",
        AS_TRAINED,
        "nrmse",
        "clant",
        "repeat action, NRMSE",
        {"crosst5": 0.25, "owlxt5": 0.37},
        _TEXT,
    ),
    Line(
        "repeat action",
        AS_TRAINED,
        "nrmse",
        "claeo",
        "repeat action, NRMSE",
        {"crosst5": 6.88, "owlxt5": 0.63},
        _TEXT,
    ),
    Line("execute", AS_TRAINED, "nrmse", "clant", "execute, NRMSE", {}, ""),
    Line("execute", AS_TRAINED, "nrmse", "claeo", "execute, NRMSE", {}, ""),
)
