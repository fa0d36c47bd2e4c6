"""What a connection can be: the conductor of a robot, or something else that obeys and reports.

When a robot's streams are due, in simulated time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol

from usarsim_server.logs import Log
from usarsim_server.protocol.requests import Init, Request
from usarsim_server.protocol.values import Dialect
from usarsim_server.simulation.clock import Listener
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.cast import RayQuery
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import Snapshot

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


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """A report under way: its rays are still to be cast.

    Attributes:
        query: the rays; none for most that are no robots.
        lines: writes the streamed lines, given the answers to the fans of the query, in order.
    """

    query: RayQuery
    lines: Callable[[Sequence[RayHits]], list[str]]


class Role(Protocol):
    """Deals with the requests of one connection; used by one thread at a time."""

    dialect: Dialect
    """Of everything it writes; may be changed at any time."""
    slow: bool
    """Whether its requests may take long; they are carried out by a thread of their own then."""

    @property
    def schedule(self) -> Schedule | None:
        """When it wants snapshots; None for never.

        The physics takes from it what is due. Setting `dialect` changes it, so that must not happen
        at the same time.
        """

    def obey(self, request: Request) -> list[str]:
        """Carry out a request; returns the reply lines."""

    def read(self, snapshot: Snapshot, due: Sequence[int]) -> Reading | None:
        """Begin the report that is due at a snapshot.

        Args:
            snapshot: the instant; never an earlier one than at the call before.
            due: what its schedule has said is due; nothing at the first snapshot.

        Returns:
            The report; None if there is nothing to tell.
        """

    def take_news(self) -> list[str]:
        """Lines that came up while reporting and must arrive."""


@dataclass(frozen=True, slots=True, eq=False)
class Casting:
    """A role that a connection has been given.

    Attributes:
        role: the role.
        name: names it in the log.
        dialect: of the era that its class comes from.
        leave: takes everything that belongs to it out of the world; called by whoever
            serves the connection.
        attach: has a listener woken with snapshots; None if it wants none.
    """

    role: Role
    name: str
    dialect: Dialect
    leave: Callable[[], None]
    attach: Callable[[Listener], None] | None = None


RoleFactory = Callable[[Init, Pose, Log], Casting | None]
"""Makes the role that INIT asks for, at the pose it means; None if it asks for a robot.

Raises `UsarsimError` if the role cannot be played.
"""


def robots_only(init: Init, pose: Pose, log: Log) -> Casting | None:
    """The factory of a server that knows robots and nothing else."""
    return None
