"""A progress bar for people at a terminal; silent everywhere else."""

from __future__ import annotations

import sys
import time
from typing import Self, TextIO

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
