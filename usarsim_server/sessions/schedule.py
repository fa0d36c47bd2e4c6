"""When a robot's streams are due, in simulated time."""

from __future__ import annotations

import math
from collections.abc import Callable

__all__ = ["BEAT", "UNPACED_BEAT", "Schedule", "first_report"]

TOLERANCE = 1e-6
"""s: a stream is due at the step whose time rounds to its own."""
BEAT = 0.02
"""Simulated s between instants at which streams begin: a part of all usual intervals. So those of
many robots fall due together and are worked out together, in at most 50 batches a second."""
UNPACED_BEAT = 0.1
"""The same where nobody waits for the clock: fewer and larger batches cost less."""


def first_report(asked: float, now: float, quiet: float, beat: float = BEAT) -> float:
    """When a robot reports first (simulated s): on a beat, about when the quiet period ends.

    Args:
        asked: time of INIT.
        now: time at which the robot is there; it reports later than that.
        quiet: s after INIT in which nothing is reported; the first report may come up to
            `BEAT` earlier.
        beat: s between the instants to choose from.
    """
    first = math.floor((asked + quiet - BEAT + TOLERANCE) / beat) + 1
    return max(first, math.floor((now + TOLERANCE) / beat) + 1) * beat


class Schedule:
    """The streams of one robot.

    Report number n of a stream is due at `start + n * interval`, so that times do not drift however
    the steps fall. The physics takes what is due at the very step at which it is due, so no report
    is ever skipped, unless a stream wants more reports than there are steps.

    Not thread-safe: whoever owns it keeps the physics and its own thread apart.
    """

    def __init__(self, intervals: list[float], first: Callable[[float], float]) -> None:
        """Make one stream per interval (s; 0 reports on request only).

        Args:
            intervals: s between two reports of each stream.
            first: says when all streams report first (simulated s), given the time of the first
                snapshot, which is due at once.
        """
        self._intervals = list(intervals)
        self._first = first
        self._begun = False
        self._starts = [math.inf] * len(intervals)
        # Looked at far more often than changed.
        self._due = [math.inf] * len(intervals)

    @property
    def due(self) -> float:
        """Simulated time at which the next stream is due; infinity if none ever is.

        0 before the first snapshot, which starts the clock.
        """
        return min(self._due, default=math.inf) if self._begun else 0.0

    def set_intervals(self, intervals: list[float]) -> None:
        """Change the intervals (s), in the order of the streams; unchanged ones keep their beat."""
        for index, (old, new) in enumerate(zip(self._intervals, intervals, strict=True)):
            if new == old:
                continue
            # The next report keeps its moment; the new beat is counted from there.
            if math.isfinite(self._due[index]):
                self._starts[index] = self._due[index]
            self._due[index] = self._starts[index] if new > 0.0 else math.inf
        self._intervals = list(intervals)

    def take_due(self, time: float) -> list[int]:
        """Indices of the streams that are due at a simulated time; each is moved on.

        None are at the first call, which begins all streams.
        """
        if not self._begun:
            self._begun = True
            start = self._first(time)
            self._starts = [start] * len(self._intervals)
            self._due = [start if interval > 0.0 else math.inf for interval in self._intervals]
            return []
        limit = time + TOLERANCE
        taken = [index for index, due in enumerate(self._due) if due <= limit]
        for index in taken:
            start, interval = self._starts[index], self._intervals[index]
            number = max(
                math.floor((limit - start) / interval),
                round((self._due[index] - start) / interval),
            )
            self._due[index] = start + (number + 1) * interval
        return taken
