# SPDX-License-Identifier: Apache-2.0
"""Runs a plan, and goes on where an earlier run was interrupted."""

import fcntl
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from .plan import RELEASE, ROOT, Plan, Step, read_setting, write_setting
from .record import any_whole, drop_record, is_whole, read_record, write_record

_CHECKPOINT = Path("checkpoints/last/pretrained_model/train_config.json")
_DATASET = "owlxt5-dataset"
_GOES_ON = (_DATASET, "python benchmarks/robustness.py")
"""Commands that go on by themselves where they were interrupted."""
_GRACE = 20.0  # seconds that an interrupted command has to end
_TICK = 0.5
_PRIOR = 300.0  # seconds


class RunError(Exception):
    """A run that could not begin, or in which a step failed."""


def next_command(plan: Plan, step: Step) -> str | None:
    """What carries on an interrupted step; None if it must begin anew.

    A training goes on from its last checkpoint. A dataset that is there is finished, and leftovers are
    removed. What an earlier plan's command left is not gone on with.
    """
    if read_record(plan, step) is None or not (ROOT / step.output).exists():
        return None
    if step.command.startswith("lerobot-train"):
        checkpoint = step.output / _CHECKPOINT
        resumable = (ROOT / checkpoint).exists()
        return f"lerobot-train --config_path={checkpoint} --resume=true" if resumable else None
    data = step.output / "data"
    if step.command.startswith(_DATASET) and (ROOT / data).exists():
        return f"rm -rf {data}.unfinished"
    return step.command if step.command.startswith(_GOES_ON) else None


def time_left(plan: Plan, done: dict[str, float], running: Step | None = None, since: float = 0.0) -> float:
    """Seconds until the last step is whole.

    A step counts as the plan expects it, times what the steps of its template have taken in place of what was
    expected of them. If none of them is whole, all whole steps are asked, and five minutes as planned
    are added to them (our decision).

    Args:
        plan: What is run.
        done: Seconds of each whole step, by name.
        running: The step that is being run.
        since: Seconds that it has been running.
    """
    whole = [step for step in plan.steps if step.name in done]

    def factor(template: str) -> float:
        alike = [step for step in whole if step.template == template]
        # Few short steps say little about long ones of another kind.
        as_planned = 0.0 if alike else _PRIOR
        measured = sum(done[step.name] for step in alike or whole) + as_planned
        expected = sum(step.seconds for step in alike or whole) + as_planned
        return measured / expected

    left = 0.0
    for step in plan.steps:
        if step.name not in done:
            seconds = step.seconds * factor(step.template)
            left += max(seconds - since, 0.0) if step is running else seconds
    return left


def heed_signals() -> None:
    """Take `kill` and the end of the terminal for Ctrl-C; `nohup` still keeps a run alive."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)


def run(plan: Plan, console: Console) -> None:
    """Run all steps that are not whole.

    If a step begins anew, all that read from it are run again, because it may come out otherwise this time.
    A step that fails is left out with those that need it, and the others are run.

    Raises:
        RunError: If another run of the same size is going on, its setting was another one, or steps failed.
        KeyboardInterrupt: Once the running command has ended.
    """
    logs = ROOT / plan.folder / "logs"
    logs.mkdir(parents=True, exist_ok=True)
    failed: list[str] = []
    with _alone_in(plan) as lock:
        _keep_setting(plan)
        with _Display(plan, console) as display:
            for number, step in enumerate(plan.steps, 1):
                if is_whole(plan, step):
                    continue
                if {*step.inputs} & {*failed}:
                    failed.append(step.name)
                    continue
                log = logs / f"{step.name}.log"
                display.begin(number, step)
                if _run_step(plan, step, log, lock, display):
                    display.end(step)
                else:
                    failed.append(step.name)
                    display.fail(log)
    if failed:
        raise RunError(
            f"{len(failed)} of {len(plan.steps)} steps are missing, first of all {failed[0]}: see "
            f"{plan.folder}/logs/{failed[0]}.log, mend it, and run the same command again"
        )


def _keep_setting(plan: Plan) -> None:
    """Note where a plan is run, unless finished steps of its folder were made with another setting."""
    then, now = read_setting(plan.folder), plan.setting
    if then != now and any_whole(plan):
        raise RunError(
            f"{plan.folder} was made with source {then.source} and device {then.device}, but they are now "
            f"{now.source} and {now.device}: set {RELEASE} and CUDA_VISIBLE_DEVICES as they were then, or "
            "delete that folder"
        )
    write_setting(plan)


def _run_step(plan: Plan, step: Step, log: Path, lock: IO[str], display: "_Display") -> bool:
    """Run a step to its end; whether it succeeded."""
    record, command = read_record(plan, step), next_command(plan, step)
    before = record.seconds if record and command else 0.0
    if command is None:
        for each in plan.readers(step):
            drop_record(plan, each)
        shutil.rmtree(ROOT / step.output, ignore_errors=True)
    write_record(plan, step, before, whole=False)
    began = time.monotonic()
    with log.open("w" if command is None else "a", encoding="utf-8") as output:
        try:
            status = _call(command or step.command, plan, output, lock, lambda: display.show(step, log))
        finally:
            seconds = before + time.monotonic() - began
            write_record(plan, step, seconds, whole=False)
    # What says that it succeeded and wrote nothing has not written where the next steps look.
    succeeded = status == 0 and (ROOT / step.output).exists()
    if succeeded:
        write_record(plan, step, seconds, whole=True)
    return succeeded


def _call(command: str, plan: Plan, output: IO[str], lock: IO[str], tick: Callable[[], None]) -> int:
    """Run a command in a session of its own, which ends with this process's interruption; its exit status."""
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    process = subprocess.Popen(
        ["bash", "-c", command],
        cwd=ROOT,
        env=os.environ | {"PATH": path, "PYTHONUNBUFFERED": "1"} | dict(plan.environment),
        stdin=subprocess.DEVNULL,
        stdout=output,
        stderr=subprocess.STDOUT,
        start_new_session=True,
        pass_fds=[lock.fileno()],  # as long as it runs, nobody else may write here
    )
    try:
        while process.poll() is None:
            tick()
            with suppress(subprocess.TimeoutExpired):
                process.wait(_TICK)
    except BaseException:
        _end(process)
        raise
    return process.returncode


def _end(process: "subprocess.Popen[bytes]") -> None:
    """End a command and its children, at first with the signal of Ctrl-C."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
        with suppress(ProcessLookupError):
            os.killpg(process.pid, number)
        with suppress(subprocess.TimeoutExpired):
            process.wait(_GRACE / 2)
            return


@contextmanager
def _alone_in(plan: Plan) -> Iterator[IO[str]]:
    """Keep two runs from writing into the same folder."""
    with (ROOT / plan.folder / "lock").open("w", encoding="utf-8") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise RunError(
                f"another run, or a command that it started, still writes into {plan.folder}: wait until it "
                "ends, or end it"
            ) from None
        yield lock


class _Display:
    """Which step of how many, what it says, and the time left.

    Args:
        plan: What is run.
        console: Where it is shown; what is no terminal gets a line a step.
    """

    def __init__(self, plan: Plan, console: Console) -> None:
        self._plan, self._console = plan, console
        self._done: dict[str, float] = {}
        for step in plan.steps:
            record = read_record(plan, step)
            if record and is_whole(plan, step) and {*step.inputs} <= {*self._done}:
                self._done[step.name] = record.seconds
        self._began, self._title = 0.0, ""
        self._progress = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            TextColumn("[dim]{task.fields[said]}"),
            console=console,
        )
        self._task = self._progress.add_task("", total=1.0, left="", said="")

    def __enter__(self) -> "_Display":
        left = time_left(self._plan, self._done)
        count = len(self._plan.steps) - len(self._done)
        self._say(f"{count} of {len(self._plan.steps)} steps to run, about {in_words(left)}")
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def begin(self, number: int, step: Step) -> None:
        """Show the step that begins."""
        self._began = time.monotonic()
        self._title = f"[{number}/{len(self._plan.steps)}] {step.name}"
        self._progress.update(self._task, description=escape(self._title))

    def show(self, step: Step, log: Path) -> None:
        """Show how far all of it is, and the last that the step says."""
        left = time_left(self._plan, self._done, step, time.monotonic() - self._began)
        behind = sum(self._done.values()) + time.monotonic() - self._began
        said = escape(_last_lines(log, 1)[-60:])
        self._progress.update(
            self._task, completed=behind, total=behind + left, left=f"{in_words(left)} left", said=said
        )

    def end(self, step: Step) -> None:
        """Say that a step is whole."""
        self._done[step.name] = seconds = time.monotonic() - self._began
        left = in_words(time_left(self._plan, self._done))
        self._say(f"{self._title}: {in_words(seconds)}, {left} left")

    def fail(self, log: Path) -> None:
        """Say that a step has failed, and the last that it said."""
        self._say(f"{self._title} failed: {_last_lines(log, 3)}")

    def _say(self, line: str) -> None:
        self._console.print(line, markup=False, highlight=False)


def in_words(seconds: float) -> str:
    """A duration: `40 s`, `12 min` or `3.5 h`."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def _last_lines(log: Path, count: int) -> str:
    """The end of a log, in one line; progress bars rewrite theirs with a carriage return."""
    with log.open("rb") as file:
        file.seek(max(0, log.stat().st_size - 2000))
        text = file.read().decode("utf-8", errors="replace")
    lines = [line.strip() for line in text.replace("\r", "\n").splitlines() if line.strip()]
    return " / ".join(lines[-count:])
