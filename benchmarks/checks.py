# SPDX-License-Identifier: Apache-2.0
"""Runs four checkers from PyPI and LeRobot's viewer on data sets that `owlxt5-dataset` has made.

Usage: python benchmarks/checks.py FOLDER [FOLDER ...]

Needs `uv`, whose `uvx` fetches each checker into an environment of its own (lerobot-lint's holds a second
PyTorch). Prints what they find, by rule. Exit status 1 if docs/datasets.md does not explain one of them.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

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
    "lerobot-lint": {"DEAD_JOINT", "SATURATED_JOINT", "TASK_IMBALANCE", "TOO_FEW_EPISODES"},
    "kalanos": {"integrity.flatline_pct", "integrity.spike_pct"},
    "deepen-grade": {
        "cross.condition_coverage",
        "cross.duplicates",
        "episode_quality.idle_stall",
        "episode_quality.joint_limit_saturation",
    },
}
VERSIONS = {"lerobot-doctor": "0.2.0", "lerobot-lint": "0.1.1", "kalanos": "0.8.2", "deepen-grade": "0.4.1"}


def checker(package: str, *command: str | Path) -> str:
    """Standard output of a checker; its exit status tells about findings, which we read ourselves."""
    uvx = ("uvx", "--from", f"{package}=={VERSIONS[package]}")
    done = subprocess.run([*uvx, *command], capture_output=True, text=True, check=False)
    if not done.stdout and done.returncode not in (0, 2):
        sys.exit(f"{package} did not run:\n{done.stderr[-2000:]}")
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
    checker("lerobot-lint", "lelint", "check", "--units=degrees", f"--json={target}", root)
    for finding in json.loads(target.read_text())["findings"]:
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
    report = json.loads(target.read_text())
    for episode in (report["dataset_level_checks"], *(episode["checks"] for episode in report["episodes"])):
        for check in episode:
            yield check["severity"], check["check_id"]


def view(copy: Path, folder: Path) -> str:
    """Let LeRobot's viewer write a recording."""
    where = (f"--repo-id=local/{copy.name}", f"--root={copy}", f"--output-dir={folder}")
    viewer = ("uvx", "--from", "lerobot[viz]==0.6.1", "lerobot-dataset-viz")
    command = [*viewer, *where, "--episode-index=0", "--save=1", "--num-workers=0"]
    subprocess.run(command, check=True, capture_output=True)
    [recording] = folder.glob("*.rrd")
    return f"opened, a recording of {recording.stat().st_size // 1024} KiB"


def main() -> None:
    """Check every folder that the command line names."""
    new = 0
    for root in (Path(name).resolve() for name in sys.argv[1:]):
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
                print(f"{root.name}: {tool} {VERSIONS[tool]}")
                counts = Counter(found for found in findings if found[0] not in ("pass", "n/a", "info"))
                for (severity, rule), count in sorted(counts.items()):
                    known = rule in EXPLAINED[tool]
                    new += not known
                    print(f"  {count:5} {severity:8} {rule}{'' if known else '   <- not explained'}")
            print(f"{root.name}: lerobot-dataset-viz {view(copy, folder)}", flush=True)
    sys.exit(f"{new} rules found what docs/datasets.md does not explain" if new else 0)


if __name__ == "__main__":
    main()
