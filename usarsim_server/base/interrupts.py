"""Ends the program soon after SIGINT (Ctrl-C) or SIGTERM, without a word, with the right exit code.

From `arm` on, which is the first thing that the program does, a signal

* ends the process at once while the command line is still being read;
* later raises `KeyboardInterrupt` in the main thread, once, so that temporary folders and child
  processes are tidied away; nothing more is written to standard error then;
* or, within `calling`, calls a function instead: a server closes its ports and stops its threads.

Whatever the program does then, it is over `GRACE` seconds after the first signal, unless it asked
for more. A thread waits for that; the system's signal handler wakes it through a pipe, so that it
does not need the main thread, which may be inside native code. Further signals change nothing.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

GRACE = 2.0
"""s of wall time from the first signal to the end of the process, come what may."""

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


class _State:
    """What has happened so far in this process.

    Attributes:
        first: the first signal that came, None before.
        raised: `KeyboardInterrupt` was raised for it.
        tidy: there may be something to tidy up; before, the process ends at once.
        ordinary: a signal is the ordinary end of this command.
        grace: s of wall time from the first signal to the end of the process.
    """

    grace = GRACE
    first: int | None = None
    raised = False
    tidy = False
    ordinary = False


_state = _State()


def arm(*, ordinary: bool) -> None:
    """Take over SIGINT and SIGTERM for the rest of this process. For the main thread.

    Args:
        ordinary: a signal is how this command ends when all is well: exit code 0. Otherwise it is
            128 and the number of the signal, as a shell would say: 130 or 143.
    """
    _state.ordinary = ordinary
    for number in _NUMBERS:
        signal.signal(number, _handle)
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    threading.Thread(target=_watch, args=(reading,), name="interrupts", daemon=True).start()


def begin() -> None:
    """The command begins its work: from now on a signal raises `KeyboardInterrupt`."""
    _state.tidy = True


def interrupted() -> bool:
    """Whether `KeyboardInterrupt` was raised by a signal; what else goes wrong is due to that."""
    return _state.raised


def finish(code: int) -> int:
    """The work is done: ends the process if a signal has come, otherwise returns the exit code.

    Signals that come while Python shuts down are ignored; it would give back their handlers.
    """
    _state.tidy = False
    if _state.first is None:
        for number in _NUMBERS:
            signal.signal(number, signal.SIG_IGN)
    if _state.first is not None:
        for stream in (sys.stdout, sys.stderr):
            with suppress(Exception):
                stream.flush()
        os._exit(_exit_code(_state.first) if _state.raised else code)
    return code


@contextmanager
def calling(action: Callable[[], object], grace: float = GRACE) -> Iterator[None]:
    """While inside, SIGINT and SIGTERM call a function, in the main thread, and raise nothing.

    Does nothing in other threads, which get no signals.

    Args:
        action: called at every signal.
        grace: s of wall time that the process gets from the first signal on.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def handle(number: int, frame: FrameType | None) -> None:
        if _state.first is None:
            _state.first = number
        action()

    usual, _state.grace = _state.grace, grace
    previous = [(number, signal.signal(number, handle)) for number in _NUMBERS]
    try:
        yield
    finally:
        _state.grace = usual
        for number, handler in previous:
            signal.signal(number, handler)


def _handle(number: int, frame: FrameType | None) -> None:
    if _state.first is not None:
        return
    _state.first = number
    if not _state.tidy:
        os._exit(_exit_code(number))
    _state.raised = True
    _mute()
    raise KeyboardInterrupt


def _mute() -> None:
    """Write nothing to standard error any more.

    An interrupt may strike where Python, or a library, cannot raise it further and prints a
    traceback instead.
    """
    with suppress(OSError):
        if os.isatty(2):
            os.write(2, b"\n")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def _watch(pipe: int) -> None:
    """Wait for the first signal, and for the end of its grace; then end the process."""
    while not set(_NUMBERS).intersection(found := os.read(pipe, 64)):
        pass
    time.sleep(_state.grace)
    number = next(one for one in found if one in _NUMBERS)
    with suppress(OSError):
        os.write(2, b"WARNING server ended while some of it was still busy\n")
    os._exit(_exit_code(number))


def _exit_code(number: int) -> int:
    return 0 if _state.ordinary else 128 + number
