"""Starts programs of this product in processes of their own, reads what they say, and ends them.

Python looks for modules in the folder that one works in when a program is started by `-m` or `-c`.
A `pickle.py` or `mujoco.py` that lies there would be run instead of the real module. All programs
of the product are therefore started with `-P`; `PYTHONPATH` holds for them as for the parent.
"""

from __future__ import annotations

import os
import queue
import re
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import IO

from usarsim_server.base.closing import Closing
from usarsim_server.base.errors import UsarsimError, at
from usarsim_server.base.files import reason

PATIENCE = 120.0
"""s of wall time that a server has to begin; a map may have to be imported."""
_TIED = (
    "import ctypes, os, sys\n"
    "try: ctypes.CDLL(None).prctl(1, 15)\n"
    "except (OSError, AttributeError): pass\n"
    "os.execv(sys.executable, [sys.executable, *sys.argv[1:]])\n"
)
"""Becomes the program in its arguments; prctl(2), PR_SET_PDEATHSIG."""
_SAFE = "PYTHONSAFEPATH"
_KEPT = 2000
"""Lines of a program that are kept, the last ones."""
_LONGEST = 4096
"""Characters of a line; what is longer counts as several."""
_UNREAD = 100
"""Lines on standard output that wait for who reads them; later ones are only kept."""
_SHOWN = 2000
"""Characters of what a program said that stand in an error."""
_REST = 1.0
"""s of wall time in which the last lines of a program that has ended are read."""
SERVE = ("usarsim_server", "serve")
"""The module that serves, and its first words."""
_SIDE = ("image", "groundtruth", "wireless", "truth", "comserver", "scene")
"""Names of the options for ports but that of robot control."""


def python(*words: str, tied: bool = False) -> list[str]:
    """The command line of a Python program, without the modules of the folder one works in.

    Args:
        words: of the command line after the interpreter, such as `-m` and a module.
        tied: the program gets SIGTERM when the thread that starts it ends, however it ends (on
            Linux).
    """
    command = [sys.executable, "-P", *words]
    return [sys.executable, "-P", "-c", _TIED, *command[1:]] if tied else command


@contextmanager
def safe_pool() -> Iterator[None]:
    """Lets processes of `multiprocessing` that are started inside leave that folder alone, too."""
    before = os.environ.get(_SAFE)
    os.environ[_SAFE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE]
        else:
            os.environ[_SAFE] = before


class LaunchError(UsarsimError):
    """A program cannot be started, or ended too early; with what it said."""


class Program(Closing):
    """A program in a process of its own, and the last lines that it wrote; a context manager.

    It leads a session of its own: Ctrl-C is for who started it, and what it starts ends with it.

    Attributes:
        process: the process.
        ended: gets its exit code; for programs with an event loop, too (`asyncio.wrap_future`).
    """

    grace = 10.0
    """s of wall time from SIGTERM to SIGKILL."""

    def __init__(
        self,
        what: str,
        command: Sequence[str],
        *,
        folder: Path | None = None,
        more: Mapping[str, str] | None = None,
        log: IO[bytes] | None = None,
        announces: bool = True,
    ) -> None:
        """Start it.

        Args:
            what: it is, for people: "the server".
            command: program and arguments.
            folder: in which it runs.
            more: variables of its environment beside ours.
            log: takes what it writes to standard error instead of us.
            announces: its standard output is for us, too; otherwise for the log.

        Raises:
            LaunchError: if it cannot be started.
        """
        self.what = what
        try:
            self.process = subprocess.Popen(
                command,
                cwd=folder,
                env={**os.environ, **(more or {})},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE if announces or log is None else log,
                stderr=subprocess.PIPE if log is None else log,
                encoding="utf-8",
                errors="replace",
                start_new_session=True,
            )
        except (OSError, ValueError) as error:
            why = reason(error) if isinstance(error, OSError) else str(error)
            cure = "check its path and rights"
            raise LaunchError(at(command[0], f"cannot be started: {why}", cure)) from None
        self.ended: Future[int] = Future()
        self.ended.set_running_or_notify_cancel()  # who no longer waits for it cancels nothing
        self._kept: deque[str] = deque(maxlen=_KEPT)
        self._announced: queue.Queue[str] = queue.Queue(_UNREAD)
        streams = [one for one in (self.process.stdout, self.process.stderr) if one is not None]
        readers = [threading.Thread(target=self._read, args=(one,), daemon=True) for one in streams]
        for one in (*readers, threading.Thread(target=self._follow, args=(readers,), daemon=True)):
            one.start()

    @property
    def errors(self) -> str:
        """What it wrote so far; of much, the last lines."""
        return "".join(tuple(self._kept))

    @property
    def said(self) -> str:
        """The end of what it wrote, for an error."""
        return self.errors[-_SHOWN:].strip() or "it said nothing"

    @property
    def died(self) -> bool:
        """Whether it has ended."""
        return self.process.poll() is not None

    def line(self, patience: float = PATIENCE) -> str:
        """The next line of its standard output; empty at the end.

        Raises:
            LaunchError: if that takes longer than so many s of wall time.
        """
        try:
            return self._announced.get(timeout=patience)
        except queue.Empty:
            raise LaunchError(f"{self.what} said nothing within {patience:g} s") from None

    def announced(
        self, pattern: str, lines: int = 1, patience: float = PATIENCE
    ) -> list[re.Match[str]]:
        """What its first lines say.

        Args:
            pattern: each of them begins like that. lines: how many. patience: s for each.

        Raises:
            LaunchError: if it says something else, or nothing in time; it is ended then.
        """
        found: list[re.Match[str]] = []
        try:
            while len(found) < lines:
                if (match := re.match(pattern, self.line(patience))) is None:
                    self.end()  # then all that it said has been read
                    raise LaunchError(f"{self.what} did not start: {self.said}")
                found.append(match)
        except BaseException:
            self.end()
            raise
        return found

    def end(self, how: signal.Signals = signal.SIGTERM) -> int:
        """End it and what it has started; returns its exit code.

        Args:
            how: it is told. If it does not end in time it is killed.
        """
        if not self.died:
            self._signal(how)
            try:
                self.process.wait(self.grace)
            except subprocess.TimeoutExpired:
                self._signal(signal.SIGKILL)
        return self.ended.result()

    def close(self) -> None:
        """End it; a second call does nothing."""
        self.end()

    def _signal(self, how: signal.Signals) -> None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, how)

    def _read(self, stream: IO[str]) -> None:
        waits = stream is self.process.stdout
        with stream:
            for line in iter(partial(stream.readline, _LONGEST), ""):
                self._kept.append(line)
                if waits and not self._announced.full():
                    self._announced.put(line)
        if waits and not self._announced.full():
            self._announced.put("")

    def _follow(self, readers: Sequence[threading.Thread]) -> None:
        code = self.process.wait()
        self._signal(signal.SIGKILL)  # what it has started; at once, while its number is not reused
        for one in readers:
            one.join(_REST)
        self.ended.set_result(code)


class OwnServer(Program):
    """`usarsim serve`, which ends with the thread that started it; a context manager.

    Attributes:
        ports: of its services, by their names on the READY line, once that was read.
    """

    def __init__(
        self,
        *options: str,
        folder: Path | None = None,
        more: Mapping[str, str] | None = None,
        log: IO[bytes] | None = None,
        serve: Sequence[str] = SERVE,
        waits: bool = True,
    ) -> None:
        """Start it, with robot control on a free port and no other one open, unless options say so.

        Args:
            options: of `usarsim serve`. folder, more, log: see `Program`.
            serve: a module that serves as `SERVE` does, and its first words.
            waits: until it is ready; otherwise call `wait`.

        Raises:
            LaunchError: if it does not become ready; with what it said.
        """
        ports = ("--port=0", *(f"--{name}-port=off" for name in _SIDE))
        command = python("-m", *serve, *ports, *options, tied=True)
        super().__init__("the server", command, folder=folder, more=more, log=log)
        self.ports: dict[str, int] = {}
        if waits:
            self.wait()

    def wait(self, patience: float = PATIENCE) -> None:
        """Wait until it is ready.

        Raises:
            LaunchError: if it does not become ready; with what it said.
        """
        [ready] = self.announced("READY control=.*", patience=patience)
        pairs = re.findall(r"(\w+)=\S+:(\d+)", ready[0])
        self.ports = {name: int(port) for name, port in pairs}
