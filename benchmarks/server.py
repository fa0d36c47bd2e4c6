"""A server in a process of its own, known only by its ports and by what it uses of the machine."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import psutil

from usarsim_bench.figures import BenchError
from usarsim_client import Closing
from usarsim_server.base.launch import SERVE, OwnServer, Program

_SIDE_CHANNELS = ("image", "groundtruth", "wireless", "truth")


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


class CarefulClosing(Closing):
    """Something whose closing may find a fault of its own."""

    def __exit__(self, *raised: object) -> None:
        try:
            self.close()
        except BenchError:
            # What went wrong first says more.
            if not any(raised):
                raise


class Measured(CarefulClosing, Program):
    """A program that is looked at while it runs, and has to end without an error."""

    def usage(self) -> Usage:
        """What it uses at this moment.

        Raises:
            BenchError: if it has died; with what it said.
        """
        if self.died:
            raise BenchError(f"{self.what} died: {self.said}")
        return usage(self.process.pid)

    def close(self) -> None:
        """End it; a second call does nothing.

        Raises:
            BenchError: if it had to be killed or ended with an error.
        """
        first, code = not self.closed, self.end()
        self.closed = True
        if first and code != 0:
            raise BenchError(f"{self.what} ended with code {code}: {self.said}")

    closed = False


class Server(Measured, OwnServer):
    """A running server, all of whose services listen, on free ports.

    Attributes:
        port: of robot control.
    """

    def __init__(
        self, world: str, max_robots: int, *options: str, serve: Sequence[str] = SERVE
    ) -> None:
        """Start it and wait until it is ready.

        Args:
            world: name or folder. max_robots: robots at the same time.
            options: further ones of `usarsim serve`. serve: see `OwnServer`.

        Raises:
            LaunchError: if it does not become ready; with what it said.
        """
        words = [f"--world={world}", f"--max-robots={max_robots}"]
        words += [f"--{name}-port=0" for name in _SIDE_CHANNELS]
        super().__init__(*words, *options, serve=serve)
        self.port = self.ports["control"]

    def port_of(self, service: str) -> int:
        """Where a service listens, by its name on the READY line.

        Raises:
            BenchError: if it does not.
        """
        if service not in self.ports:
            raise BenchError(f"the server has no {service}")
        return self.ports[service]
