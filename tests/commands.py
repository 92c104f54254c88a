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


def launch(command: str, *arguments: str | Path, until: str) -> str:
    """Run a command in two processes; its output up to a line with `until`.

    Gloo's processes sometimes wait for their own threads forever when all is done (PyTorch 2.11: the reducer
    of DistributedDataParallel destroys the process group while it holds Python's lock). So nobody waits.
    """
    options = ("--num_machines=1", "--main_process_port=0", "--mixed_precision=no", "--dynamo_backend=no")
    with subprocess.Popen(
        [
            _BIN / "accelerate",
            "launch",
            "--multi_gpu",
            "--num_processes=2",
            *options,
            _BIN / command,
            *arguments,
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env=ENVIRONMENT,
    ) as process:
        assert process.stdout is not None
        lines = []
        for line in process.stdout:
            lines.append(line)
            if until in line:
                process.terminate()
                return "".join(lines)
    raise AssertionError("".join(lines)[-4000:])


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
