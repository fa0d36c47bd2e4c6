"""A token bucket in wall time: a rate, and how much of it may be saved up or owed."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

Clock = Callable[[], float]
"""Seconds that never go back."""


class TokenBucket:
    """Tokens that come at a rate and pile up to a burst. For one thread."""

    __slots__ = ("_clock", "_then", "_tokens", "burst", "deepest", "rate")

    def __init__(
        self,
        rate: float,
        burst: float,
        *,
        start: float | None = None,
        deepest: float = math.inf,
        clock: Clock = time.monotonic,
    ) -> None:
        """Make a bucket.

        Args:
            rate: tokens per s; infinity means that there are always enough.
            burst: most tokens that it holds.
            start: tokens that it holds now; None for the burst.
            deepest: largest debt; what is taken beyond it is free.
            clock: see `Clock`.
        """
        self.rate, self.burst, self.deepest = rate, burst, deepest
        self._clock = clock
        self._tokens = burst if start is None else start
        self._then = clock()

    @property
    def tokens(self) -> float:
        """What it holds; below zero what is owed."""
        now = self._clock()
        if math.isinf(self.rate):
            return self.burst
        self._tokens = min(self.burst, self._tokens + (now - self._then) * self.rate)
        self._then = now
        return self._tokens

    def spend(self, amount: float = 1.0) -> float:
        """Take tokens, on credit if need be; returns s until the debt is paid, 0 without debt."""
        self._tokens = max(self.tokens - amount, -self.deepest)
        return 0.0 if self._tokens >= 0.0 or math.isinf(self.rate) else -self._tokens / self.rate

    def take(self, amount: float = 1.0) -> bool:
        """Take tokens if there are enough; whether there were."""
        if self.tokens < amount:
            return False
        self._tokens -= amount
        return True

    def draw(self, most: float) -> float:
        """Take what there is, up to an amount; returns how much."""
        drawn = min(most, max(0.0, self.tokens))
        self._tokens -= drawn
        return drawn

    def give(self, amount: float = 1.0) -> None:
        """Put tokens back."""
        self._tokens = min(self.burst, self.tokens + amount)
