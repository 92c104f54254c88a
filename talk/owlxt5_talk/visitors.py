# SPDX-License-Identifier: Apache-2.0
"""All who are at the page: so many have a world at once, the others wait."""

import threading
from collections.abc import Callable

from .visitor import Visitor

PATIENCE_SECONDS = 900
"""Who says and chooses nothing for so long makes room where somebody waits (our decision)."""


class Visitors:
    """Who has a world, by the browser tab's session.

    Args:
        make_visitor: Makes a visitor, with a new world.
        most: So many at once.
    """

    def __init__(self, make_visitor: Callable[[], Visitor], most: int) -> None:
        self._make_visitor, self._most = make_visitor, most
        self._visitors: dict[str, Visitor] = {}
        self._lock = threading.Lock()

    def enter(self, session: str) -> Visitor | None:
        """Who this is, with a world from now on; None if all places are taken."""
        with self._lock:
            if session not in self._visitors:
                if len(self._visitors) >= self._most:
                    self._make_room()
                if len(self._visitors) < self._most:
                    self._visitors[session] = self._make_visitor()
            return self._visitors.get(session)

    def _make_room(self) -> None:
        session, longest = max(self._visitors.items(), key=lambda item: item[1].idle_seconds)
        if longest.idle_seconds > PATIENCE_SECONDS:
            del self._visitors[session]
            longest.leave()

    def find(self, session: str | None) -> Visitor | None:
        """Who this is; None without a world."""
        return self._visitors.get(session or "")

    def leave(self, session: str | None) -> None:
        """Free somebody's place; nothing if they have none."""
        with self._lock:
            visitor = self._visitors.pop(session or "", None)
        if visitor is not None:
            visitor.leave()
