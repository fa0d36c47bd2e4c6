"""What waits for one connection: its commands, interventions of others, instants to report on.

Any thread puts in and never blocks; whoever serves the connection takes out, see `session.py`.
Commands keep their order, whether they come before, with or after INIT. So do snapshots: each one
that is shown is reported on.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from usarsim_server.base.logs import Log
from usarsim_server.protocol.grammar import Command
from usarsim_server.sessions.outbox import Outbox
from usarsim_server.sessions.robot_role import RobotRole
from usarsim_server.sessions.schedule import LockstepTicks, Role
from usarsim_server.simulation.snapshot import Snapshot


class Report(NamedTuple):
    """What is to be told about one instant: the streams that are due, and whether a tick of
    lockstep has passed, of which the client is told after the streams."""

    snapshot: Snapshot
    streams: Sequence[int]
    tick: bool


class Mailbox:
    """All that waits for one connection, and what it is in the world.

    A listener of the physics, which is why that never waits for a client.

    Attributes:
        peer: `host:port` of the client.
        outbox: takes the lines.
        due: simulated time of the next snapshot wanted.
    """

    def __init__(
        self, peer: str, outbox: Outbox, tick: float | None, call: Callable[[], None]
    ) -> None:
        """Wait for nothing yet.

        Args:
            peer, outbox: see the attributes.
            tick: simulated s between two ticks of lockstep; None without lockstep.
            call: has it served soon, see `Dispatcher.call`.
        """
        self.peer = peer
        self.outbox = outbox
        self.due = math.inf
        self._ask_to_be_served = call
        self._log = Log("robot", connection=peer)
        self._role: Role | None = None
        self._lock = threading.Lock()
        self._commands: deque[Command] = deque()
        self._interventions: deque[Callable[[Role], None]] = deque()
        self._submitted = self._taken = 0
        """Weight of all commands submitted, and of those begun or forgotten."""
        self._reports: deque[Report] = deque()
        """Those that are not finished; the first one may be under way."""
        self._lost: str | None = None
        self._called = False
        self._begun = False
        self._under_way = 0
        self._planning = False
        self._closed = False
        self._ended = False
        self._ticks = LockstepTicks(tick)

    @property
    def robot(self) -> str | None:
        """The name of its robot; None as long as there is none."""
        role = self._role
        return role.name if isinstance(role, RobotRole) else None

    @property
    def backlog(self) -> int:
        """Weight of the commands submitted and not yet begun, see `Command.weight`."""
        return self._submitted - self._taken

    @property
    def has_role(self) -> bool:
        """Whether the connection is a robot or something else in the world, or becomes so."""
        return self._role is not None or self._called

    @property
    def horizon(self) -> float:
        """Simulated time up to which the world may go on without waiting for this client."""
        return self._ticks.horizon

    @property
    def oldest(self) -> float:
        """Simulated time of the oldest snapshot that is not reported on; infinity if none is.

        Infinity too while an order is carried out that may take long, such as looking for an
        avatar's way: its reports come afterwards, all of them, and the others do not wait.
        """
        if self._planning:
            return math.inf
        try:
            return self._reports[0].snapshot.time
        except IndexError:
            return math.inf

    def overdue(self) -> None:
        """The client lets the world wait for too long; it is not waited for any more."""
        with self._lock:
            waited = self._ticks.let_go()
        if waited:
            self._log.warning("lockstep goes on without a client that sends no SYNC")

    def submit(self, commands: list[Command]) -> None:
        """Take over commands, in the order they came; never blocks."""
        with self._lock:
            if self._closed:
                return
            self._commands.extend(commands)
            self._submitted += sum(command.weight for command in commands)
            self._call()

    def intervene(self, act: Callable[[Role], None]) -> None:
        """Have its role do something that the client has not asked for, before what it asks next.

        Given to whoever serves the session, whose thread alone may use the role; forgotten if
        there is none then.
        """
        with self._lock:
            if not self._closed:
                self._interventions.append(act)
                self._call()

    def wake(self, snapshot: Snapshot) -> None:
        """Take a snapshot, and what is due at it; the next one is wanted from now on."""
        with self._lock:
            schedule = self._role.schedule if self._role is not None else None
            if schedule is not None and not self._closed:
                time = snapshot.time
                streams = schedule.take_due(time)
                self._reports.append(Report(snapshot, streams, self._ticks.passes(time)))
                self._call()
            self._set_due()

    def lost(self, reason: str) -> None:
        """The robot was taken out of the world."""
        with self._lock:
            self._lost = reason
            self.due = math.inf
            self._call()

    def settled(self) -> bool:
        """Whether nothing is left to do but, perhaps, to write a report."""
        if self._called:
            with self._lock:
                if self._called and (not self._begun or self._pending()):
                    return False
        return not self.outbox.crowded

    def idle(self) -> bool:
        """Whether all commands and snapshots have been dealt with, and a goodbye too."""
        return not self._called

    def close(self) -> None:
        """The client is gone: the robot leaves the world, commands are forgotten; never blocks."""
        with self._lock:
            self._closed = True
            self._forget()
            self._call()
        role = self._role
        if isinstance(role, RobotRole):
            role.leave()  # at once: who serves it may be busy

    def _pending(self) -> bool:
        """Whether something waits to be begun (lock held)."""
        waiting = len(self._reports) > self._under_way or self._lost is not None
        waiting = waiting or (bool(self._commands) and not self._ticks.barred)
        waiting = waiting or bool(self._interventions)
        return waiting or (self._closed and not self._ended)

    def _call(self) -> None:
        """Ask to be served (lock held)."""
        if not self._called and not self._ended:
            self._called, self._begun = True, False
            self._ask_to_be_served()

    def _forget(self) -> None:
        """Nothing is to be executed any more, and nobody is to be told anything (lock held)."""
        self._commands.clear()
        self._interventions.clear()
        self._taken = self._submitted
        self._forget_reports()

    def _forget_reports(self) -> None:
        self._reports.clear()
        self._under_way = 0
        self.due = math.inf

    def _set_due(self) -> None:
        """Look forward to the next report (lock held)."""
        schedule = self._role.schedule if self._role is not None and not self._closed else None
        self.due = math.inf if schedule is None else min(schedule.due, self._ticks.due)
