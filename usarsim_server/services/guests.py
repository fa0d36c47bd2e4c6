"""Who is connected to a port and wants nothing: idle connections end, and they make room.

A connection that asks for nothing is closed after a while. When a port is full, a newcomer takes
the place of the one that has been silent longest, so that nobody can hold a port by sitting there.
A guest with standing, such as a robot on the radio that is in the world, keeps its place however
silent it is.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from usarsim_server.logs import Log
from usarsim_server.services.limits import Clock

__all__ = ["GRACE", "Guest", "Guests"]

GRACE = 5.0
"""s of silence before somebody has to make room: those who work are not thrown out by a crowd."""
_SWEEPS = 8
"""Looks at everybody in the time after which a guest is idle."""


def _nobody() -> bool:
    return False


@dataclass(slots=True, eq=False)
class Guest:
    """One connection.

    Attributes:
        peer: `host:port`.
        heard: when it last asked for something, or took what it was sent; s of the guests' clock.
        leave: ends the connection; may be called more than once.
        standing: whether it may be silent and stay even if the port is full.
        patient: whether it may be silent, but makes room.
    """

    peer: str
    heard: float
    leave: Callable[[], object]
    standing: Callable[[], bool] = _nobody
    patient: bool = field(default=False)


class Guests:
    """All connections of one port; used on one event loop."""

    def __init__(self, name: str, idle: float, clock: Clock = time.monotonic) -> None:
        """Nobody is there.

        Args:
            name: of the service, for the log.
            idle: s of silence after which a connection is closed; 0 for never.
            clock: see `Clock`.
        """
        self._log = Log(name)
        self._idle = idle
        self._clock = clock
        self._guests: set[Guest] = set()
        self._sweeper: asyncio.TimerHandle | None = None

    def __len__(self) -> int:
        """Number of connections."""
        return len(self._guests)

    @contextmanager
    def enter(self, peer: str) -> Iterator[Guest]:
        """The connection that the running task serves is a guest while inside."""
        task = asyncio.current_task()
        assert task is not None
        guest = Guest(peer, self._clock(), task.cancel)
        self.add(guest)
        try:
            yield guest
        finally:
            self._guests.discard(guest)

    def add(self, guest: Guest) -> None:
        """A connection has come."""
        self._guests.add(guest)
        if self._idle and self._sweeper is None:
            self._plan()

    def heard(self, guest: Guest) -> None:
        """A guest has asked for something, or took what it was sent."""
        guest.heard = self._clock()

    def sweep(self) -> None:
        """End the connections of those who have been idle too long."""
        limit = self._clock() - self._idle
        for guest in tuple(self._guests):
            if guest.heard <= limit and not guest.patient and not guest.standing():
                self._dismiss(guest, "idle", idle=self._idle)

    def make_room(self) -> bool:
        """End the connection of the one who has been silent longest; False if all have reasons."""
        limit = self._clock() - GRACE
        silent = [one for one in self._guests if one.heard <= limit and not one.standing()]
        if not silent:
            return False
        self._dismiss(min(silent, key=lambda one: one.heard), "silent, and the port is full")
        return True

    def _dismiss(self, guest: Guest, reason: str, **facts: object) -> None:
        self._guests.discard(guest)
        self._log.warning(
            f"connection closed by the server: {reason}", connection=guest.peer, **facts
        )
        guest.leave()

    def _plan(self) -> None:
        loop = asyncio.get_running_loop()
        self._sweeper = loop.call_later(self._idle / _SWEEPS, self._swept)

    def _swept(self) -> None:
        self._sweeper = None
        self.sweep()
        if self._guests:
            self._plan()
