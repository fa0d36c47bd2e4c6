"""How fast time goes: when a step is due by the wall clock, and how long somebody is waited for."""

from __future__ import annotations

import math
from dataclasses import dataclass

from usarsim_server.base.logs import Log

MAX_LAG = 0.1
"""s of wall time that may be caught up; what is later than that is given up."""
REPORT_PERIOD = 5.0
"""s of wall time over which the real-time factor is taken."""
TOLERATED_FACTOR = 0.98

_log = Log("simulation")


@dataclass(frozen=True, slots=True)
class PaceReport:
    """How well simulated time was kept over the last period.

    Attributes:
        factor: simulated seconds per wall second reached. asked: the same asked for.
        slow: it fell behind (otherwise: it is kept again).
    """

    factor: float
    asked: float
    slow: bool

    def tell(self) -> None:
        """Log it."""
        if self.slow:
            _log.warning("simulated time is slow", real_time_factor=self.factor, asked=self.asked)
        else:
            _log.info("simulated time is kept again", real_time_factor=self.factor)


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

    def present(self, wall: float) -> float:
        """The simulated time that the clock stands at; never before the first `wait`."""
        since = 0.0 if self._wall is None else wall - self._wall
        return self._simulated + since * self._speed

    def moment(self, simulated: float) -> float:
        """The wall time at which the clock stands at a simulated time; minus infinity before the
        first `wait`."""
        if self._wall is None:
            return -math.inf
        return self._wall + (simulated - self._simulated) / self._speed

    def report(self, simulated: float, wall: float) -> PaceReport | None:
        """A report when real time is lost, and one when it is found again; None otherwise."""
        elapsed = wall - self._report_wall
        if elapsed < REPORT_PERIOD:
            return None
        factor = (simulated - self._report_simulated) / elapsed
        self._report_simulated, self._report_wall = simulated, wall
        slow = factor < TOLERATED_FACTOR * self._speed
        was, self._slow = self._slow, slow
        if not slow and not was:
            return None
        return PaceReport(round(factor, 3), self._speed, slow)


class Patience:
    """How long to wait for somebody. Pure: clocks are handed in.

    Args:
        limit: s of wall time; infinity for ever.
    """

    def __init__(self, limit: float) -> None:
        self._limit = limit
        self._since: float | None = None

    def relax(self) -> None:
        """What was waited for has come."""
        self._since = None

    def lost(self, wall: float) -> bool:
        """Whether it has been waited for too long, at a wall time (s); if so, waiting starts anew.

        The first call after `relax` starts the clock.
        """
        if self._since is None:
            self._since = wall
        if wall - self._since < self._limit:
            return False
        self._since = None
        return True
