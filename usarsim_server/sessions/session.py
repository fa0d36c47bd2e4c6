"""The handler of one connection: a mailbox that owns at most one robot, or another role such as
that of a world controller. The dispatcher serves it whenever something has come in.

Commands keep their order, whether they come before, with or after INIT. So do snapshots: each one
that is shown is reported on. A handler that is late holds the world back, see `clockwork.py`.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from usarsim_server.errors import UsarsimError
from usarsim_server.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.commands import interpret
from usarsim_server.protocol.dialects import DialectMode, DialectSelector
from usarsim_server.protocol.grammar import Command
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
from usarsim_server.sessions.dispatcher import Dispatcher, Task
from usarsim_server.sessions.lockstep import Ticks
from usarsim_server.sessions.robot_role import Pilot, PilotOptions
from usarsim_server.sessions.robots import Fleet, Vehicle
from usarsim_server.sessions.role import Casting, Role, RoleFactory, robots_only
from usarsim_server.simulation.frames import Pose, pose_from_wire, wire_from_pose
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.description import WorldDescription

DIE_FELL = "DmgType_Fell"
FLOOD = 64
"""Commands waiting from which on a client is served apart from the others."""
BESIDE_REPORT = 16
"""Commands that are executed before a report that is due."""


class Mouth(Protocol):
    """Where an agent's lines go; must never block."""

    @property
    def crowded(self) -> bool:
        """Whether so much waits for a client that reads that a world without pace should wait."""

    def put_reply(self, line: bytes) -> None:
        """Queue a line that must arrive."""

    def put_stream(self, line: bytes) -> None:
        """Queue a line that may give way to newer ones."""


@dataclass(frozen=True, slots=True)
class AgentOptions:
    """How the connections of one port behave.

    Attributes:
        dialect: how the dialect is chosen.
        replace_robot: a second INIT replaces the robot instead of being ignored.
        start_at_first_pose: INIT without place uses the first start pose, not the origin.
        pilot: see `PilotOptions`.
        tick: simulated s between two ticks of lockstep; None without lockstep.
    """

    dialect: DialectMode = DialectMode.AUTO
    replace_robot: bool = False
    start_at_first_pose: bool = False
    pilot: PilotOptions = field(default_factory=PilotOptions)
    tick: float | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Report:
    """What is to be told about one instant.

    Attributes:
        snapshot: the instant.
        streams: which streams are due, see `Schedule.take_due`.
        tick: a tick of lockstep has passed, and the client is to be told after the streams.
    """

    snapshot: Snapshot
    streams: Sequence[int]
    tick: bool


class RobotAgent:
    """Executes the commands of one connection and reports on its robot."""

    def __init__(
        self,
        peer: str,
        mouth: Mouth,
        on_backlog_low: Callable[[], None],
        fleet: Fleet,
        world: WorldDescription,
        dispatcher: Dispatcher,
        options: AgentOptions,
        roles: RoleFactory = robots_only,
    ) -> None:
        """Make an agent that has nothing to do yet.

        Args:
            peer: names the connection in the log.
            mouth: takes the lines.
            on_backlog_low: called when the mailbox has become empty.
            fleet: makes the robot.
            world: for start poses and path nodes.
            dispatcher: serves it.
            options: see there.
            roles: makes what is no robot, such as a world controller.
        """
        self._peer = peer
        self._mouth = mouth
        self._on_backlog_low = on_backlog_low
        self._fleet = fleet
        self._world = world
        self._dispatcher = dispatcher
        self._options = options
        self._roles = roles
        self._log = Log("robot", connection=peer)
        self._selector = DialectSelector(options.dialect)
        self._role: Role | None = None
        self._leave: Callable[[], None] = _nothing
        self._vehicle: Vehicle | None = None
        self._lock = threading.Lock()
        self._commands: deque[Command] = deque()
        self._submitted = self._taken = 0
        """Weight of all commands submitted, and of those begun or forgotten."""
        self._work = 0.0
        self._reports: deque[_Report] = deque()
        """Those that are not finished; the first one may be under way."""
        self._lost: str | None = None
        self._called = False
        self._begun = False
        self._under_way = 0
        self._planning = False
        self._closed = False
        self._ended = False
        self._due = math.inf
        self._ticks = Ticks(options.tick)
        self._barred = False
        """In lockstep, what follows a SYNC waits until its tick has passed."""

    # -- mailbox, any thread -----------------------------------------------------------------

    @property
    def peer(self) -> str:
        """`host:port` of the client."""
        return self._peer

    @property
    def robot(self) -> str | None:
        """The name of its robot; None as long as there is none."""
        vehicle = self._vehicle
        return None if vehicle is None else vehicle.name

    @property
    def backlog(self) -> int:
        """Weight of the commands submitted and not yet begun."""
        return self._submitted - self._taken

    @property
    def work(self) -> float:
        """Processor time that the commands of this client have taken so far, s."""
        return self._work

    @property
    def has_role(self) -> bool:
        """Whether the connection is a robot or something else in the world, or becomes so."""
        return self._role is not None or self._called

    @property
    def due(self) -> float:
        """Simulated time of the next snapshot wanted."""
        return self._due

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
            waited, self._barred = self._ticks.let_go(), False
        if waited:
            self._log.warning("lockstep goes on without a client that sends no SYNC")

    def submit(self, commands: list[Command]) -> None:
        """Take over commands, in the order they came."""
        with self._lock:
            if self._closed:
                return
            self._commands.extend(commands)
            self._submitted += sum([command.weight for command in commands])
            self._call()

    def wake(self, snapshot: Snapshot) -> None:
        """Take a snapshot, and what is due at it; the next one is wanted from now on."""
        with self._lock:
            role = self._role
            if role is None or role.schedule is None or self._closed:
                self._due = math.inf
                return
            streams = role.schedule.take_due(snapshot.time)
            self._reports.append(_Report(snapshot, streams, self._ticks.passes(snapshot.time)))
            self._set_due()
            self._call()

    def lost(self, reason: str) -> None:
        """The robot was taken out of the world."""
        with self._lock:
            self._lost = reason
            self._due = math.inf
            self._call()

    def _forget_reports(self) -> None:
        """Nobody is to be told anything any more (lock held)."""
        self._reports.clear()
        self._under_way = 0
        self._due = math.inf

    def settled(self) -> bool:
        """Whether nothing is left to do but, perhaps, to write a report."""
        with self._lock:
            quiet = not self._called or (self._begun and not self._pending())
        return quiet and not self._mouth.crowded

    def idle(self) -> bool:
        """Whether all commands and snapshots have been dealt with, and a goodbye too."""
        return not self._called

    def _pending(self) -> bool:
        """Whether something waits to be begun (lock held)."""
        waiting = len(self._reports) > self._under_way or self._lost is not None
        waiting = waiting or (bool(self._commands) and not self._barred)
        return waiting or (self._closed and not self._ended)

    def close(self) -> None:
        """The client is gone: the robot leaves the world."""
        with self._lock:
            self._closed = True
            self._commands.clear()
            self._taken = self._submitted
            self._forget_reports()
            self._call()
        vehicle = self._vehicle
        if vehicle is not None:
            # At once; who serves it may be busy.
            self._fleet.remove(vehicle)

    def _call(self) -> None:
        """Ask to be served (lock held)."""
        if not self._called and not self._ended:
            self._called, self._begun = True, False
            self._dispatcher.call(self)

    # -- being served, one thread at a time --------------------------------------------------

    @property
    def slow(self) -> bool:
        """Whether what comes next may take long: INIT, orders of a world controller, a flood."""
        return not self._barred and (len(self._commands) > FLOOD or self._comes_slow())

    def _comes_slow(self) -> bool:
        try:
            command = self._commands[0]
        except IndexError:
            return False
        return command.word == "INIT" or (self._role is not None and self._role.slow)

    def begin(self, apart: bool) -> Task | None:
        """Execute what waits; the report that is due, if there is one."""
        self._begun = False
        try:
            return self._begin(apart)
        except Exception as error:
            self.fail(error)
            return None
        finally:
            self._begun = True

    def _begin(self, apart: bool) -> Task | None:
        if self._closed:
            self._end()
            return None
        self._execute_waiting(apart)
        with self._lock:
            role = self._role
            report = self._reports[0] if self._reports else None
            self._under_way = int(report is not None)
            lost = None
            if report is None:  # what was seen of a robot is told before its end
                lost, self._lost = self._lost, None
        if lost is not None:
            self._lose(lost)
        if report is None or role is None:
            return None
        reading = role.read(report.snapshot, report.streams)
        if reading is None:
            self._tell((), report)
            return None

        def finish(hits: Sequence[RayHits]) -> Callable[[], None]:
            lines = [messages.encode(line) for line in reading.lines(hits)]
            return lambda: self._tell(lines, report)

        return Task(report.snapshot, reading.query, finish)

    def _tell(self, streamed: Sequence[bytes], report: _Report) -> None:
        """Hand over what a report has found."""
        if self._role is None:
            return
        # News first: the CONF of a camera must not look like the answer to a question that the
        # first SEN provokes.
        for news in self._role.take_news():
            self._mouth.put_reply(messages.encode(news))
        for line in streamed:
            self._mouth.put_stream(line)
        if report.tick:
            self._mouth.put_reply(messages.encode(messages.tick(report.snapshot.time)))
        with self._lock:
            if self._reports:  # else the robot has left meanwhile
                self._reports.popleft()
            self._under_way = 0
            if report.tick:
                self._barred = False

    def pause(self) -> bool:
        """Nothing is left to do; False if something has come in meanwhile."""
        with self._lock:
            self._called = self._pending() and not self._ended
            return not self._called

    def fail(self, error: Exception) -> None:
        """One robot's defect must not take the others along."""
        self._log.exception("the robot's handler failed", error)
        self._end()

    def _end(self) -> None:
        """Leave the world and listen to nobody any more."""
        try:
            self._dismiss()
        except Exception as error:
            self._log.exception("the robot could not leave", error)
        with self._lock:
            self._closed = self._ended = True
            self._commands.clear()
            self._taken = self._submitted
            self._forget_reports()

    def _execute_waiting(self, apart: bool) -> None:
        executed, started = 0, time.thread_time()
        while executed < FLOOD and self._commands and not (self._closed or self._barred):
            slow = self._comes_slow()
            if slow and not apart:
                break
            # Reports do not wait for many commands, nor for slow ones.
            if self._reports and (slow or executed >= BESIDE_REPORT):
                break
            try:
                command = self._commands.popleft()
            except IndexError:
                break
            executed += 1
            self._taken += command.weight
            without_role = self._role is None
            self._planning = slow
            try:
                replies = self._execute(command)
            finally:
                self._planning = False
            for line in replies:
                self._mouth.put_reply(messages.encode(line))
            if without_role and self._role is not None:
                # The rate of INITs pays for building a robot: its client does not owe for that.
                started = time.thread_time()
        if executed:
            self._work += time.thread_time() - started
            self._on_backlog_low()

    def _execute(self, command: Command) -> list[str]:
        request = interpret(command)
        self._selector.observe(request)
        self._set_dialect()
        match request:
            case Init():
                self._initialise(request)
                return []
            case GetStartPoses():
                return [self._start_poses()]
            case GetPathNodes():
                return [self._path_nodes()]
            case GetClosestPathNode():
                return self._closest_path_node(request)
            case Sync():
                self._synchronise(request)
                return []
            case Unknown():
                self._log.info("unknown command ignored", command=command.text)
                return []
            case Set() if self._vehicle is None:
                # Any connection may choose what picture clients see; robots answer it, too.
                bind_view(self._fleet.board, request)
        return self._obey(request)

    def _obey(self, request: Request) -> list[str]:
        if self._role is None:
            self._log.debug("ignored: no robot yet", request=type(request).__name__)
            return []
        return self._role.obey(request)

    def _synchronise(self, request: Sync) -> None:
        now = self._fleet.time
        with self._lock:
            heard = self._role is not None and self._ticks.answer(request.ticks, now)
            self._barred = heard
            self._set_due()
        if not heard:
            self._log.debug("SYNC ignored: nobody waits for it")

    def _set_dialect(self) -> None:
        if self._role is not None and self._role.dialect is not self._selector.current:
            self._log.debug("dialect changed", dialect=self._selector.current.value)
            with self._lock:
                self._role.dialect = self._selector.current
                self._set_due()

    def _set_due(self) -> None:
        """Look forward to the next report (lock held)."""
        role = self._role
        if role is None or role.schedule is None or self._closed:
            self._due = math.inf
        else:
            self._due = min(role.schedule.due, self._ticks.due)

    # -- INIT --------------------------------------------------------------------------------

    def _initialise(self, init: Init) -> None:
        if self._role is not None:
            if not self._options.replace_robot:
                self._log.info("second INIT ignored", second=init.class_name)
                return
            self._dismiss()
        try:
            pose = self._place(init)
            casting = self._roles(init, pose, self._log) or self._robot(init, pose)
        except UsarsimError as error:
            self._log.warning(f"INIT failed: {error}", robot_class=init.class_name)
            return
        if casting is None:
            self._log.warning("INIT failed: unknown class", robot_class=init.class_name)
            return
        self._selector.initialised(casting.dialect, init)
        self._log = self._log.bind(robot=casting.name)
        casting.role.dialect = self._selector.current
        self._leave = casting.leave
        now = self._fleet.time
        with self._lock:
            self._role = casting.role
            if casting.attach is not None:
                # What follows INIT counts from the tick of which the client is told first.
                self._barred = self._ticks.begin(now)
            self._set_due()
        if self._closed:
            self._dismiss()
        elif casting.attach is not None:
            casting.attach(self)

    def _robot(self, init: Init, pose: Pose) -> Casting | None:
        """A vehicle of the class that INIT names; None if there is no such class."""
        description = self._fleet.describe(init.class_name)
        if description is None:
            return None
        asked = self._fleet.time
        vehicle = self._fleet.spawn(description, init.name, pose, lambda: not self._closed)
        log = self._log.bind(robot=vehicle.name)
        pilot = Pilot(vehicle, description.dialect, self._options.pilot, init.battery, log, asked)
        self._vehicle = vehicle
        log.info("robot spawned", robot_class=description.name, id=vehicle.robot)
        return Casting(
            pilot,
            vehicle.name,
            description.dialect,
            leave=lambda: self._fleet.remove(vehicle),
            attach=vehicle.body.attach,
        )

    def _place(self, init: Init) -> Pose:
        """Where INIT wants the robot (protocol reference 3.2)."""
        starts = self._world.starts
        if init.start is not None:
            start = self._world.start(init.start)
            if start is not None:
                return start.pose
            self._log.warning("unknown start pose, the first one is used", start=init.start)
            if starts:
                return starts[0].pose
        elif init.location is None and self._options.start_at_first_pose and starts:
            return starts[0].pose
        zero = (0.0, 0.0, 0.0)
        return pose_from_wire(init.location or zero, init.rotation or zero)

    def _dismiss(self) -> None:
        with self._lock:
            self._role = self._vehicle = None
            self._ticks.end()
            self._barred = False
            self._forget_reports()
        leave, self._leave = self._leave, _nothing
        leave()
        self._log = Log("robot", connection=self._peer)

    def _lose(self, reason: str) -> None:
        """The simulation took the robot away; the connection stays and may INIT again."""
        if self._role is None:
            return
        self._log.warning("robot removed", reason=reason)
        self._mouth.put_reply(messages.encode(messages.die("None", DIE_FELL)))
        self._dismiss()

    # -- the world ---------------------------------------------------------------------------

    def _start_poses(self) -> str:
        return messages.start_poses([(start.tag, *start.announced) for start in self._world.starts])

    def _path_nodes(self) -> str:
        zero = (0.0, 0.0, 0.0)
        return messages.path_nodes(
            [
                (node.tag, wire_from_pose(Pose(node.position))[0], zero)
                for node in self._world.path_nodes
            ]
        )

    def _closest_path_node(self, request: GetClosestPathNode) -> list[str]:
        nodes = self._world.path_nodes
        if request.location is None or not nodes:
            return []
        x, y, _ = pose_from_wire(request.location).position
        nearest = min(
            nodes, key=lambda node: math.hypot(node.position[0] - x, node.position[1] - y)
        )
        location, _ = wire_from_pose(Pose(nearest.position))
        return [messages.closest_path_node(nearest.tag, location)]


def _nothing() -> None:
    """What a connection without a role takes along when it leaves."""
