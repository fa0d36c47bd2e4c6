"""Keeping simulated time beside wall time, and saying so when that fails."""

from __future__ import annotations

import logging
from dataclasses import dataclass

__all__ = ["PaceReport", "Pacer"]

MAX_LAG = 0.1
"""s of wall time that may be caught up; what is later than that is given up."""
REPORT_PERIOD = 5.0
"""s of wall time over which the real-time factor is taken."""
TOLERATED_FACTOR = 0.98


@dataclass(frozen=True, slots=True)
class PaceReport:
    """A line for the log."""

    level: int
    text: str


class Pacer:
    """Decides how long to wait before the next step. Pure: clocks are handed in.

    Args:
        speed: simulated seconds per wall second.
        simulated: simulated time now.
    """

    def __init__(self, speed: float, simulated: float) -> None:
        self._speed = speed
        self._simulated = simulated
        self._wall: float | None = None
        self._report_simulated = simulated
        self._report_wall = 0.0
        self._slow = False

    def wait(self, simulated: float, wall: float) -> float:
        """Wall seconds until the step that starts at a simulated time is due; 0 if it is."""
        if self._wall is None:
            self._wall = self._report_wall = wall
        deadline = self._wall + (simulated - self._simulated) / self._speed
        lag = wall - deadline
        if lag > MAX_LAG:
            # Simulated time slows down: the schedule starts anew from here.
            self._wall, self._simulated = wall - MAX_LAG, simulated
        return max(0.0, -lag)

    def report(self, simulated: float, wall: float) -> PaceReport | None:
        """A warning when real time is lost, and a line when it is found again."""
        elapsed = wall - self._report_wall
        if elapsed < REPORT_PERIOD:
            return None
        factor = (simulated - self._report_simulated) / elapsed
        self._report_simulated, self._report_wall = simulated, wall
        slow = factor < TOLERATED_FACTOR * self._speed
        was, self._slow = self._slow, slow
        text = f"real_time_factor={factor:.3f} asked={self._speed:g}"
        if slow:
            return PaceReport(logging.WARNING, f"simulated time is slow: {text}")
        return PaceReport(logging.INFO, f"simulated time is kept again: {text}") if was else None
