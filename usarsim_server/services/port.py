"""A service on one port: its limits, its listener, and the guests that it has.

A connection that asks for nothing is closed after a while. When a port is full, a newcomer takes
the place of the one that has been silent longest, so that nobody can hold a port by sitting there.
A guest with standing, such as a robot on the radio that is in the world, keeps its place however
silent it is.

All services are started, announced and ended together. When every service listens one line goes to
standard output, for scripts that wait for it:

    READY control=127.0.0.1:3000 images=127.0.0.1:5003

It names only the services that listen.
"""

from __future__ import annotations

import asyncio
import socket
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from usarsim_server.base.errors import ServiceError
from usarsim_server.base.interrupts import calling
from usarsim_server.base.logs import Log
from usarsim_server.base.token_bucket import Clock
from usarsim_server.services.limits import InputRates
from usarsim_server.services.listener import Endpoint, Listener, ListenerLimits


@dataclass(frozen=True, slots=True, kw_only=True)
class PortLimits(ListenerLimits):
    """What the clients of a port may use, each and all together."""

    receive_buffer: int | None = 64 * 1024
    send_buffer: int | None = 64 * 1024
    arrival_rate: float = 100.0
    rate: float = 1000.0
    """Commands, requests or messages per wall s of one client in the long run; it is read no
    faster."""
    share: float = 0.05  # s of processor time per wall s that the requests of all clients may use
    idle: float = 300.0
    """s after which a client that asks for nothing, and has no reason to be silent, is closed; 0
    for never."""


GRACE = 5.0
"""s of silence before somebody has to make room: those who work are not thrown out by a crowd."""
_SWEEPS = 8
"""Looks at everybody in the time after which a guest is idle."""


def refuse(log: Log, foreign: str) -> None:
    """Log that a connection is closed because its first line is of HTTP or TLS."""
    log.warning(
        f"connection closed: a client speaks {foreign} to a port of USARSim's text protocol"
    )


def _nobody() -> bool:
    return False


@dataclass(slots=True, eq=False)
class Guest:
    """One connection."""

    peer: str  # `host:port`
    heard: float
    """When it last asked for something, or took what it was sent; s of the guests' clock."""
    leave: Callable[[], object]  # ends the connection; may be called more than once
    standing: Callable[[], bool] = _nobody
    """Whether it may be silent and stay even if the port is full."""
    patient: bool = field(default=False)  # whether it may be silent, but makes room
    unknown: bool = field(default=False)  # whether it makes room at once: it has not said hello


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

    @property
    def known(self) -> int:
        """Number of connections that have said hello, where that counts."""
        return sum(not one.unknown for one in self._guests)

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
        silent = [
            one
            for one in self._guests
            if (one.unknown or one.heard <= limit) and not one.standing()
        ]
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


L = TypeVar("L", bound=PortLimits)


class PortService(ABC, Generic[L]):
    """A service that listens on one port.

    Attributes:
        name: for the READY line and the log.
        required: whether the server shall not run without it, because it is pointless then or
            because somebody asked for this very port (`Settings.demands`); a service that is not
            required and cannot start is a warning (side channels reference 10, no. 10).
    """

    def __init__(
        self, name: str, host: str, port: int, option: str, limits: L, required: bool = False
    ) -> None:
        """Describe the service; nothing is opened before `start`.

        Args:
            name, required: see the attributes.
            host: address or host name to listen on.
            port: 0 takes any free one.
            option: command line option that sets the port.
            limits: of its clients; each service has defaults of its own.
        """
        self.name, self.required = name, required
        self._limits = limits
        self._log = Log(name)
        self._rates = InputRates(limits.rate)
        self._guests = Guests(name, limits.idle, lambda: asyncio.get_running_loop().time())
        make_room = self._guests.make_room
        self._listener = Listener(
            name, host, port, self._serve, option=option, limits=limits, make_room=make_room
        )

    @property
    def connections(self) -> int:
        """Number of clients connected."""
        return self._listener.connections

    async def start(self) -> Endpoint:
        """Open the port.

        Raises:
            ServiceError: if it cannot be opened.
        """
        return await self._listener.start()

    async def stop(self) -> None:
        """Close the port and every connection, whose conversations have ended then."""
        await self._listener.stop()

    @abstractmethod
    async def _serve(self, client: socket.socket, peer: str) -> None:
        """Talk to a client, `host:port`, until it goes or has to go."""


_log = Log("server")


Service = PortService[Any]
"""Any of them."""


def print_ready(endpoints: Sequence[Endpoint]) -> None:
    """Write the READY line to standard output at once."""
    print(" ".join(["READY", *map(str, endpoints)]), flush=True)


async def run_services(
    services: Sequence[Service],
    on_ready: Callable[[Sequence[Endpoint]], None] = print_ready,
    stop: asyncio.Event | None = None,
) -> None:
    """Start services in order, announce them, and run until SIGINT, SIGTERM or `stop`.

    Every service that was started is stopped before this returns or raises.

    Args:
        services: to start, in the order of the READY line.
        on_ready: called once, when all of them listen.
        stop: set it, on the event loop, to end from inside the program.

    Raises:
        ServiceError: if a required service cannot start, or none at all listens.
    """
    stop = stop or asyncio.Event()
    started: list[Service] = []
    loop = asyncio.get_running_loop()
    with calling(lambda: loop.call_soon_threadsafe(stop.set)):
        try:
            endpoints = await _start(services, started, stop)
            if not stop.is_set():
                on_ready(endpoints)
                _advise(endpoints)
            await stop.wait()
        finally:
            await _stop(started)


async def _start(
    services: Sequence[Service], started: list[Service], stop: asyncio.Event
) -> list[Endpoint]:
    endpoints: list[Endpoint] = []
    for service in services:
        if stop.is_set():
            return endpoints
        try:
            endpoints.append(await service.start())
        except ServiceError as error:
            if service.required:
                raise
            _log.warning(f"goes on without {service.name}: {error}")
        else:
            started.append(service)
    if not endpoints:
        raise ServiceError("no service listens (switch on at least one port)")
    return endpoints


async def _stop(started: Sequence[Service]) -> None:
    results = await asyncio.gather(
        *(service.stop() for service in reversed(started)), return_exceptions=True
    )
    for service, result in zip(reversed(started), results, strict=True):
        if isinstance(result, BaseException):
            _log.exception("a service did not stop cleanly", result, service=service.name)
    _log.info("stopped")


def _advise(endpoints: Sequence[Endpoint]) -> None:
    if all(endpoint.loopback for endpoint in endpoints):
        _log.info(
            f"only programs on this machine can connect, at {endpoints[0].host}; who wants others "
            "in says --host 0.0.0.0 (there are no passwords: in a trusted network only)"
        )
