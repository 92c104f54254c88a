# SPDX-License-Identifier: Apache-2.0
"""Runs the real commands, as a user does."""

import atexit
import multiprocessing
import os
import runpy
import signal
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Sequence
from pathlib import Path
from unittest import mock

_BIN = Path(sys.executable).parent
# Without MUJOCO_GL: users need not know it, on a machine with or without a screen.
ENVIRONMENT = {key: value for key, value in os.environ.items() if key != "MUJOCO_GL"} | {
    "OMP_NUM_THREADS": "1",
    "HF_HUB_OFFLINE": "1",
    "COLUMNS": "200",
}

# LeRobot and what it needs take longer to import than most commands then run. So a command is a fork of a
# process that has imported them, and nothing of ours: that each command does itself.
_FORKS = multiprocessing.get_context("forkserver")
_FORKS.set_forkserver_preload(
    ["lerobot.scripts.lerobot_train", "lerobot.scripts.lerobot_eval", "lerobot.datasets.aggregate"]
)


def hear_interrupts() -> None:
    """A `preexec_fn`: a shell lets what it runs in the background ignore Ctrl-C, and all that this starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


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
    words = [str(_BIN / command), *map(str, arguments)]
    if command == "python" or environment:
        return subprocess.run(
            words,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=ENVIRONMENT | environment,
            check=False,
        )
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "output"
        process = _FORKS.Process(target=_become, args=(words, os.getcwd(), output))
        # The first command starts the server, whose environment all have.
        with mock.patch.dict(os.environ, ENVIRONMENT, clear=True):
            process.start()
        process.join()
        assert process.exitcode is not None
        text = output.read_text(encoding="utf-8")
    return subprocess.CompletedProcess(words, process.exitcode, text)


def _become(words: Sequence[str], folder: str, output: Path) -> None:
    """Be a command, in a child process."""
    file = os.open(output, os.O_WRONLY | os.O_CREAT)
    for stream in (sys.stdout, sys.stderr):
        os.dup2(file, stream.fileno())
    os.chdir(folder)
    sys.argv = [*words]
    try:
        runpy.run_path(words[0], run_name="__main__")
    except Exception:
        traceback.print_exc()
        sys.exit(1)
    finally:
        atexit._run_exitfuncs()  # multiprocessing's children leave without
