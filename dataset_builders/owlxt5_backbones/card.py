# SPDX-License-Identifier: Apache-2.0
"""The card beside trained weights: what they are, how to make them again, and how they were evaluated."""

import re
from pathlib import Path
from string import Template

from .catalogue import CATEGORIES, HELD_OUT
from .evaluate_detector import evaluate_detector, read_objects
from .evaluate_language_model import evaluate_language_model

_SCENES, _EXAMPLES = 60, 400

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

Evaluation:

$table
""")
_DETECTOR = """A small OWLv2 (`Owlv2ForObjectDetection`) for `--policy.detector=embedded`."""
_T5 = """A small T5 (`T5ForConditionalGeneration`) for `--policy.{}=embedded`."""
_NOTES = {
    "language_model": "Three in ten names are invented, those of the last kinds all.",
    "understanding": "In the policies it can give nothing but a formal answer.",
}


def commands(folder: Path) -> str:
    """What a model's card says of how it was made, a line each; nothing if it has no card of ours."""
    card = folder / "README.md"
    text = card.read_text(encoding="utf-8") if card.is_file() else ""
    found = re.search(r"```bash\n(owlxt5-backbones .*?\n)```", text, re.DOTALL)
    return found[1] if found else ""


def write_detector_card(folder: Path, seed: int, **facts: object) -> str:
    """Evaluate a detector and write the card into its folder.

    Args:
        folder: Of the detector.
        seed: Of the scenes.
        **facts: `command` and `size` for the card.

    Returns:
        The table of results.
    """
    household = [item.name for item in read_objects("household")]
    suites = (
        ("claeo, on the slots", "claeo", "slots", None),
        ("claeo, placed freely", "claeo", "free", None),
        ("clant, on the slots", "clant", "slots", None),
        ("household, known categories", "household", "free", [n for n in household if n not in HELD_OUT]),
        ("household, held-out categories", "household", "free", [*HELD_OUT]),
    )
    rows = [
        "| objects | present | recall, centre within 2 cm | absent | true negative rate |",
        "|---|---|---|---|---|",
    ]
    for title, suite, placement, among in suites:
        metrics = evaluate_detector(str(folder), suite, placement, _SCENES, among=among, seed=seed)
        rates = f"{metrics.recall:.1%} | {metrics.absent} | {metrics.true_negative_rate:.1%}"
        rows.append(f"| {title} | {metrics.present} | {rates} |")
    table = "\n".join(
        [
            *rows,
            "",
            f"{_SCENES} scenes a row, images of 320 x 240. Each scene has three objects of a set, and the",
            "detector is asked for all of the set, by name and by synonym. It was trained on other instances",
            f"of {len(CATEGORIES)} categories, cubes among them. The objects of the sets are none of these,",
            f"and the held-out categories are in no training image: {', '.join(HELD_OUT)}.",
        ]
    )
    return _write(folder, table, name="detector", what=_DETECTOR, **facts)


def write_language_model_card(
    folder: Path, part: str, seed: int, trained: int, *, went_on: bool = False, **facts: object
) -> str:
    """Evaluate a T5 and write the card into its folder.

    Args:
        folder: Of the T5.
        part: `language_model` or `understanding`.
        seed: Of its training.
        trained: How many examples the command trained it on.
        went_on: Whether the command went on with another model, whose examples are not known here.
        **facts: `command` and `size` for the card.

    Returns:
        The table of results.
    """
    results = evaluate_language_model(str(folder), _EXAMPLES, part, trained=trained, training_seed=seed)
    training = "the last command's training" if went_on else "training"
    table = "\n".join(
        [
            "| examples | exact match |",
            "|---|---|",
            *(f"| {metrics.kind} | {metrics.exact_match:.1%} |" for metrics in results),
            "",
            f"{_EXAMPLES} examples of each kind, none of which was in {training}.",
            _NOTES[part],
        ]
    )
    return _write(folder, table, name=part.replace("_", " "), what=_T5.format(part), **facts)


def _write(folder: Path, table: str, **facts: object) -> str:
    (folder / "README.md").write_text(_CARD.substitute(table=table, **facts), encoding="utf-8")
    return table
