# SPDX-License-Identifier: Apache-2.0
"""A visitor of the page: a thread that owns a world, and lets it live at ten control periods a second."""

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from queue import Empty, Full, Queue

from lerobot_owlxt5.commands.prompts import MAX_CHARACTERS
from nico_tabletop.simulation import CONTROL_HZ

from .texts import ENGLISH
from .world import Table, View, World

logger = logging.getLogger(__name__)

_PERIOD = 1 / CONTROL_HZ
_WAITING_ORDERS = 20  # what somebody sends faster than a robot can hear is dropped


class Visitor:
    """Somebody at the page, with a world to themselves.

    All methods return at once; the world is made, changed and freed in its own thread.

    Args:
        make_world: Makes the world of a table.
        table: What stands there at first.

    Attributes:
        language: Of the page, one of `TEXTS`.
    """

    def __init__(self, make_world: Callable[[Table], World], table: Table) -> None:
        self.language = ENGLISH
        self._heard = time.monotonic()
        self._make_world, self._table = make_world, table
        self._orders: Queue[Callable[[World], None]] = Queue(_WAITING_ORDERS)
        self._scenes: deque[Table] = deque(maxlen=1)  # of many wishes the last one counts
        self._leaves, self._stops = threading.Event(), threading.Event()
        self._view = View(table=table)
        self._thread = threading.Thread(target=self._live, name="visitor", daemon=True)
        self._thread.start()

    @property
    def view(self) -> View:
        """What is to be seen now; the same object as long as nothing changes."""
        return self._view

    @property
    def idle_seconds(self) -> float:
        """How long nothing has come from them."""
        return time.monotonic() - self._heard

    def say(self, words: str) -> None:
        """Say something to the robot; what is longer than it reads it refuses."""
        words = words.strip()[: MAX_CHARACTERS + 1]
        if words:
            self._order(lambda world: world.hear(words))

    def point(self, place: str) -> None:
        """Point at a place of the eyes' picture: two shares, such as "0.25 0.5"; other words are no place."""
        shares = place.split()
        with suppress(ValueError):
            x, y = (min(max(float(share), 0.0), 1.0) for share in shares)
            self._order(lambda world: world.conversation.point(x, y))

    def home(self) -> None:
        """Let the arms go home."""
        self._order(lambda world: world.home())

    def show(self) -> None:
        """Let somebody move the arms, for the robot to watch."""
        self._order(lambda world: world.show())

    def lay(self, table: Table) -> None:
        """Lay the table anew."""
        self._heard = time.monotonic()
        self._scenes.append(table)

    def stop(self) -> None:
        """Let the robot hold still, before all that is waiting."""
        self._stops.set()

    def leave(self) -> None:
        """Free the world. The thread ends by itself."""
        self._leaves.set()

    def join(self) -> None:
        """Wait until the world is freed."""
        self._thread.join()

    def _order(self, order: Callable[[World], None]) -> None:
        self._heard = time.monotonic()
        with suppress(Full):
            self._orders.put_nowait(order)

    def _live(self) -> None:
        """Make worlds until the visitor leaves: another one after each that breaks."""
        while not self._leaves.is_set():
            try:
                self._live_in(self._make_world(self._table))
            except Exception:  # whatever it is, the page goes on, and shows nothing of it
                logger.exception("The world of a visitor broke")
                self._view = replace(self._view, failed=True, busy=False)
                self._wait_for_order()

    def _live_in(self, world: World) -> None:
        try:
            due = time.monotonic()
            while not self._leaves.is_set():
                if self._stops.is_set():
                    self._stops.clear()
                    self._forget_orders()
                    world.stop()
                if self._scenes:
                    world.lay(self._scenes.pop())
                if not self._orders.empty():
                    self._orders.get_nowait()(world)
                world.tick()
                self._table = world.table
                self._show(world.view())
                world.draw_bystander()
                # A slow computer makes a slow world, not one that jumps.
                due = max(due + _PERIOD, time.monotonic())
                self._leaves.wait(due - time.monotonic())
        finally:
            world.close()

    def _show(self, view: View) -> None:
        if view != self._view:
            self._view = view

    def _wait_for_order(self) -> None:
        """Wait for somebody to ask for anything: a new world will hear it."""
        self._forget_orders()
        while self._orders.empty() and not self._scenes and not self._leaves.wait(_PERIOD):
            pass

    def _forget_orders(self) -> None:
        with suppress(Empty):
            while True:
                self._orders.get_nowait()
