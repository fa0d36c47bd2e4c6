"""When a robot's streams are due, in simulated time."""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["BEAT", "Schedule", "Stream", "first_report"]

TOLERANCE = 1e-6
"""s: a stream is due at the step whose time rounds to its own."""
BEAT = 0.02
"""Simulated s between instants at which streams begin: a part of all usual intervals. So those of
many robots fall due together and are worked out together, in at most 50 batches a second."""


def first_report(asked: float, now: float, quiet: float) -> float:
    """When a robot reports first (simulated s): on a beat, as the quiet period ends or just before.

    Args:
        asked: time of INIT.
        now: time at which the robot is there.
        quiet: s after INIT in which nothing is reported; up to a beat less.
    """
    last = math.floor((asked + quiet + TOLERANCE) / BEAT)
    return max(last, math.ceil((now - TOLERANCE) / BEAT)) * BEAT


@dataclass(slots=True)
class Stream:
    """One periodic report.

    Attributes:
        interval: s between reports; 0 means only on request.
        start: simulated time of report number 0.
        count: number of the next report. Times are `start + count * interval`, so that they do
            not drift however the steps fall.
    """

    interval: float
    start: float = math.inf
    count: int = 0

    @property
    def due(self) -> float:
        """Simulated time of the next report; infinity if there is none."""
        return self.start + self.count * self.interval if self.interval > 0.0 else math.inf


class Schedule:
    """The streams of one robot; a stream that fell behind skips reports, it never queues them."""

    def __init__(self, intervals: list[float]) -> None:
        """Make one stream per interval (s); nothing is due before `begin`."""
        self._streams = [Stream(interval) for interval in intervals]

    @property
    def due(self) -> float:
        """Simulated time at which the next stream is due; infinity if none ever is."""
        return min((stream.due for stream in self._streams), default=math.inf)

    def begin(self, time: float) -> None:
        """Let all streams report first at a simulated time."""
        for stream in self._streams:
            stream.start, stream.count = time, 0

    def set_intervals(self, intervals: list[float]) -> None:
        """Change the intervals (s), in the order of the streams; unchanged ones keep their beat."""
        for stream, interval in zip(self._streams, intervals, strict=True):
            if interval == stream.interval:
                continue
            # The next report keeps its moment; the new beat is counted from there.
            if math.isfinite(stream.due):
                stream.start = stream.due
            stream.interval, stream.count = interval, 0

    def take_due(self, time: float) -> list[int]:
        """Indices of the streams that are due at a simulated time; each is moved on."""
        taken = []
        for index, stream in enumerate(self._streams):
            if stream.due <= time + TOLERANCE:
                passed = math.floor((time + TOLERANCE - stream.start) / stream.interval)
                stream.count = max(stream.count, passed) + 1
                taken.append(index)
        return taken
