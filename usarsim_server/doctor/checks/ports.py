"""The ports: each is opened just as the server would, all at the same time."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
from collections.abc import Iterator

from usarsim_server.doctor import system
from usarsim_server.doctor.findings import Finding, Mark, problem_and_cure
from usarsim_server.doctor.registry import Context, check
from usarsim_server.errors import ServiceError
from usarsim_server.options import OPTIONS, Option, is_port
from usarsim_server.services.listener import Endpoint, Listener
from usarsim_server.settings import Settings

__all__ = ["look"]

TRIED = 200
"""Ports above one that is taken, among which a free one is looked for."""


@check("ports", "Ports", order=30)
def look(context: Context) -> Iterator[Finding]:
    """Open all ports of the settings, and close them again."""
    yield from asyncio.run(_try(context.settings))


async def _try(settings: Settings) -> list[Finding]:
    findings: list[Finding] = []
    open_now: dict[int, Option] = {}
    listeners: list[Listener] = []
    try:
        for option in filter(is_port, OPTIONS):
            number: int | None = getattr(settings, option.key)
            if number is None:
                text = f"{_service(option)}: off"
                findings.append(Finding("none", Mark.NOTE, text, values=_values(option, None)))
                continue
            listener = Listener(option.key, settings.host, number, _hang_up, option=option.flag)
            try:
                endpoint = await listener.start()
            except ServiceError as error:
                findings.append(_trouble(settings, option, number, error, open_now))
                continue
            listeners.append(listener)
            open_now[endpoint.port] = option
            findings.append(_free(option, number, endpoint))
    finally:
        for listener in listeners:
            await listener.stop()
    return findings


async def _hang_up(client: socket.socket, peer: str) -> None:
    """Who connects during this moment finds nobody."""


def _free(option: Option, number: int, endpoint: Endpoint) -> Finding:
    reach = "this machine only" if endpoint.loopback else f"on {endpoint.host}"
    text = f"{_service(option)}: free, {reach}"
    return Finding(str(number or "any"), Mark.OK, text, values=_values(option, number))


def _trouble(
    settings: Settings,
    option: Option,
    number: int,
    error: ServiceError,
    open_now: dict[int, Option],
) -> Finding:
    # As the services are made: without robot control, or a port asked for, the server ends.
    needed = option.key == "port" or settings.demands(option.key)
    mark = Mark.PROBLEM if needed else Mark.WARNING
    values = _values(option, number) | {"free": False}
    after = "" if needed else " (the server goes on without)"
    cause = error.__cause__
    if not isinstance(cause, OSError) or cause.errno != errno.EADDRINUSE:
        problem, cure = problem_and_cure(str(error).partition(": ")[2])
        text = f"{_service(option)}: {problem}{after}"
        return Finding(str(number), mark, text, cure, values)
    values["taken_by"] = None
    if number in open_now:
        who = f"{open_now[number].flag} has the same port"
    else:
        who, pid = _taker(number)
        values["taken_by"] = pid
    other = _free_port(settings, number)
    cure = f"usarsim serve {option.flag} {other if other is not None else 0}"
    return Finding(str(number), mark, f"{_service(option)}: taken, {who}{after}", cure, values)


def _taker(number: int) -> tuple[str, int | None]:
    """Words for who has a port, and the number of the process if that can be seen."""
    owner = system.port_owner(number)
    if owner is None:
        return "by whom cannot be seen", None
    if owner.process is None:
        return f"by a program of user {owner.user}", None
    if owner.process.pid == os.getpid():
        return "by this very program", owner.process.pid
    return f"by {owner.process.name} (pid {owner.process.pid})", owner.process.pid


def _free_port(settings: Settings, taken: int) -> int | None:
    """The next port that is free and that no service of these settings wants."""
    wanted = {getattr(settings, option.key) for option in filter(is_port, OPTIONS)}
    for number in range(taken + 1, min(taken + TRIED, 65536)):
        if number in wanted:
            continue
        for family, kind, _, _, address in socket.getaddrinfo(
            settings.host, number, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        ):
            with socket.socket(family, kind) as trial:
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                try:
                    trial.bind(address)
                except OSError:
                    break
        else:
            return number
    return None


def _service(option: Option) -> str:
    return option.help.removeprefix("port of ").removeprefix("the ")


def _values(option: Option, number: int | None) -> dict[str, object]:
    return {"option": option.flag, "port": number, "free": number is not None}
