"""The handler of one connection, which owns at most one role, such as a robot.

The dispatcher serves it whenever something has come into its mailbox. A handler that is late holds
the world back, see `clock.py`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.dialects import DialectSelector
from usarsim_server.protocol.requests import (
    GetClosestPathNode,
    GetPathNodes,
    GetStartPoses,
    Init,
    Request,
    Set,
    Sync,
    Unknown,
)
from usarsim_server.sessions.cameras import bind_view
from usarsim_server.sessions.mailbox import Mailbox, Report
from usarsim_server.sessions.outbox import Outbox
from usarsim_server.sessions.robot_role import RobotRole
from usarsim_server.sessions.roles import Roles
from usarsim_server.sessions.tap import Tap
from usarsim_server.simulation.rays.query import PendingReport

DIE_FELL = "DmgType_Fell"
FLOOD = 64
"""Commands waiting from which on a client is served apart from the others."""
BESIDE_REPORT = 16
"""Commands that are executed before a report that is due."""


class Session(Mailbox):
    """Executes the commands of one connection and reports on what it is in the world.

    Attributes:
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
            peer, outbox: see `Mailbox`.
            on_backlog_low: called, from any thread, when commands have been taken.
            roles: makes what INIT asks for.
            call: has this session served soon, see `Dispatcher.call`.
        """
        super().__init__(peer, outbox, roles.options.tick, lambda: call(self))
        self.work = 0.0
        self.tap: Tap | None = None
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
            Unknown: self._ignore,
        }
        """What the connection itself obeys; everything else is its role's."""

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
            role, self._planning, tap = self._role, slow, self.tap
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
        if isinstance(request, Unknown):
            self._log.info("unknown command ignored", command=request.word)
        else:
            self._log.debug("ignored: no robot yet", request=type(request).__name__)
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
