"""Our own server in a process of its own, for `usarsim conformance --self`."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path

from usarsim_conformance.registry import SERVICES
from usarsim_record.closing import Closing

STAGE = Path(__file__).with_name("stage")
"""A world like the empty one with a few people far off, and robots with sensors of every type."""

_PORTS = ("", "image-", "groundtruth-", "wireless-", "comserver-", "truth-")
_MOST_ROBOTS = 32
_PATIENCE = 10.0
"""s to end after SIGTERM."""


class StartError(RuntimeError):
    """The server did not become ready; with what it said."""


class OwnServer(Closing):
    """`usarsim serve` on free ports; a context manager.

    Attributes:
        ports: of all services, by the names of `registry.SERVICES`.
    """

    def __init__(self, *options: str, folder: Path | None = None) -> None:
        """Start it and wait until it is ready.

        Args:
            options: further ones of `usarsim serve`.
            folder: where another copy of the server lies, to be taken instead of this one.

        Raises:
            StartError: if it does not become ready.
        """
        ports = [f"--{name}port=0" for name in _PORTS]
        command = [sys.executable, "-m", "usarsim_server.cli", "serve"]
        command += ["--world", str(STAGE / "world"), "--robots", str(STAGE / "robots")]
        # On a busy machine robots that have left may be counted a little longer.
        command += ["--max-robots", str(_MOST_ROBOTS)]
        self._errors = tempfile.TemporaryFile("w+")  # noqa: SIM115  (closed by `stop`)
        self._process = subprocess.Popen(
            [*command, *ports, *options],
            stdout=subprocess.PIPE,
            stderr=self._errors,
            text=True,
            cwd=folder,
            env=None if folder is None else {**os.environ, "PYTHONPATH": str(folder)},
        )
        assert self._process.stdout is not None
        ready = self._process.stdout.readline()
        found = {name: int(port) for name, port in re.findall(r"(\w+)=\S+:(\d+)", ready)}
        self.ports = {name: found[name] for name in SERVICES if name in found}
        if "control" not in self.ports:
            self._process.kill()
            self._process.wait()
            raise StartError(f"the server did not start: {self.said}")

    @property
    def said(self) -> str:
        """The end of what it wrote to standard error."""
        self._errors.seek(0)
        return self._errors.read()[-2000:].strip() or "it said nothing"

    @property
    def died(self) -> bool:
        """Whether it has ended by itself."""
        return self._process.poll() is not None

    def stop(self) -> None:
        """End it."""
        self._process.terminate()
        try:
            self._process.wait(_PATIENCE)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        assert self._process.stdout is not None
        self._process.stdout.close()
        self._errors.close()

    def close(self) -> None:
        """See `stop`."""
        self.stop()
