"""What Linux tells about this machine: processors, memory, who keeps it busy.

Everything is read below a folder that stands for `/proc` (proc(5)), so that tests can make one up.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from usarsim_server.processes import PROC, Process, name, pids

CGROUP = Path("/sys/fs/cgroup")


@dataclass(frozen=True, slots=True)
class Activity:
    """What went on during a short while.

    Attributes:
        processors: of the whole machine.
        busy: how many of them were busy, on average.
        busiest: the program that used most; None if none could be seen.
    """

    processors: int
    busy: float
    busiest: Process | None


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


def available_memory(proc: Path = PROC, group: Path = CGROUP) -> tuple[int, int]:
    """Bytes that can be had without swapping, and in all, within the limit of the container."""
    lines = (proc / "meminfo").read_text().splitlines()
    table = {
        name: int(rest.split()[0]) * 1024
        for name, _, rest in (line.partition(":") for line in lines)
    }
    free, total = table["MemAvailable"], table["MemTotal"]
    with suppress(OSError, ValueError, KeyError):
        limit = int((group / "memory.max").read_text())
        used = int((group / "memory.current").read_text())
        pairs = (line.split() for line in (group / "memory.stat").read_text().splitlines())
        # Files that were read some time ago are given up as soon as somebody needs the room.
        used -= {name: int(value) for name, value in pairs}["inactive_file"]
        free, total = min(free, max(0, limit - used)), min(total, limit)
    return free, total


def descriptor_limit() -> int:
    """Files and sockets that a process may have open."""
    import resource  # not on every system

    return resource.getrlimit(resource.RLIMIT_NOFILE)[0]


def activity(seconds: float, proc: Path = PROC) -> Activity:
    """Watch for so many s what other programs do; this thread sleeps meanwhile."""
    processors, before, idle_before = _ticks(proc)
    spent = dict(_spent(proc))
    time.sleep(seconds)
    _, after, idle_after = _ticks(proc)
    per_core = max(1.0, (after - before) / processors)
    busy = ((after - before) - (idle_after - idle_before)) / per_core
    used = {
        pid: (ticks - spent[pid]) / per_core
        for pid, ticks in _spent(proc)
        if pid in spent and pid != os.getpid()
    }
    busiest = max(used, key=lambda pid: used[pid], default=None)
    return Activity(
        processors,
        max(0.0, busy),
        None if busiest is None else Process(busiest, name(proc, busiest), used[busiest]),
    )


def _ticks(proc: Path) -> tuple[int, int, int]:
    """Processors, ticks of all of them together so far, and how many of these were idle."""
    lines = (proc / "stat").read_text().splitlines()
    # user nice system idle iowait irq softirq steal; guests are counted as users, too
    values = [int(text) for text in lines[0].split()[1:9]]
    processors = sum(line.startswith("cpu") and line[3:4].isdigit() for line in lines)
    return max(1, processors), sum(values), values[3] + values[4]


def _spent(proc: Path) -> Iterator[tuple[int, int]]:
    """Ticks that each program has used so far."""
    for pid in pids(proc):
        with suppress(OSError, ValueError, IndexError):
            # The name stands in brackets and may hold blanks and brackets.
            fields = (proc / str(pid) / "stat").read_text().rpartition(")")[2].split()
            yield pid, int(fields[11]) + int(fields[12])
