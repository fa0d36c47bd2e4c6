"""Worlds and robot files: how many there are, and which of them are broken.

The ports: each is opened just as the server would, all at the same time.
"""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import TYPE_CHECKING

from usarsim_server.data import data_directory
from usarsim_server.doctor.isolation import pip
from usarsim_server.doctor.registry import Context, Finding, Mark, check, problem_and_advice
from usarsim_server.errors import ServiceError, UsarsimError
from usarsim_server.options import OPTIONS, Option, is_port
from usarsim_server.processes import port_taker
from usarsim_server.services.listener import Endpoint, Listener

if TYPE_CHECKING:
    from usarsim_server.robots.catalog import RobotFile


PLUGIN_GROUPS = (
    "usarsim_server.sensors",
    "usarsim_server.effectors",
    "usarsim_server.families",
    "usarsim_server.propagation",
    "usarsim_maps.readers",
)


@check("files", "Worlds and robots", order=40, apart=True)
def look_at_files(context: Context) -> Iterator[Finding]:
    """Read every world and every robot file that a server could use."""
    yield from judge_worlds(data_directory("worlds"))
    yield from judge_robots([data_directory("robots"), *context.settings.robots])
    for group in PLUGIN_GROUPS:
        for point in entry_points(group=group):
            yield judge_plugin(point)


def judge_worlds(folder: Path) -> Iterator[Finding]:
    """Load all worlds of a folder."""
    from usarsim_server.worlds.loader import SHEET, load_world

    names, broken = [], []
    for place in sorted(one.parent for one in folder.glob(f"*/{SHEET}")):
        try:
            names.append(load_world(place).name)
        except UsarsimError as error:
            problem, advice = problem_and_advice(str(error))
            broken.append(Finding(place.name, Mark.WARNING, problem, advice=advice))
    values = {"worlds": names}
    if names:
        yield Finding("worlds", Mark.OK, f"{len(names)}: {', '.join(names)}", values=values)
    else:
        cure = pip("--force-reinstall", "--no-deps", "usarsim-server")
        yield Finding("worlds", Mark.PROBLEM, f"there are none in {folder}", cure, values=values)
    yield from broken


def judge_robots(folders: Sequence[Path]) -> Iterator[Finding]:
    """Read all robot files; the first folder is that of the shipped ones.

    Any file that cannot be read keeps the server from starting.
    """
    from usarsim_server.robots.catalog import Roster

    layers: list[list[RobotFile]] = []
    broken: list[Finding] = []
    for number, folder in enumerate(folders):
        files, findings = _read(folders, number, folder)
        layers.append(files)
        broken.extend(findings)
    if not broken:
        try:
            Roster(layers)  # which knows whether two of them want the same name
        except UsarsimError as error:
            broken.append(_broken("robot files", error))
    shipped, own = len(layers[0]), sum(map(len, layers[1:]))
    text = f"{shipped} classes" + (f", {own} of your own" if len(folders) > 1 else "")
    values = {"shipped": shipped, "own": own, "broken": len(broken)}
    yield Finding("robots", Mark.OK if shipped else Mark.PROBLEM, text, values=values)
    yield from broken


def _read(
    folders: Sequence[Path], number: int, folder: Path
) -> tuple[list[RobotFile], list[Finding]]:
    from usarsim_server.robots.catalog import Library

    files: list[RobotFile] = []
    broken: list[Finding] = []
    library = None
    for path in sorted(folder.glob("*.toml")):
        try:
            # After an error a library is in the middle of a file, so the next one is a new one.
            library = library or Library(folders)
            files.append(library.load(path, number))
        except UsarsimError as error:
            broken.append(_broken(path.name, error))
            library = None
    return files, broken


def _broken(subject: str, error: UsarsimError) -> Finding:
    problem, advice = problem_and_advice(str(error))
    return Finding(subject, Mark.PROBLEM, problem, advice=advice)


def judge_plugin(point: EntryPoint) -> Finding:
    """Load a plug-in of another package."""
    package = point.dist.name if point.dist is not None else "its package"
    subject = f"plug-in {point.name}"
    try:
        point.load()
    except Exception as error:  # it is somebody else's code
        text = f"{point.value} cannot be loaded: {type(error).__name__}: {error}"
        cure = pip("--force-reinstall", package)
        return Finding(subject, Mark.WARNING, " ".join(text.split()), cure)
    return Finding(subject, Mark.OK, f"{point.value}, of {package}")


TRIED = 200
"""Ports above one that is taken, among which a free one is looked for."""

_PORTS = tuple(filter(is_port, OPTIONS))


@check("ports", "Ports", order=30)
def look_at_ports(context: Context) -> Iterator[Finding]:
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
