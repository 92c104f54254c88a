# SPDX-License-Identifier: Apache-2.0
"""Runs the real commands, as a user does."""

import os
import subprocess
import sys
from pathlib import Path

_BIN = Path(sys.executable).parent
# Without MUJOCO_GL: users need not know it, on a machine with or without a screen.
ENVIRONMENT = {key: value for key, value in os.environ.items() if key != "MUJOCO_GL"} | {
    "OMP_NUM_THREADS": "1",
    "HF_HUB_OFFLINE": "1",
    "COLUMNS": "200",
}


def run(command: str, *arguments: str | Path, **environment: str) -> str:
    """Run a command of the virtual environment; its output, or a failure that shows it."""
    done = run_anyway(command, *arguments, **environment)
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


def run_anyway(command: str, *arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    """Run a command that may fail; standard error is part of its output."""
    return subprocess.run(
        [_BIN / command, *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=ENVIRONMENT | environment,
        check=False,
    )
