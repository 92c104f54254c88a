# SPDX-License-Identifier: Apache-2.0
"""What the scripts of the set-up and of the demo do when something is in the way."""

import os
import shutil
import signal
import subprocess
import time
from pathlib import Path

import psutil
import pytest

from commands import hear_interrupts

pytestmark = pytest.mark.slow  # starts bash

ROOT = Path(__file__).resolve().parents[1]


def copy(script: str, folder: Path) -> Path:
    """A script where its work touches nothing of this checkout."""
    place = folder / script
    place.parent.mkdir()
    shutil.copy(ROOT / script, place)
    return place


@pytest.mark.parametrize("piped", [False, True], ids=["a step", "a step that reads a pipe"])
def test_an_interrupted_demo_leaves_nothing_running(tmp_path: Path, piped: bool) -> None:
    script = copy("configs/demo.sh", tmp_path)
    tools = tmp_path / "tools"
    tools.mkdir()
    endless, quick = f"echo $$ >{tmp_path}/job\nexec sleep 120", "exit 0"
    for name, does in {
        "owlxt5-policy": "exit 1",
        "owlxt5-dataset": quick if piped else endless,
        "python": "echo 1",
        "lerobot-train": quick,
        "xargs": endless,
    }.items():
        (tools / name).write_text(f"#!/bin/sh\n{does}\n", encoding="utf-8")
        (tools / name).chmod(0o755)
    demo = subprocess.Popen(
        ["bash", script],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PATH": f"{tools}:{os.environ['PATH']}"},
        start_new_session=True,
        preexec_fn=hear_interrupts,
    )
    job = tmp_path / "job"
    while not job.exists() or not job.read_text(encoding="utf-8"):
        assert demo.poll() is None
        time.sleep(0.05)
    process = psutil.Process(int(job.read_text(encoding="utf-8")))
    time.sleep(1)  # till the demo looks how far it is, as it does most of the time
    os.killpg(demo.pid, signal.SIGINT)  # as a terminal does
    try:
        assert demo.wait(30) in (-signal.SIGINT, 128 + signal.SIGINT)
        process.wait(10)
    finally:
        if process.is_running():
            process.kill()


def test_the_set_up_removes_nobody_elses_environment(tmp_path: Path) -> None:
    script = copy(".ci/setup", tmp_path)
    for name in ("pyproject.toml", "constraints.txt"):
        (tmp_path / name).touch()
    python = tmp_path / ".venv/bin/python"
    python.parent.mkdir(parents=True)
    python.write_text("#!/bin/sh\nexit 1\n", encoding="utf-8")  # as one of another version is answered
    python.chmod(0o755)
    done = subprocess.run(["bash", script], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert line.startswith("set-up failed: .venv is not of this script")
    assert [path.name for path in python.parent.parent.iterdir()] == ["bin"]
    assert python.exists()
