# SPDX-License-Identifier: Apache-2.0
"""What is noted of each step: whether it is whole, and what it was made with."""

import json
import os
import platform
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from builder_tools.workers import usable_cores

from .plan import ROOT, Plan, Step

PACKAGES = ("lerobot", "torch", "transformers", "mujoco", "lerobot_policy_owlxt5")


@dataclass(frozen=True)
class Record:
    """How a step was run.

    Attributes:
        digest: The step's when it began; another one means that the plan has changed since.
        whole: Whether the step came to its end.
        seconds: How long it took, all tries together.
        command: As in the plan.
        versions: Of the packages that matter.
        machine: Processor, cores, memory, system; a GPU where it was used.
    """

    digest: str
    whole: bool
    seconds: float
    command: str
    versions: Mapping[str, str]
    machine: str


def _folder(plan: Plan) -> Path:
    return ROOT / plan.folder / "records"


def _path(plan: Plan, step: Step) -> Path:
    return _folder(plan) / f"{step.name}.json"


def read_record(plan: Plan, step: Step) -> Record | None:
    """What was noted of a step with the same command and the same inputs; None if it never began."""
    try:
        record = Record(**json.loads(_path(plan, step).read_text(encoding="utf-8")))
    except FileNotFoundError:
        return None
    return record if record.digest == step.digest else None


def write_record(plan: Plan, step: Step, seconds: float, *, whole: bool) -> None:
    """Note how far a step has come; a crash leaves the old note or the new one."""
    on_gpu = "--policy.device=cuda" in step.command
    record = Record(step.digest, whole, round(seconds, 1), step.command, versions(), machine(gpu=on_gpu))
    path = _path(plan, step)
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_suffix(".unfinished")
    unfinished.write_text(json.dumps(asdict(record), indent=2) + "\n", encoding="utf-8")
    unfinished.replace(path)


def drop_record(plan: Plan, step: Step) -> None:
    """Forget that a step was run."""
    _path(plan, step).unlink(missing_ok=True)


def is_whole(plan: Plan, step: Step) -> bool:
    """Whether a step has been run to its end, with the command that it has now."""
    record = read_record(plan, step)
    return record is not None and record.whole and (ROOT / step.output).exists()


def any_whole(plan: Plan) -> bool:
    """Whether any step of a size was run to its end, with whatever command."""
    return any(json.loads(path.read_text(encoding="utf-8"))["whole"] for path in _folder(plan).glob("*.json"))


def versions() -> dict[str, str]:
    """Versions of the packages that figures depend on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found


def machine(*, gpu: bool = False) -> str:
    """Processor, usable cores, memory, system, and the `gpu` if it was used; not the machine's name."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    parts = [_processor(), f"{usable_cores()} cores", f"{memory:.0f} GiB", platform.system()]
    if gpu:
        import torch  # takes seconds, and is needed nowhere else

        parts.append(torch.cuda.get_device_name())
    return ", ".join(parts)


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
