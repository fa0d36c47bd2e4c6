"""The machine: processors, memory, how busy it is, how many sockets it allows."""

from __future__ import annotations

import os
from collections.abc import Iterator

from usarsim_server.doctor import system
from usarsim_server.doctor.commands import root
from usarsim_server.doctor.findings import Finding, Mark
from usarsim_server.doctor.registry import Context, check

__all__ = ["judge_activity", "judge_cores", "judge_descriptors", "judge_memory"]

WATCHED = 0.4
"""s of wall time for which the machine is watched."""
BUSY = 0.25
"""Part of the processors that others may use before that is worth a warning."""
RENICED = 0.5
"""Processors that a program must use to be named as the one to slow down."""
NEEDED = 512 << 20
"""Bytes: a server with sixteen robots and all ports takes 370 MiB (`usarsim bench memory`)."""
COMFORTABLE = 1 << 30
FILES = 200
"""Descriptors beside the control connections: side channels, relays, the server itself."""
_GIB = float(1 << 30)


@check("machine", "Machine", order=20)
def look(context: Context) -> Iterator[Finding]:
    """Ask `/proc`."""
    cores = system.cores()
    yield judge_cores(cores, context)
    yield judge_memory(*system.available_memory())
    yield judge_activity(system.activity(WATCHED), os.getloadavg()[0])
    yield judge_descriptors(system.descriptor_limit(), context.settings.connections)


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


def judge_activity(seen: system.Activity, load: float) -> Finding:
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
