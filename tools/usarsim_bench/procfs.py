"""What a process and all programs of the machine use: two looks make a load."""

from __future__ import annotations

import time
from dataclasses import dataclass

import psutil

from usarsim_bench.errors import BenchError


@dataclass(frozen=True, slots=True)
class Usage:
    """A process and its machine at one moment."""

    wall: float
    """s, `time.perf_counter`."""
    cpu: float
    """s of processor time used so far, in user and system mode."""
    resident: int
    """Bytes of physical memory."""
    threads: int
    descriptors: int
    own_cpu: float
    """s of processor time that this very process has used so far."""
    busy: float
    """s of processor time that all programs of the machine have used so far."""


@dataclass(frozen=True, slots=True)
class Load:
    """Processors kept busy between two looks, in cores: by the process watched, by this very
    process, by everybody else."""

    process: float
    own: float
    others: float


def usage(pid: int) -> Usage:
    """Look at a process.

    Raises:
        BenchError: if there is no such process.
    """
    try:
        with (process := psutil.Process(pid)).oneshot():
            times = process.cpu_times()
            return Usage(
                wall=time.perf_counter(),
                cpu=times.user + times.system,
                resident=process.memory_info().rss,
                threads=process.num_threads(),
                descriptors=process.num_fds(),
                own_cpu=time.process_time(),
                busy=busy_seconds(),
            )
    except psutil.Error as error:
        raise BenchError(f"process {pid} is gone ({type(error).__name__})") from None


def busy_seconds() -> float:
    """Processor time of all programs, s; what guests used is in that of users already."""
    times = psutil.cpu_times()
    spare = sum(getattr(times, name, 0.0) for name in ("idle", "iowait", "guest", "guest_nice"))
    return float(sum(times) - spare)


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
    # Counted in ticks of 10 ms, so a quiet machine can come out slightly below zero.
    return Load(process, own, max(0.0, (after.busy - before.busy) / elapsed - process - own))
