"""Time: when the world steps, who is shown what is there, and who is waited for.

The world stops at every step at which a listener is due and shows it a snapshot; it never goes more
than `MAX_AHEAD` beyond one that has not been reported on. So every stream is complete in simulated
time, and when reports cannot keep up, time slows down.

At a pace, simulated time follows the wall clock; but steps that nobody asks for are put off and
made together, so that few of them cost a turn of their own. Who asks or orders something finds the
world two steps before or behind the clock at most. Without a pace the world goes as fast as it can,
but waits until every listener has done what the world may feel, and releases a snapshot to a
listener only after it finished the previous one: reports are written while the world goes on. In
lockstep it also waits at the horizon of every listener until that moves on.

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
from operator import attrgetter, methodcaller
from typing import Protocol

from usarsim_server.base.logs import Log
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.mailbox import Mailbox
from usarsim_server.simulation.pace import Pacer, Patience
from usarsim_server.simulation.snapshot import Snapshot

AHEAD_STEPS = 2
"""Steps by which the world is ahead of the clock at a pace when somebody is due; steps behind it
that are let be when an order comes."""
BATCH_STEPS = 5
"""Most steps of a turn."""
BATCH_TIME = 0.004
"""s of wall time that more than `AHEAD_STEPS` may take at a pace, for commands wait for them."""
COST_WEIGHT = 0.1
"""Of the newest turn in what a step takes."""
MAX_AHEAD = 0.1
"""Simulated s by which the world may be ahead, at a pace, of the oldest instant that is not
reported on. One period of the usual stream: less makes the physics wait for reports that are merely
worked out together, more lets commands act on a world that their senders have not seen."""
CATCH_UP_POLL = 0.001
"""s of wall time between two looks while reports are waited for."""
STAND_POLL = 0.1
"""s of wall time between two looks while the world stands still."""

_log = Log("simulation")
_DUE, _OLDEST, _HORIZON = attrgetter("due"), attrgetter("oldest"), attrgetter("horizon")
_IDLE, _SETTLED = methodcaller("idle"), methodcaller("settled")


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
        self._due = math.inf
        """When the first of them is due, as far as has been asked."""
        self._reported = -math.inf
        """Simulated time up to which everything has been reported on, as far as has been asked."""
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

    def moment(self, simulated: float) -> float:
        """Wall time (`time.perf_counter`) at which the clock stands at a simulated time, as things
        are; minus infinity without a pace. Any thread."""
        return -math.inf if self._unpaced else self._pacer.moment(simulated)

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
            self._turn(self._steps_to_due(BATCH_STEPS, moment))
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
        engine, mail, most = self._engine, self._mail, AHEAD_STEPS
        cost = 0.0
        while not self._stopping:
            if not mail.empty:
                self._catch_up(most)
                mail.obey()
            if self.stands:
                mail.wait(STAND_POLL)
                self._keep_pace(self.speed)
                continue
            pacer, steps = self._pacer, self._steps_to_due(most, self._stand_at)
            begun = time.perf_counter()
            latest = engine.time + (steps - AHEAD_STEPS) * engine.timestep
            wait = pacer.wait(latest + (most - steps) * cost * self.speed, begun)
            if wait > 0.0:
                mail.wait(wait)
                if time.perf_counter() < begun + wait or not mail.empty:
                    continue
            if self._ahead_of_reports():
                mail.wait(CATCH_UP_POLL)
                continue
            begun = time.perf_counter()
            self._turn(steps)
            ended = time.perf_counter()
            cost += COST_WEIGHT * ((ended - begun) / steps - cost)
            most = BATCH_STEPS if cost * BATCH_STEPS < BATCH_TIME else AHEAD_STEPS
            report = pacer.report(engine.time, ended)
            if report is not None:
                report.tell()

    def _catch_up(self, most: int) -> None:
        """Make the steps that have been put off until now if they are many, unless the world is
        late anyway."""
        if self.stands:
            return
        behind = self._pacer.present(time.perf_counter()) - self._engine.time
        steps = math.ceil(behind / self._engine.timestep)
        if AHEAD_STEPS < steps < most and not self._ahead_of_reports():
            self._turn(min(steps, self._steps_to_due(steps, self._stand_at)))

    def _ahead_of_reports(self) -> bool:
        now = self._engine.time
        if self._reported < now - MAX_AHEAD:
            self._reported = min(map(_OLDEST, self._everybody), default=math.inf)
            # What comes later is not older than this moment.
            self._reported = min(self._reported, now)
        return self._reported < now - MAX_AHEAD

    def _run_unpaced(self, patience: Patience) -> None:
        while not self._stopping:
            self._wait_until_settled()
            seen = self._mail.events
            horizon = min(map(_HORIZON, self._listeners.values()), default=-math.inf)
            horizon = min(horizon, self._stand_at)
            if self._engine.time < horizon - self._engine.timestep / 2:
                patience.relax()
                self._turn(self._steps_to_due(BATCH_STEPS, horizon))
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
        self._wait(lambda: not self._busy() and all(map(_IDLE, self._everybody)))

    def _wait_until_settled(self) -> None:
        """Wait until no spawn is under way, and no listener is about to do anything."""
        self._wait(self._settled)

    def _settled(self) -> bool:
        return not self._busy() and all(map(_SETTLED, self._everybody))

    def _wait(self, quiet: Callable[[], bool]) -> None:
        """Wait for something; requests are served meanwhile."""
        while not self._stopping:
            self._mail.obey()
            seen = self._mail.events
            if quiet() and self._mail.empty:
                return
            self._mail.wait(0.001, seen)

    def _steps_to_due(self, most: int, horizon: float) -> int:
        self._due = min(map(_DUE, self._everybody), default=math.inf)
        ahead = min(self._due, horizon) - self._engine.time
        if ahead >= most * self._engine.timestep:
            return most
        # A stream is due at the first step that is not before its time.
        return max(1, math.ceil(ahead / self._engine.timestep - 1e-9))

    def _turn(self, steps: int) -> None:
        for robot in self._engine.advance(steps):
            self._lose(robot, "its state became non-finite")
        if self._due <= self._now:
            self._show_due()

    def _show_due(self) -> bool:
        """Give a snapshot to everybody who wants one now; whether there is anybody."""
        now = self._now
        if not self._due_at(now):
            return False
        if self._unpaced:
            self._wait(lambda: all(map(_IDLE, self._due_at(now))))
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
