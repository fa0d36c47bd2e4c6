"""A server in a process of its own, known only by its ports and by what it uses of the machine.

Beside that what all measurements share: the one error of this package, and the processor time and
memory of a process.
"""

from __future__ import annotations

import re
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass

import psutil

from usarsim_client import Closing
from usarsim_server.base.launch import python


class BenchError(RuntimeError):
    """A measurement could not be taken; says why."""


class CarefulClosing(Closing):
    """Something whose closing may find a fault of its own."""

    def __exit__(self, *raised: object) -> None:
        try:
            self.close()
        except BenchError:
            # What went wrong first says more.
            if not any(raised):
                raise


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


SERVE = ("usarsim_server.cli", "serve")
"""Module and arguments that run the plain server."""

_SIDE_CHANNELS = ("image", "groundtruth", "wireless", "truth")
_STOP_TIMEOUT = 10.0
_SHOWN_ERRORS = 2000


class Program(CarefulClosing):
    """A Python module that runs in a process of its own, and says on standard output when it is
    ready.

    Attributes:
        pid: of its process.
    """

    def __init__(self, what: str, command: Sequence[str], stops_within: float) -> None:
        """Start it.

        Args:
            what: it is, for people. command: module, and its arguments.
            stops_within: s of wall time until one that was told to end is killed.
        """
        self._what, self._stops_within = what, stops_within
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115  (closed by `close`)
        self._process = subprocess.Popen(
            python("-m", *command), stdout=subprocess.PIPE, stderr=self._errors, text=True
        )
        self.pid = self._process.pid

    def usage(self) -> Usage:
        """What it uses at this moment.

        Raises:
            BenchError: if it has died; with what it said.
        """
        if self._process.poll() is not None:
            raise BenchError(f"{self._what} died: {self._said()}")
        return usage(self.pid)

    def close(self) -> None:
        """End it; a second call does nothing.

        Raises:
            BenchError: if it had to be killed or ended with an error.
        """
        if self._errors.closed:
            return
        self._process.terminate()
        try:
            code = self._process.wait(self._stops_within)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        said = self._said()
        self._errors.close()
        assert self._process.stdout is not None
        self._process.stdout.close()
        if code != 0:
            raise BenchError(f"{self._what} ended with code {code}: {said}")

    def _line(self) -> str:
        """The next line of its standard output; empty at its end."""
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def _said(self) -> str:
        self._errors.seek(0)
        return self._errors.read()[-_SHOWN_ERRORS:].strip() or "it said nothing"


class Server(Program):
    """A running server.

    Attributes:
        port: of robot control.
        ports: of all services that listen, by the name on the READY line.
    """

    def __init__(self, world: str, max_robots: int, command: Sequence[str] = SERVE) -> None:
        """Start it and wait until it is ready.

        All services listen, on free ports, so that other servers of the machine do not matter.

        Args:
            world: name or folder.
            max_robots: robots at the same time.
            command: module to run and its first arguments.

        Raises:
            BenchError: if it does not become ready; with what it said.
        """
        channels = [text for name in _SIDE_CHANNELS for text in (f"--{name}-port", "0")]
        options = ("--port", "0", "--world", world, "--max-robots", str(max_robots))
        super().__init__("the server", (*command, *options, *channels), _STOP_TIMEOUT)
        ready = self._line()
        found = re.findall(r"(\w+)=\S+:(\d+)", ready)
        self.ports = {name: int(port) for name, port in found}
        if not ready.startswith("READY") or "control" not in self.ports:
            self._process.kill()
            self._process.wait()
            raise BenchError(f"the server did not start: {self._said()}")
        self.port = self.ports["control"]

    def port_of(self, service: str) -> int:
        """Where a service listens, by its name on the READY line.

        Raises:
            BenchError: if it does not.
        """
        if service not in self.ports:
            raise BenchError(f"the server has no {service}")
        return self.ports[service]
