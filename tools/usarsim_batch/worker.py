"""A process that plays one run after the other, and is ended when a run takes too much.

`Worker` is the side that gives it runs; `python -m usarsim_batch.worker` is the process. It leads a
group of its own, which ends with the worker, and with who gives it runs.
"""

from __future__ import annotations

import faulthandler
import os
import pickle
import queue
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import IO, Any, NoReturn

import psutil

from usarsim_batch.tasks import Played, Run, T, failed
from usarsim_server.base.launch import python

_LOOK = 0.5
"""s between two looks at time and memory of a run."""
_PATIENCE = 300.0
"""s for a worker to import what a run needs."""
TAIL = 2000
"""Characters of a log that are kept."""


@dataclass(frozen=True)
class Limits:
    """What a run may take.

    Attributes:
        seconds: of wall time: who hangs may use no processor.
        memory: bytes, resident, of the worker and all that it has started.
    """

    seconds: float = 3600.0
    memory: int = 2 << 30


class Worker:
    """Plays runs, each in the same process as the one before if that came to its end.

    Attributes:
        limits: of each run.
    """

    def __init__(self, limits: Limits) -> None:
        self.limits = limits
        self._process: subprocess.Popen[bytes] | None = None
        self._log: IO[bytes] | None = None

    def play(self, run: Run[T], task: T, folder: str = "") -> Played:
        """Play a run; a process that ends, or is ended, makes it a failed one.

        Args:
            run: plays a task. task: the run. folder: where it is played; empty: here.
        """
        if self._process is None or self._process.poll() is not None:
            self._start()
        process, log = self._process, self._log
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        assert log is not None
        begin = log.seek(0, os.SEEK_END)
        what = folder or os.getcwd(), version("usarsim-server"), pickle.dumps((run, task))
        order = pickle.dumps(what)
        with suppress(OSError):  # it has died; its end is read next
            process.stdin.write(len(order).to_bytes(8, "big") + order)
            process.stdin.flush()
        why = self._watch(process, _PATIENCE)  # until it has all that it needs
        # Past the buffer: what follows in it would not be seen by `select`.
        if not why and os.read(process.stdout.fileno(), 1):
            why = self._watch(process, self.limits.seconds)
        if not why:
            try:
                played: Played | str = pickle.load(process.stdout)
            except (EOFError, OSError, pickle.UnpicklingError):
                why = f"its process ended with code {process.wait()}"
            else:
                return failed(task, played) if isinstance(played, str) else played
        self.close()
        log.seek(begin)
        return failed(task, why, log.read().decode(errors="replace")[-TAIL:].strip())

    def _watch(self, process: subprocess.Popen[bytes], seconds: float) -> str:
        """Wait until the process says something, or ends; or why it should be ended."""
        assert process.stdout is not None
        begun = time.monotonic()
        while not select.select([process.stdout], [], [], _LOOK)[0]:
            if time.monotonic() - begun > seconds:
                return f"took longer than {seconds:g} s (see --time-limit)"
            if _resident(process.pid) > self.limits.memory:
                return f"took more than {self.limits.memory >> 20} MiB (see --memory-limit)"
        return ""

    def end(self) -> None:
        """Kill the process and all that it has started; also from another thread."""
        process = self._process
        if process is not None and process.returncode is None:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)

    def close(self) -> None:
        """Kill it, and tidy up."""
        self.end()
        process, self._process = self._process, None
        if process is not None:
            process.wait()
            for pipe in filter(None, (process.stdin, process.stdout)):
                with suppress(OSError):
                    pipe.close()

    def _start(self) -> None:
        self.close()
        self._log = tempfile.TemporaryFile()  # noqa: SIM115  (closed when it is forgotten)
        self._process = subprocess.Popen(
            python("-m", "usarsim_batch.worker"),
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            start_new_session=True,
        )  # fmt: skip


def _resident(pid: int) -> int:
    """Bytes of a process and of all below it."""
    found = 0
    with suppress(psutil.Error):
        process = psutil.Process(pid)
        for one in (process, *process.children(recursive=True)):
            with suppress(psutil.Error):
                found += one.memory_info().rss
    return found


def main() -> NoReturn:
    """Play what comes in until nothing more does; whatever is printed goes to the log."""
    faulthandler.enable()
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    orders: queue.SimpleQueue[bytes] = queue.SimpleQueue()
    given = os.fdopen(os.dup(0), "rb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    threading.Thread(target=_listen, args=(given, orders), daemon=True).start()
    while True:
        folder, wanted, order = pickle.loads(orders.get())
        run, task, why = _prepare(folder, wanted, order)
        answers.write(b".")
        answers.flush()
        pickle.dump(why or run(task), answers)
        answers.flush()


def _prepare(folder: str, wanted: str, order: bytes) -> tuple[Any, Any, str]:
    """What plays, what is played, and why it cannot be played here."""
    if wanted != version("usarsim-server"):
        return None, None, f"a worker has version {version('usarsim-server')}, not {wanted}"
    if folder != os.getcwd():
        if not Path(folder).is_dir():
            cure = "cure: share it with all machines"
            return None, None, f"a worker has no folder {folder} ({cure})"
        os.chdir(folder)
    return *pickle.loads(order), ""


def _listen(given: IO[bytes], orders: queue.SimpleQueue[bytes]) -> None:
    """Hand orders on; when whoever gives them is gone, this process and its own are over."""
    with suppress(OSError):
        while header := given.read(8):
            orders.put(given.read(int.from_bytes(header, "big")))
    os.killpg(0, signal.SIGKILL)


if __name__ == "__main__":
    main()
