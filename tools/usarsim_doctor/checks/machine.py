"""The machine: processors, memory, who keeps it busy, sockets, and whether the ports are free.

Limits of a container are read below a folder that stands for `/sys/fs/cgroup`, so that tests can
make one up. Ports are really opened, just as the server would, all at the same time. psutil is
imported where it is used: without it the ports can still be looked at.
"""

from __future__ import annotations

import asyncio
import errno
import os
import resource
import socket
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

from usarsim_doctor.mending import pip, root
from usarsim_doctor.registry import Context, Finding, Mark, check
from usarsim_server.base.errors import ServiceError, problem_and_advice
from usarsim_server.base.processes import PROC, Process, name, port_taker
from usarsim_server.options import OPTIONS, Option
from usarsim_server.services.listener import Endpoint, Listener

CGROUP = Path("/sys/fs/cgroup")
WATCHED = 0.4
"""s of wall time for which the machine is watched."""
BUSY = 0.25
"""Part of the processors that others may use before that is worth a warning."""
RENICED = 0.5
"""Processors that a program must use to be named as the one to slow down."""
NEEDED = 512 << 20
"""Bytes: a server with sixteen robots and all ports takes 370 MiB (`make bench ARGS=memory`)."""
COMFORTABLE = 1 << 30
FILES = 200
"""Descriptors beside the control connections: side channels, relays, the server itself."""
_GIB = float(1 << 30)


@check("machine", "Machine", order=20)
def look_at_machine(context: Context) -> Iterator[Finding]:
    """Ask the system, and watch it for a moment."""
    yield judge_cores(cores(), context)
    if find_spec("psutil") is None:
        text = "not looked at: psutil is not installed"
        yield Finding("memory and load", Mark.NOTE, text, pip("psutil"))
    else:
        yield judge_memory(*available_memory())
        yield judge_activity(activity(WATCHED), os.getloadavg()[0])
    yield judge_descriptors(
        resource.getrlimit(resource.RLIMIT_NOFILE)[0], context.settings.connections
    )


@dataclass(frozen=True, slots=True)
class Activity:
    """What went on during a short while."""

    processors: int  # of the whole machine
    busy: float  # how many of them were busy, on average
    busiest: Process | None  # the program that used most; None if none could be seen


def cores(group: Path = CGROUP) -> float:
    """Processors that this process may use: by affinity, and by the quota of its container."""
    allowed = float(len(os.sched_getaffinity(0)))
    quota = _quota(group)
    return allowed if quota is None else min(allowed, quota)


def _quota(group: Path) -> float | None:
    with suppress(OSError, ValueError, IndexError):  # version 2: "200000 100000" or "max 100000"
        quota, period = (group / "cpu.max").read_text().split()[:2]
        return None if quota == "max" else int(quota) / int(period)
    with suppress(OSError, ValueError):  # version 1: microseconds, -1 for none
        microseconds = int((group / "cpu/cpu.cfs_quota_us").read_text())
        period_us = int((group / "cpu/cpu.cfs_period_us").read_text())
        return microseconds / period_us if microseconds > 0 and period_us > 0 else None
    return None


def available_memory(group: Path = CGROUP) -> tuple[int, int]:
    """Bytes that can be had without swapping, and in all, within the limit of the container."""
    import psutil

    memory = psutil.virtual_memory()
    free, total = memory.available, memory.total
    with suppress(OSError, ValueError, KeyError):
        limit = int((group / "memory.max").read_text())
        used = int((group / "memory.current").read_text())
        pairs = (line.split() for line in (group / "memory.stat").read_text().splitlines())
        # Files that were read some time ago are given up as soon as somebody needs the room.
        used -= {name: int(value) for name, value in pairs}["inactive_file"]
        free, total = min(free, max(0, limit - used)), min(total, limit)
    return free, total


def activity(seconds: float) -> Activity:
    """Watch for so many s what other programs do; this thread sleeps meanwhile."""
    import psutil

    processors, spent = psutil.cpu_count() or 1, _spent()
    busy = psutil.cpu_percent(seconds) / 100.0 * processors
    used = {
        pid: (after - spent[pid]) / seconds
        for pid, after in _spent().items()
        if pid in spent and pid != os.getpid()
    }
    busiest = max(used, key=lambda pid: used[pid], default=None)
    program = None if busiest is None else Process(busiest, name(PROC, busiest), used[busiest])
    return Activity(processors, busy, program)


def _spent() -> dict[int, float]:
    """s of processor time that each program has used so far, as far as we may see."""
    import psutil

    found = {}
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            times = process.cpu_times()
            found[process.pid] = times.user + times.system
    return found


def judge_cores(cores: float, context: Context) -> Finding:
    """What to say of so many processors."""
    values = {"cores": cores}
    if cores >= 1.5:
        return Finding("processors", Mark.OK, f"{cores:g}", values=values)
    text = f"{cores:g}: physics, sensors and cameras share it; watch few cameras"
    return Finding(
        "processors", Mark.WARNING, text, context.serve({"--camera-rate": 5}), values=values
    )


def judge_memory(free: int, total: int) -> Finding:
    """What to say of so many bytes."""
    values = {"available_bytes": free, "total_bytes": total}
    text = f"{free / _GIB:.1f} GiB available of {total / _GIB:.1f}"
    if free >= COMFORTABLE:
        return Finding("memory", Mark.OK, text, values=values)
    mark = Mark.PROBLEM if free < NEEDED else Mark.WARNING
    text += f": a server with sixteen robots wants {NEEDED >> 20} MiB, large maps more"
    return Finding("memory", mark, text, "ps -eo pid,rss,args --sort=-rss | head", values=values)


def judge_activity(seen: Activity, load: float) -> Finding:
    """What to say of what other programs do.

    Args:
        seen: just now.
        load: mean number of programs that wanted a processor during the last minute.
    """
    values: dict[str, object] = {
        "busy_cores": round(seen.busy, 2),
        "machine_cores": seen.processors,
        "load_1min": round(load, 2),
    }
    text = (
        f"other programs use {seen.busy:.1f} of {seen.processors} processors now; "
        f"load of the last minute {load:.1f}"
    )
    if seen.busy <= BUSY * seen.processors:
        return Finding("load", Mark.OK, text, values=values)
    cure = "top -o %CPU"
    if seen.busiest is not None and seen.busiest.cores >= RENICED:
        program = seen.busiest
        values["busiest"] = {"pid": program.pid, "name": program.name}
        text += f"; most of all {program.name} (pid {program.pid}), which could stand back"
        cure = root(f"renice -n 19 -p {program.pid}")
    return Finding("load", Mark.WARNING, text, cure, values=values)


def judge_descriptors(limit: int, connections: int) -> Finding:
    """What to say of a limit of open files, for so many control connections."""
    values = {"open_files": limit}
    endless = limit < 0
    if endless or limit >= connections + FILES:
        text = "no limit" if endless else f"{limit} may be open"
        return Finding("sockets, files", Mark.OK, text, values=values)
    text = f"only {limit} may be open: clients will have to wait"
    return Finding("sockets, files", Mark.WARNING, text, "ulimit -n 4096", values=values)


# -- ports ---------------------------------------------------------------------------------------

TRIED = 200
"""Ports above one that is taken, among which a free one is looked for."""

_PORTS = tuple(option for option in OPTIONS if option.port)


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
    return option.declared.help.removeprefix("port of ").removeprefix("the ")


def _values(option: Option, number: int | None) -> dict[str, object]:
    return {"option": option.flag, "port": number, "free": number is not None}
