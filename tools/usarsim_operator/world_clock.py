"""How long the world has gone on, by the clock of the rules: what ages of reports count by."""

from __future__ import annotations

from collections.abc import Callable


class WorldClock:
    """Passes with the clock of the rules while the world goes, stands while that is paused.

    It never goes back, also where another clock counts from some moment on.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        """Begin at 0; now: s of the clock of the rules, asked when time is looked at."""
        self._now = now
        self._from: float | None = None
        self._passed = 0.0
        self._rate = 1.0

    @property
    def time(self) -> float:
        """s that the world has gone on since the first look."""
        now = self._now()
        if self._from is not None:
            self._passed += self._rate * max(0.0, now - self._from)
        self._from = now
        return self._passed

    def go_at(self, rate: float) -> None:
        """Pass at a rate from now on: 0 while the world is paused, below 1 where it is slowed."""
        _ = self.time
        self._rate = rate

    def restart(self) -> None:
        """Another clock counts from now on; what has passed stays."""
        self._from = None


def age(then: float, now: float) -> float:
    """s since a moment of the world's clock, never negative, at most 1e6 (also of never)."""
    return min(max(0.0, now - then), 1e6)
