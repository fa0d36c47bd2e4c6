"""What a terminal shows of an import: a progress bar, and nothing of what libraries have to say."""

from __future__ import annotations

import contextlib
import logging
import sys
import time
import warnings
from collections.abc import Iterator
from typing import Self, TextIO

import mujoco

from usarsim_server.base.logs import ROOT, Log

_log = Log("import")


def _told(text: str) -> None:
    _log.debug(" ".join(text.split()), source="mujoco")


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Log at `debug` what Python warns of, what loggers without handler say, and what MuJoCo does.

    What it means for the map is in the report: what was left out, and what is missing. Filters of
    warnings stay as they are, so those that are errors in tests still are.
    """
    handler = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_told)
    last = logging.lastResort
    logging.lastResort = _Passing(last)
    try:
        with warnings.catch_warnings(record=True) as caught:
            yield
        for one in caught:
            text = f"{one.category.__name__}: {one.message}"
            _log.debug(" ".join(text.split()), source=one.filename)
    finally:
        logging.lastResort = last
        mujoco.set_mju_user_warning(handler)


class _Passing(logging.Handler):
    """The handler of last resort for the program's own lines only."""

    def __init__(self, last: logging.Handler | None) -> None:
        super().__init__(logging.WARNING)
        self._last = last

    def emit(self, record: logging.LogRecord) -> None:
        """Pass a line of the program's own on."""
        if self._last is not None and record.name.partition(".")[0] == ROOT:
            self._last.handle(record)


WIDTH = 30
PATIENCE = 0.3
"""s before anything is drawn: most imports are over by then."""
PERIOD = 0.1


class ProgressBar:
    """Draws `[######......] brushes 42 %` on one line, which is gone at the end.

    Use as a context manager and call with what is being done and the part that is done.
    """

    def __init__(self, stream: TextIO | None = None) -> None:
        self._stream = sys.stderr if stream is None else stream
        self._shown = False
        self._began = self._last = time.monotonic()

    def __call__(self, step: str, part: float) -> None:
        """Show the state, if it is time to."""
        now = time.monotonic()
        if not self._stream.isatty() or now - self._began < PATIENCE:
            return
        if now - self._last < PERIOD:
            return
        self._last, self._shown = now, True
        part = min(1.0, max(0.0, part))
        done = round(part * WIDTH)
        bar = "#" * done + "." * (WIDTH - done)
        self._stream.write(f"\r[{bar}] {step[:30]:<30} {part:4.0%}")
        self._stream.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._stream.write("\r" + " " * (WIDTH + 42) + "\r")
            self._stream.flush()
