# SPDX-License-Identifier: Apache-2.0
"""The card beside trained weights: what they are, how to make them again, and how they did in their exam."""

from pathlib import Path
from string import Template

from . import exam_eyes, exam_tongue
from .catalogue import CATEGORIES, HELD_OUT

_SCENES, _LESSONS = 60, 400

_CARD = Template("""\
---
license: apache-2.0
library_name: transformers
---
# The small $name of OWLxT5

$what It has $size parameters, stored in half precision,
and was trained from random weights on nothing but data that `lerobot_policy_owlxt5` makes:

```bash
$command
```

The exam afterwards:

$table
""")
_EYES = """A small OWLv2 (`Owlv2ForObjectDetection`) for the embedded detector."""
_TONGUE = """A small T5 (`T5ForConditionalGeneration`) for the embedded language model."""


def commands(folder: Path) -> str:
    """What a model's card says of how it was made."""
    return (folder / "README.md").read_text(encoding="utf-8").split("```bash\n")[1].split("\n```")[0]


def write_eyes_card(folder: Path, seed: int, **facts: object) -> str:
    """Examine eyes and write the card into their folder.

    Args:
        folder: Of the eyes.
        seed: Of the exam's scenes.
        **facts: `command` and `size` for the card.

    Returns:
        The table of results.
    """
    household = [item.name for item in exam_eyes.read_objects("household")]
    suites = (
        ("claeo, on the slots", "claeo", "slots", None),
        ("claeo, placed freely", "claeo", "free", None),
        ("clant, on the slots", "clant", "slots", None),
        ("household, known categories", "household", "free", [n for n in household if n not in HELD_OUT]),
        ("household, held-out categories", "household", "free", [*HELD_OUT]),
    )
    rows = [
        "| objects | asked for, there | centre within 2 cm | asked for, absent | rejected |",
        "|---|---|---|---|---|",
    ]
    for title, suite, placement, among in suites:
        grade = exam_eyes.examine(str(folder), suite, placement, _SCENES, among=among, seed=seed)
        rows.append(
            f"| {title} | {grade.named} | {grade.found:.1%} | {grade.absent} | {grade.rejected:.1%} |"
        )
    table = "\n".join(
        [
            *rows,
            "",
            f"{_SCENES} scenes a row, pictures of 320 x 240. Each scene has three objects of a set and is",
            "asked for all of them, by name and by synonym. The eyes were trained on other instances of",
            f"{len(CATEGORIES)} categories, cubes among them; no object of the sets is one of them,",
            f"and the held-out categories are in no picture of their training: {', '.join(HELD_OUT)}.",
        ]
    )
    return _write(folder, table, name="eyes", what=_EYES, **facts)


def write_tongue_card(folder: Path, seed: int, trained: int, **facts: object) -> str:
    """Examine a tongue and write the card into its folder.

    Args:
        folder: Of the tongue.
        seed: Of its training.
        trained: How many lessons it was trained on.
        **facts: `command` and `size` for the card.

    Returns:
        The table of results.
    """
    grades = exam_tongue.examine(str(folder), _LESSONS, trained=trained, training_seed=seed)
    table = "\n".join(
        [
            "| lesson | answers without a mistake |",
            "|---|---|",
            *(f"| {grade.kind} | {grade.right:.1%} |" for grade in grades),
            "",
            f"{_LESSONS} lessons each, none of which was in training. In the first kinds three in ten names",
            "are made up; made-up names are one to three words of random letters.",
        ]
    )
    return _write(folder, table, name="tongue", what=_TONGUE, **facts)


def _write(folder: Path, table: str, **facts: object) -> str:
    (folder / "README.md").write_text(_CARD.substitute(table=table, **facts), encoding="utf-8")
    return table
