"""The handler of one connection, which owns at most one role, such as a robot.

Any thread puts in what waits for it, and never blocks: commands, interventions of others, instants
to report on. The dispatcher serves it whenever something has come, one thread at a time. Commands
keep their order, whether they come before, with or after INIT. So do snapshots: each one that is
shown is reported on. A handler that is late holds the world back, see `clock.py`.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.dialects import DialectSelector
from usarsim_server.protocol.grammar import Command
from usarsim_server.protocol.requests import (
    GetClosestPathNode,
    GetPathNodes,
    GetStartPoses,
    Ignored,
    Init,
    Request,
    Set,
    Sync,
    Unknown,
)
from usarsim_server.sessions.cameras import bind_view
from usarsim_server.sessions.mistakes import Mistakes
from usarsim_server.sessions.outbox import Outbox
from usarsim_server.sessions.robot_role import RobotRole
from usarsim_server.sessions.roles import Roles
from usarsim_server.sessions.schedule import LockstepTicks, Role
from usarsim_server.sessions.tap import Tap
from usarsim_server.simulation.rays.query import PendingReport
from usarsim_server.simulation.snapshot import Snapshot

DIE_FELL = "DmgType_Fell"
FLOOD = 64
"""Commands waiting from which on a client is served apart from the others."""
BESIDE_REPORT = 16
"""Commands that are executed before a report that is due."""


class Report(NamedTuple):
    """What is to be told about one instant: the streams that are due, and whether a tick of
    lockstep has passed, of which the client is told after the streams."""

    snapshot: Snapshot
    streams: Sequence[int]
    tick: bool


class Session:
    """Executes the commands of one connection and reports on what it is in the world.

    A listener of the physics, which never waits for a client.

    Attributes:
        peer: `host:port` of the client.
        outbox: takes the lines.
        due: simulated time of the next snapshot wanted.
        work: processor time that the commands of this client have taken so far, s.
        tap: explains what the client says and is told, and holds its driving back while somebody
            else drives; None, which is nearly always, if nobody does either.
    """

    def __init__(
        self,
        peer: str,
        outbox: Outbox,
        on_backlog_low: Callable[[], None],
        roles: Roles,
        call: Callable[[Session], None],
    ) -> None:
        """Make a session that has nothing to do yet.

        Args:
            peer, outbox: see the attributes.
            on_backlog_low: called, from any thread, when commands have been taken.
            roles: makes what INIT asks for.
            call: has this session served soon, see `Dispatcher.call`.
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
        self._ticks = LockstepTicks(roles.options.tick)
        self.work = 0.0
        self.tap: Tap | None = None
        self._mistakes = Mistakes(peer, lambda: roles.robots.time)
        self._on_backlog_low = on_backlog_low
        self._roles = roles
        self._options = roles.options
        self._selector = DialectSelector(self._options.dialect)
        self._told: Report | None = None
        self._handlers: Mapping[type[Request], Callable[[Any], list[str]]] = {
            Init: self._initialise,
            GetStartPoses: roles.start_poses,
            GetPathNodes: roles.path_nodes,
            GetClosestPathNode: roles.closest_path_node,
            Set: self._set,
            Sync: self._synchronise,
            Unknown: self._pass_over,
            Ignored: self._pass_over,
        }
        """What the connection itself obeys; everything else is its role's."""

    # -- what waits, of any thread ----------------------------------------------------------

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
                now = snapshot.time
                streams = schedule.take_due(now)
                self._reports.append(Report(snapshot, streams, self._ticks.passes(now)))
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
            self._ask_to_be_served(self)

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

    # -- being served, one thread at a time --------------------------------------------------

    @property
    def slow(self) -> bool:
        """Whether what comes next may take long: INIT, orders of a world controller, a flood."""
        return not self._ticks.barred and (len(self._commands) > FLOOD or self._comes_slow())

    def _comes_slow(self) -> bool:
        try:
            init = self._commands[0].word == "INIT"
        except IndexError:
            return False
        return init or (self._role is not None and self._role.slow)

    def execute(self, own_thread: bool) -> None:
        """Execute commands that wait.

        Args:
            own_thread: the session has a thread of its own. Otherwise slow commands are left for
                such a call.
        """
        self._begun = False
        executed, started = 0, 0.0
        while self._interventions and not self._closed:
            self._intervene()
        while executed < FLOOD and self._commands and not (self._closed or self._ticks.barred):
            slow = self._comes_slow()
            if slow and not own_thread:
                break
            # Reports do not wait for many commands, nor for slow ones.
            if self._reports and (slow or executed >= BESIDE_REPORT):
                break
            try:
                command = self._commands.popleft()
            except IndexError:
                break
            if not executed:
                started = time.thread_time()
            executed += 1
            self._taken += command.weight
            role, self._planning = self._role, slow
            tap = self.tap or self._mistakes.tap(command)
            replies: list[str] = []
            try:
                request = interpret(command) if tap is None else tap.read(command, role)
                self._selector.observe(request)
                self._set_dialect()
                handler = self._handlers.get(type(request))
                if handler is not None:
                    replies = handler(request)
                else:
                    replies = role.obey(request) if role is not None else self._ignore(request)
            finally:
                self._planning = False
                if tap is not None:
                    tap.obeyed(self._role, replies)
            for line in replies:
                self.outbox.put_reply(messages.encode(line))
            if role is None and self._role is not None:
                # The rate of INITs pays for building a robot: its client does not owe for that.
                started = time.thread_time()
        if executed:
            self.work += time.thread_time() - started
            self._on_backlog_low()

    def _intervene(self) -> None:
        try:
            act = self._interventions.popleft()
        except IndexError:  # forgotten meanwhile
            return
        if self._role is not None:
            act(self._role)

    def next_report(self) -> PendingReport | None:
        """What the report that is due needs; None if none is."""
        try:
            if self._closed:
                self._end()
                return None
            with self._lock:
                role = self._role
                report = self._reports[0] if self._reports else None
                self._told, self._under_way = report, int(report is not None)
                lost = None
                if report is None:  # what was seen of a robot is told before its end
                    lost, self._lost = self._lost, None
            if lost is not None:
                self._lose(lost)
            if report is None or role is None:
                return None
            pending = role.read(report.snapshot, report.streams)
            if pending is None:
                self.tell(())
                self.outbox.rouse()
            return pending
        finally:
            self._begun = True

    def tell(self, streamed: Sequence[bytes]) -> None:
        """Put what the report under way has found into the outbox, whose taker sleeps on."""
        report = self._told
        self._told = None  # its snapshot keeps a whole model
        if self._role is None or report is None:
            return
        tap, tick = self.tap, messages.tick(report.snapshot.time) if report.tick else None
        # News first: the CONF of a camera must not look like the answer to a question that the
        # first SEN provokes.
        for news in self._role.take_news():
            self._reply(news)
        self.outbox.put_report(streamed, b"" if tick is None else messages.encode(tick))
        if tap is not None:
            for line in streamed:
                tap.tell(self.robot, line, streamed=True)
        with self._lock:
            if self._reports:  # else the robot has left meanwhile
                self._reports.popleft()
            self._under_way = 0
            if report.tick:
                self._ticks.barred = False

    def _reply(self, line: str) -> None:
        encoded = messages.encode(line)
        self.outbox.put_reply(encoded)
        if self.tap is not None:
            self.tap.tell(self.robot, encoded, streamed=False)

    def pause(self) -> bool:
        """Called when nothing is left to do: False if something has come in meanwhile.

        After True nobody serves it until it calls again.
        """
        with self._lock:
            self._called = self._pending() and not self._ended
            return not self._called

    def fail(self, error: Exception) -> None:
        """One robot's defect must not take the others along."""
        self._log.exception("the robot's handler failed", error)
        self._end()
        self._begun = True

    def _end(self) -> None:
        """Leave the world and listen to nobody any more."""
        try:
            self._dismiss()
        except Exception as error:
            self._log.exception("the robot could not leave", error)
        with self._lock:
            self._closed = self._ended = True
            self._told = None
            self._forget()

    # -- what the connection itself obeys ----------------------------------------------------

    def _set_dialect(self) -> None:
        if self._role is not None and self._role.dialect is not self._selector.current:
            self._log.debug("dialect changed", dialect=self._selector.current.value)
            with self._lock:
                self._role.dialect = self._selector.current
                self._set_due()

    def _initialise(self, init: Init) -> list[str]:
        if self._role is not None:
            if not self._options.replace_robot:
                self._log.info("second INIT ignored", second=init.class_name)
                return []
            self._dismiss()
        try:
            role = self._roles.make(init, self.peer, lambda: not self._closed, self._log)
        except UsarsimError as error:
            self._log.warning(f"INIT failed: {error}", robot_class=init.class_name)
            return [messages.refused(str(error))] if init.exact_name else []
        self._selector.initialised(role.dialect, init)
        self._log = self._log.bind(robot=role.name)
        role.dialect = self._selector.current
        now = self._roles.robots.time
        with self._lock:
            self._role = role
            if role.body is not None:
                self._ticks.begin(now)
            self._set_due()
        if self._closed:
            self._dismiss()
        elif role.body is not None:
            role.body.attach(self)
        return []

    def _set(self, request: Set) -> list[str]:
        """Any connection may choose what picture clients see; robots answer it, too."""
        role = self._role
        if not isinstance(role, RobotRole):
            bind_view(self._roles.robots.board, request)
        return role.obey(request) if role is not None else self._ignore(request)

    def _synchronise(self, request: Sync) -> list[str]:
        now = self._roles.robots.time
        with self._lock:
            heard = self._role is not None and self._ticks.answer(request.ticks, now)
            self._set_due()
        if heard:
            self.outbox.together = True  # it is none of the old clients, which know no SYNC
        else:
            self._log.debug("SYNC ignored: nobody waits for it")
        return []

    def _ignore(self, request: Request) -> list[str]:
        self._log.debug("ignored: no robot yet", request=type(request).__name__)
        return []

    def _pass_over(self, _: Unknown | Ignored) -> list[str]:
        """Do nothing; how the command was read (`explanation.faults`) already says so."""
        return []

    def _dismiss(self) -> None:
        with self._lock:
            role, self._role = self._role, None
            self._ticks.end()
            self._forget_reports()
        if role is not None:
            role.leave()
        self._log = Log("robot", connection=self.peer)

    def _lose(self, reason: str) -> None:
        """The simulation took the robot away; the connection stays and may INIT again."""
        if self._role is None:
            return
        self._log.warning("robot removed", reason=reason)
        self._reply(messages.die("None", DIE_FELL))
        self._dismiss()
