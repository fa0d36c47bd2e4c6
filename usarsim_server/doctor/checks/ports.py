"""The ports: each is opened just as the server would, all at the same time."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Iterator
from dataclasses import replace

from usarsim_server.doctor.findings import Finding, Mark, problem_and_advice
from usarsim_server.doctor.registry import Context, check
from usarsim_server.errors import ServiceError
from usarsim_server.options import OPTIONS, Option, is_port
from usarsim_server.processes import port_taker
from usarsim_server.services.listener import Endpoint, Listener

__all__ = ["look"]

TRIED = 200
"""Ports above one that is taken, among which a free one is looked for."""

_PORTS = tuple(filter(is_port, OPTIONS))


@check("ports", "Ports", order=30)
def look(context: Context) -> Iterator[Finding]:
    """Open all ports of the settings, and close them again."""
    yield from asyncio.run(_Round(context).findings())


class _Round:
    """One round of opening everything.

    What is open stays so until the end, so that two services with the same port are found out.
    """

    def __init__(self, context: Context) -> None:
        self._settings = context.settings
        self._context = context
        self._instead: dict[str, object] = {}
        self._open: dict[int, Option] = {}
        self._listeners: list[Listener] = []
        self._spoken_for = {getattr(self._settings, one.key) for one in _PORTS}

    async def findings(self) -> list[Finding]:
        """A finding for each service; if the host is wrong, one in all."""
        try:
            found = [await self._finding(option) for option in _PORTS]
        except _WrongHostError as error:
            problem, advice = problem_and_advice(str(error).partition(": ")[2])
            return [Finding("host", Mark.PROBLEM, problem, advice=advice)]
        finally:
            for listener in self._listeners:
                await listener.stop()
        # One command mends all of it.
        cure = self._context.serve(self._instead)
        return [
            replace(one, cure=cure) if one.values["option"] in self._instead else one
            for one in found
        ]

    async def _finding(self, option: Option) -> Finding:
        number: int | None = getattr(self._settings, option.key)
        if number is None:
            values = _values(option, None)
            return Finding("none", Mark.NOTE, f"{_service(option)}: off", values=values)
        host = self._settings.host
        listener = Listener(option.key, host, number, _hang_up, option=option.flag)
        try:
            endpoint = await listener.start()
        except ServiceError as error:
            return self._trouble(option, number, error)
        self._listeners.append(listener)
        self._open[endpoint.port] = option
        return _free(option, number, endpoint)

    def _trouble(self, option: Option, number: int, error: ServiceError) -> Finding:
        cause = error.__cause__
        reason = cause.errno if isinstance(cause, OSError) else None
        if isinstance(cause, socket.gaierror | UnicodeError) or reason == errno.EADDRNOTAVAIL:
            raise _WrongHostError(str(error)) from error
        # As the services are made: without robot control, or a port asked for, the server ends.
        needed = option.key == "port" or self._settings.demands(option.key)
        mark = Mark.PROBLEM if needed else Mark.WARNING
        after = "" if needed else "; the server goes on without"
        values = _values(option, number) | {"free": False}
        if reason != errno.EADDRINUSE:
            problem, advice = problem_and_advice(str(error).partition(": ")[2])
            text = f"{_service(option)}: {problem}{after}"
            return Finding(str(number), mark, text, advice=advice, values=values)
        if number in self._open:
            who, values["taken_by"] = f"{self._open[number].flag} has the same port", None
        else:
            who, values["taken_by"] = port_taker(number)
        self._instead[option.flag] = self._free_port(number)
        text = f"{_service(option)}: taken, {who}{after}"
        return Finding(str(number), mark, text, values=values)

    def _free_port(self, taken: int) -> int:
        """The next port that is free and that nobody here wants; 0, any free one, if none is."""
        for number in range(taken + 1, min(taken + TRIED, 65536)):
            if number not in self._spoken_for and _can_bind(self._settings.host, number):
                self._spoken_for.add(number)
                return number
        return 0


class _WrongHostError(ServiceError):
    """No port at all can be opened there: an unknown name, or another machine's address."""


async def _hang_up(client: socket.socket, peer: str) -> None:
    """Who connects during this moment finds nobody."""


def _free(option: Option, number: int, endpoint: Endpoint) -> Finding:
    reach = "this machine only" if endpoint.loopback else f"on {endpoint.host}"
    text = f"{_service(option)}: free, {reach}"
    return Finding(str(number or "any"), Mark.OK, text, values=_values(option, number))


def _can_bind(host: str, number: int) -> bool:
    for family, kind, _, _, address in socket.getaddrinfo(
        host, number, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
    ):
        with socket.socket(family, kind) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                trial.bind(address)
            except OSError:
                return False
    return True


def _service(option: Option) -> str:
    return option.help.removeprefix("port of ").removeprefix("the ")


def _values(option: Option, number: int | None) -> dict[str, object]:
    return {"option": option.flag, "port": number, "free": number is not None}
