"""What a connection can be in the world, and when it reports and answers, in simulated time."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence

from usarsim_server.protocol.requests import Request
from usarsim_server.protocol.values import Dialect
from usarsim_server.simulation.rays.query import PendingReport
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import Snapshot

TOLERANCE = 1e-6
"""s: a tick is at the step whose time rounds to its own."""


class LockstepTicks:
    """How far one client in lockstep lets the world go: the world stops at every tick until the
    client has answered.

    Not thread-safe, but `horizon` may be read by any thread.

    Attributes:
        horizon: time of the tick up to which the world may go; infinity if it need not wait.
        barred: what follows an answer, or the beginning, waits until the next tick has been told.
    """

    def __init__(self, period: float | None) -> None:
        """Wait for nothing.

        Args:
            period: simulated s between ticks; None without lockstep.
        """
        self._period = period
        self._told = True
        self.horizon = math.inf
        self.barred = False

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
        self._told, self.barred = False, True
        return True

    def end(self) -> None:
        """It has nothing there any more."""
        self.horizon, self._told, self.barred = math.inf, True, False

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
        self._told, self.barred = False, True
        return True


REPORT_GRID = 0.02
"""Simulated s between instants at which streams begin: a part of all usual intervals. So those of
many robots fall due together and are worked out together, in at most 50 batches a second."""
UNPACED_GRID = 0.1
"""The same where nobody waits for the clock: fewer and larger batches cost less."""


def first_report(asked: float, now: float, quiet: float, beat: float = REPORT_GRID) -> float:
    """When a robot reports first (simulated s): on a beat, about when the quiet period ends.

    Args:
        asked: time of INIT.
        now: time at which the robot is there; it reports later than that.
        quiet: s after INIT in which nothing is reported; the first report may come up to
            `REPORT_GRID` earlier.
        beat: s between the instants to choose from.
    """
    first = math.floor((asked + quiet - REPORT_GRID + TOLERANCE) / beat) + 1
    return max(first, math.floor((now + TOLERANCE) / beat) + 1) * beat


class Schedule:
    """The streams of one robot.

    Report number n of a stream is due at `start + n * interval`, so that times do not drift however
    the steps fall. The physics takes what is due at the very step at which it is due, so no report
    is ever skipped, unless a stream wants more reports than there are steps.

    Not thread-safe: whoever owns it keeps the physics and its own thread apart.

    Attributes:
        due: simulated time at which the next stream is due; infinity if none ever is. 0 before the
            first snapshot, which starts the clock.
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
        self.due = 0.0

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
        if self._begun:
            self.due = min(self._due, default=math.inf)

    def take_due(self, time: float) -> list[int]:
        """Indices of the streams that are due at a simulated time; each is moved on.

        None are at the first call, which begins all streams.
        """
        if not self._begun:
            self._begun = True
            start = self._first(time)
            self._starts = [start] * len(self._intervals)
            self._due = [start if interval > 0.0 else math.inf for interval in self._intervals]
            self.due = min(self._due, default=math.inf)
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
        self.due = min(self._due, default=math.inf)
        return taken


class Role(ABC):
    """What a connection is in the world: a robot, an avatar, a world controller.

    Deals with the requests of one connection; used by one thread at a time.

    Attributes:
        name: names it in the log.
        dialect: of everything it writes, at first that of the era that its class comes from.
            May be changed at any time, but not while the physics asks the schedule.
        slow: its requests may take long; they are carried out by a thread of their own then.
        body: whose snapshots it wants; None: it reports nothing.
        schedule: when it wants them; the physics takes from it what is due.
    """

    name: str
    dialect: Dialect
    slow = False
    body: BodyHandle | None = None
    schedule: Schedule | None = None

    @abstractmethod
    def obey(self, request: Request) -> list[str]:
        """Carry out a request; returns the reply lines."""

    def read(self, snapshot: Snapshot, due: Sequence[int]) -> PendingReport | None:
        """Begin the report that is due at a snapshot.

        Args:
            snapshot: the instant; never an earlier one than at the call before.
            due: what its schedule has said is due; nothing at the first snapshot.

        Returns:
            The report; None if there is nothing to tell.
        """
        return None

    def take_news(self) -> list[str]:
        """Lines that came up while reporting and must arrive, unlike streamed ones."""
        return []

    def halt(self) -> None:  # noqa: B027 (nothing is fine)
        """Come to rest where it is, as far as it moves by orders of its client."""

    def restart(self, time: float) -> None:  # noqa: B027
        """The world has been put back at a simulated time (s): what belongs to it stands where it
        came in, and has to begin anew."""

    @abstractmethod
    def leave(self) -> None:
        """Take everything that belongs to it out of the world; a second call does nothing."""
