# SPDX-License-Identifier: Apache-2.0
"""What is run: `plan.yaml`, whose templates become steps of one size."""

import hashlib
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import yaml

ROOT = Path(__file__).parents[1]
"""The repository's root, in which all commands are run."""
PLAN = Path(__file__).with_name("plan.yaml")
OUTPUTS = Path("outputs/reproduce")
_SETTING = "setting.json"
_IMPORTED = {"benchmarks/robustness.py": ("benchmarks/cells.py", "benchmarks/rollout.py")}
"""What the benchmarks of the plan import of their folder, as far as figures depend on it."""
RELEASE = "OWLXT5_CLANT_DIR"
"""The variable of the environment with the release's folder."""


@dataclass(frozen=True)
class Setting:
    """What a plan depends on beside its file: where it is run.

    Attributes:
        source: `--source` of the datasets: `scripted`, or the environment variable with the release's folder.
        device: For the commands of a size that names none.
    """

    source: str = "scripted"
    device: str = "cpu"


@dataclass(frozen=True)
class Step:
    """A command that writes into a folder of its own.

    Attributes:
        name: Of the step and of its folder.
        template: Name in the plan's file; steps of one template take about as long.
        command: A line for bash.
        output: Its folder, relative to the repository's root.
        inputs: Names of the steps whose folders it reads.
        seconds: How long it is expected to take.
        digest: Hash of the command, of the recipes and benchmarks that it names, and of its inputs' digests.
        chosen: What tells it from the other steps of its template, such as {"seed": 1}.
        measures: `outcomes`, `modes` or `cells`; empty: it makes what others measure.
        policy: What is measured.
        variant: What is changed in an ablation; empty: nothing.
    """

    name: str
    template: str
    command: str
    output: Path
    inputs: tuple[str, ...]
    seconds: float
    digest: str
    chosen: Mapping[str, Any]
    measures: str = ""
    policy: str = ""
    variant: str = ""


@dataclass(frozen=True)
class Plan:
    """All steps of a size.

    Attributes:
        size: `quick`, `full` or another size of the plan's file.
        about: What a reader of the results must know of this size.
        folder: Into which everything is written, relative to the repository's root.
        environment: Variables of the environment for all commands.
        setting: Where it is run, as far as the size does not say so itself.
        steps: In the order in which they are run.
    """

    size: str
    about: str
    folder: Path
    environment: Mapping[str, str]
    setting: Setting
    steps: tuple[Step, ...]

    def readers(self, step: Step) -> list[Step]:
        """A step and all that read from it, or from what reads from it."""
        found = {step.name: step}
        for each in self.steps:
            if {*each.inputs} & {*found}:
                found[each.name] = each
        return [*found.values()]


def read_sizes(path: Path = PLAN) -> list[str]:
    """Names of the plan's sizes."""
    return [*yaml.safe_load(path.read_text(encoding="utf-8"))["sizes"]]


def read_plan(
    size: str,
    path: Path = PLAN,
    *,
    setting: Setting | None = None,
    outputs: Path = OUTPUTS,
) -> Plan:
    """The steps of a size.

    Args:
        size: One of the plan's sizes.
        path: File of the plan.
        setting: `{source}` and `{device}` of the commands; None: those of the last run of this size.
        outputs: Folder for the sizes' folders, relative to the repository's root.

    Raises:
        ValueError: If there is no such size, or a step names a list, a word or a step that is not there.
    """
    content = yaml.safe_load(path.read_text(encoding="utf-8"))
    if size not in content["sizes"]:
        raise ValueError(f"{path.name} has no size {size!r}; choose one of {', '.join(content['sizes'])}")
    chosen = content["sizes"][size]
    folder = outputs / size
    words = asdict(setting or read_setting(folder)) | {"folder": folder} | chosen.get("values", {})
    steps = dict[str, Step]()
    for template in content["steps"]:
        for combination in _combinations(template, chosen.get("lists", {})):
            step = _make_step(template, words | combination, combination, steps, folder)
            if step.name in steps:
                raise ValueError(f"two steps of the plan are called {step.name!r}")
            steps[step.name] = step
    environment, used = chosen.get("environment", {}), Setting(words["source"], words["device"])
    return Plan(size, chosen["about"], folder, environment, used, tuple(steps.values()))


def write_setting(plan: Plan) -> None:
    """Note where a plan is run, so that its results are read as those of the same commands."""
    path = ROOT / plan.folder / _SETTING
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(plan.setting)) + "\n", encoding="utf-8")


def read_setting(folder: Path) -> Setting:
    """Where the plan of a folder was run last."""
    path = ROOT / folder / _SETTING
    return Setting(**json.loads(path.read_text(encoding="utf-8"))) if path.exists() else Setting()


def _combinations(template: Mapping[str, Any], lists: Mapping[str, list[Any]]) -> Iterator[dict[str, Any]]:
    """What the words of the lists' items stand for, for each combination of items."""
    axes = template.get("for", [])
    if unknown := [axis for axis in axes if axis not in lists]:
        raise ValueError(f"the step {template['name']!r} names the list {unknown[0]!r}, which its size lacks")
    for items in product(*(lists[axis] for axis in axes)):
        words = dict[str, Any]()
        for axis, item in zip(axes, items, strict=True):
            words |= item if isinstance(item, dict) else {axis: item}
        yield words


def _make_step(
    template: Mapping[str, Any],
    words: dict[str, Any],
    chosen: Mapping[str, Any],
    earlier: Mapping[str, Step],
    folder: Path,
) -> Step:
    try:
        name = template["name"].format_map(words)
        output = folder / name
        command = template["command"].format_map(words | {"output": output})
        start, each, units = template.get("seconds", [1, 0, 0])
        variant = template.get("variant", "").format_map(words)
        seconds = float(start) + float(each) * float(str(units).format_map(words))
    except KeyError as error:
        raise ValueError(f"the step {template['name']!r} of the plan has no {error}") from None
    read = re.findall(rf"{re.escape(str(folder))}/([\w.-]+)", command)
    inputs = tuple(dict.fromkeys(each for each in read if each != name))
    if unknown := [each for each in inputs if each not in earlier]:
        raise ValueError(f"the step {name!r} reads what no earlier step of the plan writes: {unknown[0]}")
    hashed = [command, *_read_files(command), *(earlier[each].digest for each in inputs)]
    digest = hashlib.sha256("\n".join(hashed).encode())
    return Step(
        name,
        template["name"],
        command,
        output,
        inputs,
        seconds,
        digest.hexdigest(),
        chosen,
        template.get("measures", ""),
        template.get("policy", ""),
        variant,
    )


def _read_files(command: str) -> list[str]:
    """What stands in the recipes and benchmarks that a command names, and in what these import."""
    named = re.findall(r"(?<![\w./-])(?:configs|benchmarks)/[\w.-]+", command)
    files = [file for each in named for file in (each, *_IMPORTED.get(each, ()))]
    return [(ROOT / file).read_text(encoding="utf-8") for file in files]
