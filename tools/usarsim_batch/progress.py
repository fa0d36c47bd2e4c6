"""Tells how far a batch is: on the terminal, or as JSON lines for other programs."""

from __future__ import annotations

import json
import sys
import time
from typing import Literal

Watch = Literal["auto", "terminal", "json"]
_TAIL = 5
"""Lines of the log of a run that failed."""


class Progress:
    """How many runs are over, how fast they come, and about how long the rest takes."""

    def __init__(self, count: int, done: int = 0, watch: Watch = "auto") -> None:
        """Begin to count.

        Args:
            count: of runs. done: those that were over before.
            watch: auto: a line on standard error, if that is a terminal; json: lines on
                standard output.
        """
        self._count, self._done, self._new, self._failed = count, done, 0, 0
        self._begun = time.monotonic()
        self._json = watch == "json"
        self._shown = watch == "terminal" or (watch == "auto" and sys.stderr.isatty())

    def tell(self, error: str, key: str, log: str = "") -> None:
        """One more is over; error: what went wrong. log: the end of what it said."""
        self._new += 1
        self._failed += bool(error)
        over = self._done + self._new
        rate = self._new / max(time.monotonic() - self._begun, 1e-9)
        rest = (self._count - over) / rate
        if error:
            self.clear()
            lines = [f"{key}: {error}", *(f"    {one}" for one in log.splitlines()[-_TAIL:])]
            print("\n".join(lines), file=sys.stderr)
        if self._json:
            told = {
                "run": key, "error": error, "over": over, "of": self._count,
                "failed": self._failed, "per_minute": round(60 * rate, 2), "rest_s": round(rest, 1),
            }  # fmt: skip
            print(json.dumps(told), flush=True)
        elif self._shown:
            pace = f"{60 * rate:.3g} a minute, ends in about {span(rest)}"
            print(
                f"\r\033[K{over} of {self._count} runs, {pace}",
                end="", file=sys.stderr, flush=True,
            )  # fmt: skip

    def clear(self) -> None:
        """Take the line away."""
        if self._shown:
            print("\r\033[K", end="", file=sys.stderr, flush=True)


def span(seconds: float) -> str:
    """A time for people."""
    if seconds >= 5400:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 60:.0f} min" if seconds >= 90 else f"{seconds:.0f} s"
