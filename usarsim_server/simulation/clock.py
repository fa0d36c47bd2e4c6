"""Time: when the world steps, who is shown what is there, and who is waited for.

The world stops at every step at which a listener is due and shows it a snapshot; it never goes more
than `MAX_AHEAD` beyond one that has not been reported on. So every stream is complete in simulated
time, and when reports cannot keep up, time slows down.

At a pace, simulated time follows the wall clock. Without one the world goes as fast as it can, but
waits until every listener has done what the world may feel, and releases a snapshot to a listener
only after it finished the previous one: reports are written while the world goes on. In lockstep it
also waits at the horizon of every listener until that moves on.

Somebody who supervises may let time stand still, go to a moment, or go at another pace. No step is
another one for it: what is told stays the same, only when it comes differs. Orders that come while
time stands still are carried out at once, and their effect begins with the next step.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from operator import attrgetter
from typing import Protocol

from usarsim_server.logs import Log
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.mailbox import Mailbox
from usarsim_server.simulation.snapshot import Snapshot

MAX_LAG = 0.1
"""s of wall time that may be caught up; what is later than that is given up."""
REPORT_PERIOD = 5.0
"""s of wall time over which the real-time factor is taken."""
TOLERATED_FACTOR = 0.98
BATCH_STEPS = 2
"""Steps per turn at a pace: commands are obeyed at least this often, and what a report waits for is
little."""
UNPACED_BATCH_STEPS = 5
MAX_AHEAD = 0.1
"""Simulated s by which the world may be ahead, at a pace, of the oldest instant that is not
reported on. One period of the usual stream: less makes the physics wait for reports that are merely
worked out together, more lets commands act on a world that their senders have not seen."""
CATCH_UP_POLL = 0.001
"""s of wall time between two looks while reports are waited for."""
STAND_POLL = 0.1
"""s of wall time between two looks while the world stands still."""

_log = Log("simulation")
_DUE, _OLDEST = attrgetter("due"), attrgetter("oldest")


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


class Listener(Protocol):
    """Someone who wants snapshots, each at a simulated time of its choice."""

    @property
    def due(self) -> float:
        """Simulated time of the next snapshot wanted; infinity for none.

        Always known: taking a snapshot sets the next one.
        """

    @property
    def oldest(self) -> float:
        """Simulated time of the oldest snapshot not reported on; infinity for none."""

    @property
    def horizon(self) -> float:
        """Simulated time up to which the world may go on without pace; infinity for any."""

    def wake(self, snapshot: Snapshot) -> None:
        """Take a snapshot (called by the physics thread; must return at once)."""

    def overdue(self) -> None:
        """The world has stood still at its horizon for too long."""

    def settled(self) -> bool:
        """Whether nothing that was handed over so far can affect the world any more."""

    def idle(self) -> bool:
        """Whether everything handed over so far has been dealt with."""

    def lost(self, reason: str) -> None:
        """The listener's robot was taken out of the world."""


class Witness(Listener, Protocol):
    """A listener who is nothing in the world."""

    def begin(self, time: float) -> None:
        """It is attached at a simulated time (s): `due` counts from now on. Physics thread."""


@dataclass(frozen=True, slots=True)
class ClockOptions:
    """How time goes."""

    speed: float  # simulated seconds per wall second; infinity for no pace
    patience: float  # wall s for which the world stands still at a horizon; infinity for ever
    bottom: float  # height (m) below which a robot has fallen out of the world


class Stepper:
    """Drives the engine and shows listeners what they want to see.

    Attributes:
        snapshot: the newest that was published.
        speed: simulated seconds per wall second asked for.
        failure: why the physics thread had to give up, None if it did not.
        together: whoever is woken inside is served as one batch; so what is worked out together
            does not depend on which thread runs first.
    """

    def __init__(
        self, engine: Engine, mail: Mailbox, busy: Callable[[], bool], options: ClockOptions
    ) -> None:
        """Stand still until told to run; `busy`: somebody is being put into the world."""
        self._engine = engine
        self._mail = mail
        self._busy = busy
        self._options = options
        self._listeners: dict[int, Listener] = {}
        self._witness: Witness | None = None
        self._everybody: tuple[Listener, ...] = ()
        self._stopping = False
        self._unpaced = math.isinf(options.speed)
        self.speed = options.speed
        self._stand_at = math.inf
        self._pacer = Pacer(options.speed, engine.time)
        self._thread: threading.Thread | None = None
        self._on_failure: Callable[[], None] | None = None
        self.failure: Exception | None = None
        self.batched: Callable[[], AbstractContextManager[object]] = nullcontext
        self.snapshot: Snapshot = engine.snapshot()

    def attach(self, robot: int, listener: Listener) -> None:
        """Give a robot's listener the snapshots it asks for. Physics thread."""
        if robot in self._engine.active:
            self._listeners[robot] = listener
            self._gather()
        else:
            listener.lost("it left the world at once")

    def be_seen_by(self, witness: Witness | None) -> None:
        """Give somebody who is nothing in the world the snapshots it asks for, too, also one of
        this very moment if that is due; None: nobody. Time waits for its reports, but does not
        begin to pass for its sake. Physics thread."""
        self._witness = witness
        self._gather()
        if witness is not None:
            witness.begin(self._engine.time)
            if witness.due <= self._now:
                witness.wake(self._engine.snapshot())

    def _gather(self) -> None:
        witnesses = () if self._witness is None else (self._witness,)
        self._everybody = (*witnesses, *self._listeners.values())

    def remove(self, robot: int) -> None:
        """Take a robot out of the world; unknown ones are ignored. Physics thread."""
        self._listeners.pop(robot, None)
        self._gather()
        self._engine.vacate(robot)

    def renew(self) -> None:
        """Publish a snapshot of another model that wakes nobody. Physics thread."""
        self.snapshot = self._engine.snapshot()

    @property
    def stands(self) -> bool:
        """Whether time has been told to stand still, and does; any thread."""
        return self._engine.time >= self._stand_at - self._engine.timestep / 2

    def go_until(self, moment: float) -> None:
        """Let time go on to a simulated time and stand still there; infinity: for ever, now or
        before: nowhere. Physics thread."""
        self._stand_at = moment
        self._keep_pace(self.speed)

    def hold(self) -> float:
        """Stand still; returns where it would have stood, for `go_until`. Physics thread."""
        before, self._stand_at = self._stand_at, self._engine.time
        return before

    def set_speed(self, speed: float) -> None:
        """Go at another pace. Physics thread.

        Raises:
            ValueError: if the world goes at none.
        """
        if self._unpaced:
            raise ValueError("the world goes as fast as it can: it has no speed")
        self._keep_pace(speed)

    def _keep_pace(self, speed: float) -> None:
        self.speed = speed
        self._pacer = Pacer(speed, self._engine.time)

    def start(self, on_failure: Callable[[], None] | None = None) -> None:
        """Start the physics thread, see `Simulation.start`."""
        self._mail.disown()
        self._on_failure = on_failure
        self._thread = threading.Thread(target=self._run, name="physics", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Stop the physics thread and wait for it."""
        self._stopping = True
        self._mail.notify()
        if self._thread is not None:
            self._thread.join(timeout=2.0)
        self._mail.end()

    def run_until(self, moment: float) -> None:
        """Advance in the calling thread without pace to a simulated time, whatever the horizons."""
        self._mail.claim()
        while not self._stopping and self._engine.time < moment - self._engine.timestep / 2:
            self._wait_until_settled()
            self._turn(self._steps_to_due(UNPACED_BATCH_STEPS, moment))
        self._settle()

    def settle(self) -> None:
        """Carry out requests in the calling thread until every listener is idle."""
        self._mail.claim()
        self._settle()

    # -- the thread --------------------------------------------------------------------------

    def _run(self) -> None:
        self._mail.claim()
        try:
            if self._unpaced:
                self._run_unpaced(Patience(self._options.patience))
            else:
                self._run_paced()
        except Exception as error:
            _log.exception("the physics thread died", error)
            self.failure = error
            if self._on_failure is not None:
                self._on_failure()
        finally:
            self._mail.end()

    def _run_paced(self) -> None:
        self._keep_pace(self.speed)
        while not self._stopping:
            self._mail.obey()
            if self.stands:
                self._mail.wait(STAND_POLL)
                self._keep_pace(self.speed)
                continue
            pacer = self._pacer
            wait = pacer.wait(self._engine.time, time.perf_counter())
            if wait > 0.0:
                self._mail.wait(wait)
                continue
            if self._ahead_of_reports():
                self._mail.wait(CATCH_UP_POLL)
                continue
            self._turn(self._steps_to_due(BATCH_STEPS, self._stand_at))
            report = pacer.report(self._engine.time, time.perf_counter())
            if report is not None:
                _tell(report)

    def _ahead_of_reports(self) -> bool:
        oldest = min(map(_OLDEST, self._everybody), default=math.inf)
        return oldest < self._engine.time - MAX_AHEAD

    def _run_unpaced(self, patience: Patience) -> None:
        while not self._stopping:
            self._wait_until_settled()
            seen = self._mail.events
            horizon = min((one.horizon for one in self._listeners.values()), default=-math.inf)
            horizon = min(horizon, self._stand_at)
            if self._engine.time < horizon - self._engine.timestep / 2:
                patience.relax()
                self._turn(self._steps_to_due(UNPACED_BATCH_STEPS, horizon))
            elif not self._show_due():
                # Without listeners time stands still, too: so runs do not depend on when they
                # start.
                self._mail.wait(STAND_POLL, seen)
                if self.stands:
                    patience.relax()
                elif self._listeners and patience.lost(time.perf_counter()):
                    self._go_on_without()

    def _go_on_without(self) -> None:
        for one in self._listeners.values():
            if one.horizon <= self._engine.time + self._engine.timestep / 2:
                one.overdue()

    def _settle(self) -> None:
        """Wait until no listener and no spawn is under way."""
        self._wait(lambda: not self._busy() and all(one.idle() for one in self._everybody))

    def _wait_until_settled(self) -> None:
        """Wait until no spawn is under way, and no listener is about to do anything."""
        self._wait(lambda: not self._busy() and all(one.settled() for one in self._everybody))

    def _wait(self, quiet: Callable[[], bool]) -> None:
        """Wait for something; requests are served meanwhile."""
        while not self._stopping:
            self._mail.obey()
            seen = self._mail.events
            if quiet() and self._mail.empty:
                return
            self._mail.wait(0.001, seen)

    def _steps_to_due(self, most: int, horizon: float) -> int:
        due = min(map(_DUE, self._everybody), default=math.inf)
        ahead = min(due, horizon) - self._engine.time
        if ahead >= most * self._engine.timestep:
            return most
        # A stream is due at the first step that is not before its time.
        return max(1, math.ceil(ahead / self._engine.timestep - 1e-9))

    def _turn(self, steps: int) -> None:
        for robot in self._engine.advance(steps):
            self._lose(robot, "its state became non-finite")
        self._show_due()

    def _show_due(self) -> bool:
        """Give a snapshot to everybody who wants one now; whether there is anybody."""
        now = self._now
        if not self._due_at(now):
            return False
        if self._unpaced:
            self._wait(lambda: all(one.idle() for one in self._due_at(now)))
        self.snapshot = self._engine.snapshot()
        self._remove_fallen(self.snapshot)
        with self.batched():
            for one in self._due_at(now):
                one.wake(self.snapshot)
        return True

    @property
    def _now(self) -> float:
        """Simulated time up to which things are due."""
        return self._engine.time + self._engine.timestep * 1e-6

    def _due_at(self, now: float) -> list[Listener]:
        return [one for one in self._everybody if one.due <= now]

    def _remove_fallen(self, snapshot: Snapshot) -> None:
        for robot, layout in snapshot.layouts.items():
            if snapshot.xpos[layout.base, 2] < self._options.bottom:
                self._engine.vacate(robot)
                self._lose(robot, "it fell out of the world")

    def _lose(self, robot: int, reason: str) -> None:
        _log.warning("robot removed", id=robot, reason=reason)
        listener = self._listeners.pop(robot, None)
        self._gather()
        if listener is not None:
            listener.lost(reason)


def _tell(report: PaceReport) -> None:
    if report.slow:
        _log.warning("simulated time is slow", real_time_factor=report.factor, asked=report.asked)
    else:
        _log.info("simulated time is kept again", real_time_factor=report.factor)
