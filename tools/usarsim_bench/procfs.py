"""What Linux says about a process and about the machine; nothing has to be installed for it."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

from usarsim_bench.errors import BenchError

_TICK = 1.0 / os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")
_USER, _SYSTEM, _THREADS, _RESIDENT = 11, 12, 17, 21
"""Places in /proc/PID/stat, counted after the command name (proc(5), fields 14, 15, 20, 24)."""
_IDLE, _WAITING = 3, 4
"""Places in the cpu line of /proc/stat that are not work (proc(5): idle and iowait)."""
_COUNTED = 8
"""Further places repeat what guests used and user already contains."""


@dataclass(frozen=True, slots=True)
class Usage:
    """A process and its machine at one moment.

    Attributes:
        wall: s, as `time.perf_counter`.
        cpu: s of processor time used so far, in user and system mode.
        resident: bytes of physical memory.
        threads, descriptors: how many it has.
        own_cpu: s of processor time that this very process has used so far.
        busy: s of processor time that all programs of the machine have used so far; None if the
            system does not say.
    """

    wall: float
    cpu: float
    resident: int
    threads: int
    descriptors: int
    own_cpu: float
    busy: float | None


@dataclass(frozen=True, slots=True)
class Load:
    """Processors kept busy between two moments, in cores.

    Attributes:
        process: by the process watched.
        own: by this very process.
        others: by everybody else; None if the system does not say.
    """

    process: float
    own: float
    others: float | None


def usage(pid: int) -> Usage:
    """Look at a process.

    Raises:
        BenchError: if there is no such process.
    """
    folder = Path("/proc", str(pid))
    try:
        # The command name may contain blanks and parentheses; what follows the last one is fixed.
        fields = (folder / "stat").read_text().rpartition(")")[2].split()
        descriptors = len(os.listdir(folder / "fd"))
    except OSError as error:
        raise BenchError(f"process {pid} is gone ({error.strerror})") from None
    return Usage(
        wall=time.perf_counter(),
        cpu=(int(fields[_USER]) + int(fields[_SYSTEM])) * _TICK,
        resident=int(fields[_RESIDENT]) * _PAGE,
        threads=int(fields[_THREADS]),
        descriptors=descriptors,
        own_cpu=time.process_time(),
        busy=_busy(),
    )


def busy_seconds(cpu_line: str) -> float:
    """Processor time of all programs from the first line of /proc/stat, s."""
    ticks = [int(word) for word in cpu_line.split()[1 : 1 + _COUNTED]]
    return (sum(ticks) - ticks[_IDLE] - ticks[_WAITING]) * _TICK


def load_between(before: Usage, after: Usage) -> Load:
    """Who used the processors between two looks.

    Raises:
        ValueError: if no time passed between them.
    """
    elapsed = after.wall - before.wall
    if elapsed <= 0.0:
        raise ValueError("a load needs two moments")
    process = (after.cpu - before.cpu) / elapsed
    own = (after.own_cpu - before.own_cpu) / elapsed
    if before.busy is None or after.busy is None:
        return Load(process, own, None)
    # Counted in ticks of 10 ms, so a quiet machine can come out slightly below zero.
    others = max(0.0, (after.busy - before.busy) / elapsed - process - own)
    return Load(process, own, others)


def _busy() -> float | None:
    try:
        with open("/proc/stat") as file:
            return busy_seconds(file.readline())
    except (OSError, ValueError, IndexError):
        return None
