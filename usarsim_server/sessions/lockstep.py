"""Lockstep as one client sees it: the world stops at every tick until the client has answered."""

from __future__ import annotations

import math

TOLERANCE = 1e-6
"""s: a tick is at the step whose time rounds to its own."""


class Ticks:
    """How far one client lets the world go, in simulated time.

    Not thread-safe, but `horizon` may be read by any thread.

    Attributes:
        horizon: time of the tick up to which the world may go; infinity if it need not wait.
    """

    def __init__(self, period: float | None) -> None:
        """Wait for nothing.

        Args:
            period: simulated s between ticks; None without lockstep.
        """
        self._period = period
        self._told = True
        self.horizon = math.inf

    @property
    def due(self) -> float:
        """Time of the tick that the client is still to be told of; infinity if there is none."""
        return math.inf if self._told else self.horizon

    def begin(self, now: float) -> bool:
        """The client has something in the world: that waits for it at the next tick, or now.

        Returns:
            Whether it does: False without lockstep.
        """
        if self._period is None:
            return False
        self.horizon = math.ceil((now - TOLERANCE) / self._period) * self._period
        self._told = False
        return True

    def end(self) -> None:
        """It has nothing there any more."""
        self.horizon, self._told = math.inf, True

    def let_go(self) -> bool:
        """Do not wait for it until it answers again; whether it was waited for."""
        waited = not math.isinf(self.horizon)
        self.end()
        return waited

    def passes(self, now: float) -> bool:
        """Whether the client is to be told that a tick has passed; it is told once."""
        if self._told or now < self.horizon - TOLERANCE:
            return False
        self._told = True
        if self._period is not None:  # who came late need not answer the ticks that he missed
            last = math.floor((now + TOLERANCE) / self._period) * self._period
            self.horizon = max(self.horizon, last)
        return True

    def answer(self, ticks: int, now: float) -> bool:
        """The client lets so many further ticks pass; False without lockstep."""
        if self._period is None:
            return False
        if math.isinf(self.horizon):
            self.begin(now)
        self.horizon = (round(self.horizon / self._period) + ticks) * self._period
        self._told = False
        return True
