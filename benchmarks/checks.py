# SPDX-License-Identifier: Apache-2.0
"""Runs four checkers from PyPI and LeRobot's viewer on datasets that `owlxt5-dataset` has made.

    python benchmarks/checks.py --dataset_roots='[data/clant, data/claeo]'

Needs `uv`, whose `uvx` fetches each checker into an environment of its own (lerobot-lint's holds a second
PyTorch). Prints what they find, by rule. Exit status 1 if docs/datasets.md does not explain one of them.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from lerobot_owlxt5.command_line import command

Finding = tuple[str, str]  # severity, rule

# Each is explained in docs/datasets.md, "Checked by others' tools".
EXPLAINED = {
    "lerobot-doctor": {
        "Action Quality",
        "Anomaly Detection",
        "Data Distribution",
        "Episode Health",
        "Per-Episode Summary",
    },
    "lerobot-lint": {"ACTION_STATE_DIVERGENCE", "DEAD_JOINT", "DISCONTINUITY", "SATURATED_JOINT"},
    "kalanos": {"integrity.flatline_pct", "integrity.spike_pct"},
    "deepen-grade": {
        "cross.condition_coverage",
        "cross.duplicates",
        "episode_quality.idle_stall",
        "episode_quality.joint_limit_saturation",
    },
}
REQUIREMENTS = {
    "lerobot-doctor": ("lerobot-doctor==0.2.0",),
    # Earlier versions of LeRobot know no language columns.
    "lerobot-lint": ("lerobot-lint==0.1.1", "lerobot[dataset]==0.6.1"),
    "kalanos": ("kalanos==0.8.2",),
    "deepen-grade": ("deepen-grade[lerobot]==0.4.1",),
    "viewer": ("lerobot[dataset,viz]==0.6.1",),
}


@dataclass
class ChecksConfig:
    """What to check.

    Args:
        dataset_roots: Folders of LeRobotDatasets.
    """

    dataset_roots: list[Path]


def uvx(tool: str) -> list[str]:
    """The beginning of a command in the tool's own environment."""
    first, *others = REQUIREMENTS[tool]
    return ["uvx", f"--python={sys.executable}", f"--from={first}", *(f"--with={other}" for other in others)]


def checker(tool: str, *command: str | Path, statuses: tuple[int, ...] = (0,)) -> str:
    """Standard output of a checker that ends with one of the statuses."""
    done = subprocess.run([*uvx(tool), *command], capture_output=True, text=True, check=False)
    if done.returncode not in statuses:
        sys.exit(f"{tool} did not run:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def without_language(root: Path, folder: Path) -> Path:
    """A copy without language columns, which kalanos 0.8.2 and the viewer of LeRobot 0.6.1 cannot read."""
    copy = folder / root.name
    names = "['language_persistent', 'language_events']"
    edit = ("--operation.type=remove_feature", f"--operation.feature_names={names}")
    source = (f"--repo_id=local/{root.name}", f"--root={root}")
    target = (f"--new_repo_id=local/{root.name}", f"--new_root={copy}")
    subprocess.run(["lerobot-edit-dataset", *source, *target, *edit], check=True, capture_output=True)
    return copy


def doctor(root: Path) -> Iterator[Finding]:
    """A finding for each message of a check."""
    report = json.loads(checker("lerobot-doctor", "lerobot-doctor", "check", "--json", root))
    for check in report["checks"]:
        for message in check["messages"]:
            yield message["severity"].lower(), check["name"]


def lint(root: Path, folder: Path) -> Iterator[Finding]:
    """Its findings, from its report in `folder`."""
    target = folder / "lint.json"
    checker("lerobot-lint", "lelint", "check", "--units=degrees", f"--json={target}", root, statuses=(0, 2))
    for finding in json.loads(target.read_text(encoding="utf-8"))["findings"]:
        yield finding["severity"], finding["check"]


def kalanos(copy: Path) -> Iterator[Finding]:
    """Its findings on the columns and frames of the copy."""
    report = json.loads(checker("kalanos", "kalanos", "grade", "--json", copy))
    assert report["inventory"]["complete"] and not report["operational_errors"]
    for finding in report["findings"]:
        yield finding["severity"], finding["metric_id"]


def deepen(root: Path, folder: Path) -> Iterator[Finding]:
    """A finding for each check of an episode and of the whole."""
    target = folder / "deepen.json"
    checker("deepen-grade", "deepen", "grade", "--quiet", "--json", f"--output={target}", root)
    report = json.loads(target.read_text(encoding="utf-8"))
    for episode in (report["dataset_level_checks"], *(episode["checks"] for episode in report["episodes"])):
        for check in episode:
            yield check["severity"], check["check_id"]


def view(copy: Path, folder: Path) -> str:
    """Let LeRobot's viewer write a recording."""
    where = (f"--repo-id=local/{copy.name}", f"--root={copy}", f"--output-dir={folder}")
    command = [
        *uvx("viewer"),
        "lerobot-dataset-viz",
        *where,
        "--episode-index=0",
        "--save=1",
        "--num-workers=0",
    ]
    subprocess.run(command, check=True, capture_output=True)
    [recording] = folder.glob("*.rrd")
    return f"opened, a recording of {recording.stat().st_size // 1024} KiB"


@command("checks")
def main(config: ChecksConfig) -> None:
    """Check every dataset."""
    new = 0
    for root in (root.resolve() for root in config.dataset_roots):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            copy = without_language(root, folder)
            tools = {
                "lerobot-doctor": doctor(root),
                "lerobot-lint": lint(root, folder),
                "kalanos": kalanos(copy),
                "deepen-grade": deepen(root, folder),
            }
            for tool, findings in tools.items():
                print(f"{root.name}: {REQUIREMENTS[tool][0]}", flush=True)
                counts = Counter(found for found in findings if found[0] not in ("pass", "n/a", "info"))
                for (severity, rule), count in sorted(counts.items()):
                    known = rule in EXPLAINED[tool]
                    new += not known
                    print(f"  {count:5} {severity:8} {rule}{'' if known else '   <- not explained'}")
            print(f"{root.name}: lerobot-dataset-viz {view(copy, folder)}", flush=True)
    sys.exit(f"{new} rules found what docs/datasets.md does not explain" if new else 0)


if __name__ == "__main__":
    main()
