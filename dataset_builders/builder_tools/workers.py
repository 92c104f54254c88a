# SPDX-License-Identifier: Apache-2.0
"""Runs pieces of work in parallel processes that neither outlive this one nor die unnoticed."""

import errno
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing.connection import wait
from types import TracebackType
from typing import Any, Self

import av
import datasets


def quiet() -> None:
    """Our progress bar is enough: the muxer and the library `datasets` each report every episode."""
    av.logging.set_libav_level(av.logging.ERROR)  # LeRobot takes Python's logging of it off again
    datasets.disable_progress_bars()


def draw_in_one_thread() -> None:
    """Keep Mesa's software renderer, which has not begun yet, from starting a thread for each core."""
    os.environ.setdefault("LP_NUM_THREADS", "0")


def usable_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _end_with_parent() -> None:
    """An executor's worker would wait for work for ever if its parent was killed."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


def is_disk_full(error: BaseException | None) -> bool:
    """Whether an error comes from there being no room to write.

    LeRobot's encoder hands on nothing but the text, and the library `datasets` hides the cause behind errors
    of its own or words it differently.
    """
    said = (os.strerror(errno.ENOSPC), os.strerror(errno.EDQUOT), "Not enough disk space")
    while error is not None:
        if any(text in str(error) for text in said):
            return True
        error = error.__cause__ or error.__context__
    return False


def _call[Item, Result](function: Callable[[Item], Result], item: Item) -> Result:
    """Errors of the video library do not travel between processes; a full disk's must arrive."""
    try:
        return function(item)
    except Exception as error:
        if is_disk_full(error):
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)) from None
        raise


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches all; the parent alone decides
    threading.Thread(target=_end_with_parent, daemon=True).start()
    quiet()


class Workers:
    """A number of processes that run functions; with one, the calling process does the work itself.

    The processes are spawned, because a GL context does not survive a fork.
    """

    def __init__(self, count: int) -> None:
        self._executor: ProcessPoolExecutor | None = None
        if count > 1:
            context = multiprocessing.get_context("spawn")
            self._executor = ProcessPoolExecutor(count, context, initializer=_begin)

    def run[Item, Result](
        self, function: Callable[[Item], Result], items: Iterable[Item]
    ) -> Iterator[Result]:
        """Results in the order in which they are ready; the first error ends the work.

        Raises:
            BrokenProcessPool: If a worker process died (`concurrent.futures.process`).
        """
        if self._executor is None:
            yield from map(function, items)
            return
        for future in as_completed([self._executor.submit(_call, function, item) for item in items]):
            yield future.result()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: Any, where: TracebackType | None) -> None:
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)
