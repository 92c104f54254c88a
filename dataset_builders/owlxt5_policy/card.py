# SPDX-License-Identifier: Apache-2.0
"""The model card of the policy that ships: its recipe, and what LeRobot's evaluation says of it."""

import json
import shlex
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from string import Template
from typing import Any

import yaml
from lerobot.configs import PreTrainedConfig

from lerobot_owlxt5.configuration_owlxt5 import OWLxT5Config
from nico_tabletop.report import Evaluation, read_evaluations
from nico_tabletop.scoring import Outcome
from nico_tabletop.tasks import ACTIONS

_RECIPE = Path("configs/small.yaml")
_REPOSITORY = Path(__file__).parents[2]
# Fields of a configuration that the policy writes itself.
_LEARNT = {"tasks", "trained_modes", "core_version"}
_NOT_EVALUATED = (
    "It was not evaluated yet: run `python -m owlxt5_policy.ship` again with eval_info.json files."
)

_CARD = Template("""\
---
license: apache-2.0
library_name: lerobot
pipeline_tag: robotics
tags:
- robotics
- lerobot
- owlxt5
---
# The trained OWLxT5 of this package

A policy that pushes, pulls and slides one of three things on a table with the arms of the simulated
humanoid NICO. Images and commands go in, joint positions come out. It needs no network: its detector and
language models are those of `lerobot_policy_owlxt5`. The command `owlxt5-policy` prints its folder. The file
has $size MB, with weights in half precision; LeRobot loads them as float32.

It was never on a real robot. It has learnt a scripted expert's movements, in simulation alone.

## Recipe

From random weights, in a checkout of the repository:

```bash
$recipe
```

## Evaluation

$evaluation
""")


def write_card(folder: Path, training: Mapping[str, Any], dataset: str, eval_infos: Sequence[Path]) -> None:
    """Write the README.md.

    Args:
        folder: Of the policy, with its weights.
        training: The train_config.json of lerobot-train.
        dataset: The command that made the dataset, without its folder.
        eval_infos: Files eval_info.json of lerobot-eval.

    Raises:
        OSError: If a file cannot be read.
        ValueError: If one is no eval_info.json of our environments.
    """
    evaluations = [each for path in eval_infos for each in read_evaluations(path)]
    card = _CARD.substitute(
        size=f"{(folder / 'model.safetensors').stat().st_size / 1e6:.1f}",
        recipe=f"{dataset} --root=outputs/clant\n\n{_command(training)}",
        evaluation=_results(evaluations) if evaluations else _NOT_EVALUATED,
    )
    (folder / "README.md").write_text(card, encoding="utf-8")


def _command(training: Mapping[str, Any]) -> str:
    """The lerobot-train that makes the same again, in folders of the reader's choice."""
    episodes = training["dataset"]["episodes"]
    chosen = []
    if episodes is not None and episodes == [*range(len(episodes))]:
        chosen = [f'--dataset.episodes="[$(seq -s, 0 {len(episodes) - 1})]"']
    elif episodes is not None:
        chosen = [shlex.quote(f"--dataset.episodes={json.dumps(episodes)}")]
    options = [
        f"--config_path={_RECIPE}",
        "--policy.type=owlxt5",
        "--dataset.root=outputs/clant",
        *chosen,
        *(shlex.quote(f"--{key}={json.dumps(value).strip(chr(34))}") for key, value in _changes(training)),
        "--output_dir=outputs/owlxt5",
    ]
    return " \\\n    ".join(["lerobot-train", *options])


def _changes(training: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """What a training had otherwise than the recipe, or than the policy's defaults where it is silent."""
    recipe = yaml.safe_load((_REPOSITORY / _RECIPE).read_text(encoding="utf-8"))
    yield "steps", training["steps"]
    for key, value in _leaves(recipe):
        *parents, name = key.split(".")
        part: Any = training
        for parent in parents:
            part = part[parent]
        if part is None:  # the policy's own presets have no scheduler
            continue
        if part[name] != value and key not in ("dataset.repo_id", "policy.device", "policy.push_to_hub"):
            yield key, part[name]
    everybodys = {field.name for field in fields(PreTrainedConfig)}
    defaults = OWLxT5Config(device="cpu")
    for field in fields(OWLxT5Config):
        name, used = field.name, training["policy"][field.name]
        own = name not in everybodys | _LEARNT and not name.endswith("_revision")
        if own and name not in recipe["policy"] and used != getattr(defaults, name):
            yield f"policy.{name}", used


def _leaves(tree: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The values of nested mappings, with their keys as options have them; probabilities stay together."""
    for key, value in tree.items():
        if isinstance(value, dict) and key != "mode_probabilities":
            yield from _leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", value


def _results(evaluations: Sequence[Evaluation]) -> str:
    """What was evaluated, by which commands, and with which results."""
    rows = [
        "| pretrained model | objects | episodes | perfect | successful | failure | success |",
        "|---|---|---|---|---|---|---|",
    ]
    for evaluation in evaluations:
        count = Counter(trial.outcome for trial in evaluation.trials)
        cells = " | ".join(str(count[outcome]) for outcome in Outcome)
        success = f"{1 - count[Outcome.FAILURE] / count.total():.0%}"
        rows.append(f"| `owlxt5-policy` | {evaluation.objects} | {count.total()} | {cells} | {success} |")
    commands = "\n\n".join(_eval_command(evaluation) for evaluation in evaluations)
    by_action = [
        f"| action | {' | '.join(evaluation.objects for evaluation in evaluations)} |",
        "|---" * (len(evaluations) + 1) + "|",
        *(
            f"| {action.name} | {' | '.join(_successes(each, action.name) for each in evaluations)} |"
            for action in ACTIONS
        ),
    ]
    return "\n".join(
        [
            f"```bash\n{commands}\n```",
            "",
            *rows,
            "",
            "Successes of the episodes of each action:",
            "",
            *by_action,
            "",
            "The results are those of the evaluations that `python -m owlxt5_policy.ship` was given.",
            "`docs/world.md` of the repository says what counts as perfect and as successful.",
        ]
    )


def _successes(evaluation: Evaluation, action: str) -> str:
    outcomes = [trial.outcome for trial in evaluation.trials if trial.action == action]
    successes = sum(outcome is not Outcome.FAILURE for outcome in outcomes)
    return f"{successes} of {len(outcomes)}" if outcomes else "none"


def _eval_command(evaluation: Evaluation) -> str:
    """The lerobot-eval of an evaluation; LeRobot runs the same number of episodes of each action."""
    objects = evaluation.objects
    kind = [f"--env.type={objects}"]
    if objects not in ("clant", "claeo"):
        kind = ["--env.type=claeo", shlex.quote(f"--env.objects={objects}")]
    episodes = max(Counter(trial.action for trial in evaluation.trials).values())
    options = [
        *kind,
        f"--eval.n_episodes={episodes}",
        "--eval.batch_size=1",
        f"--output_dir=outputs/eval_{objects}",
        f"--env.output_dir=outputs/eval_{objects}",
    ]
    return " \\\n    ".join(['lerobot-eval --policy.path="$(owlxt5-policy)"', *options])
