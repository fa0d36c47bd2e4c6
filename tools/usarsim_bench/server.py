"""A server in a process of its own, known only by its ports and by what Linux says of it."""

from __future__ import annotations

import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence

from usarsim_bench.closing import CarefulClosing
from usarsim_bench.errors import BenchError
from usarsim_bench.procfs import Usage, usage

SERVE = ("usarsim_server.cli", "serve")
"""Module and arguments that run the plain server."""

_SIDE_CHANNELS = ("image", "groundtruth", "wireless", "truth")
_STOP_TIMEOUT = 10.0
_SHOWN_ERRORS = 2000


class Server(CarefulClosing):
    """A running server; leave it as a context manager, or with `stop`.

    Attributes:
        port: of robot control.
        ports: of all services that listen, by the name on the READY line.
        pid: of its process.
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
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115  (closed by `stop`)
        self._process = subprocess.Popen(
            [
                sys.executable,
                "-m",
                *command,
                *("--port", "0", "--world", world, "--max-robots", str(max_robots)),
                *channels,
            ],
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
        )
        self.pid = self._process.pid
        assert self._process.stdout is not None
        ready = self._process.stdout.readline()
        found = re.findall(r"(\w+)=\S+:(\d+)", ready)
        self.ports = {name: int(port) for name, port in found}
        if not ready.startswith("READY") or "control" not in self.ports:
            self._process.kill()
            self._process.wait()
            raise BenchError(f"the server did not start: {self._said()}")
        self.port = self.ports["control"]

    def usage(self) -> Usage:
        """What it uses at this moment.

        Raises:
            BenchError: if it has died; with what it said.
        """
        if self._process.poll() is not None:
            raise BenchError(f"the server died: {self._said()}")
        return usage(self.pid)

    def stop(self) -> None:
        """End it; a second call does nothing.

        Raises:
            BenchError: if it had to be killed or ended with an error.
        """
        if self._errors.closed:
            return
        self._process.terminate()
        try:
            code = self._process.wait(_STOP_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            code = self._process.wait()
        said = self._said()
        self._errors.close()
        assert self._process.stdout is not None
        self._process.stdout.close()
        if code != 0:
            raise BenchError(f"the server ended with code {code}: {said}")

    def _said(self) -> str:
        self._errors.seek(0)
        return self._errors.read()[-_SHOWN_ERRORS:].strip() or "it said nothing"

    def close(self) -> None:
        """See `stop`."""
        self.stop()
