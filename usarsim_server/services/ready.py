"""Starting services, saying so, and ending them.

When every service listens one line goes to standard output, for scripts that wait for it:

    READY control=127.0.0.1:3000 images=127.0.0.1:5003

It names only the services that listen.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from typing import Protocol

from usarsim_server import processes as interrupts
from usarsim_server.errors import ServiceError
from usarsim_server.logs import Log
from usarsim_server.services.listener import Endpoint

_log = Log("server")


class Service(Protocol):
    """Something that listens on a port.

    Attributes:
        name: as it stands on the READY line.
        required: whether the server shall not run without it, because it is pointless then or
            because somebody asked for this very port (`Settings.demands`); a service that is not
            required and cannot start is a warning (side channels reference 10, no. 10).
    """

    @property
    def name(self) -> str: ...

    @property
    def required(self) -> bool: ...

    async def start(self) -> Endpoint:
        """Open the port; `ServiceError` if it cannot be opened."""
        ...

    async def stop(self) -> None:
        """Close the port and all connections; not called on a service that did not start."""
        ...


def ready_line(endpoints: Sequence[Endpoint]) -> str:
    """The READY line, without line end."""
    return " ".join(["READY", *map(str, endpoints)])


def print_ready(endpoints: Sequence[Endpoint]) -> None:
    """Write the READY line to standard output at once."""
    print(ready_line(endpoints), flush=True)


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
    with interrupts.calling(lambda: loop.call_soon_threadsafe(stop.set)):
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
        _log.warning(
            "only programs on this machine can connect; --host 0.0.0.0 opens the server "
            "to the network (it knows no passwords: do so in a trusted network only)"
        )
