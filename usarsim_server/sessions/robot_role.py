"""What one robot does with requests, and what it reports; no threads, no sockets.

A pilot belongs to one connection and is used by one thread at a time. It turns requests
into wheel targets and reply lines, and snapshots into streamed lines, in the client's dialect.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_server.actuators.articulation import Articulation
from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import FACETS, limb_periods, sends_results
from usarsim_server.protocol.requests import (
    Act,
    Drive,
    GetConf,
    GetGeo,
    MisPkg,
    MultiDrive,
    Request,
    Set,
)
from usarsim_server.protocol.values import Dialect, near
from usarsim_server.robots.families.base import StatusFacts
from usarsim_server.robots.mounting import SetReply, SetResult
from usarsim_server.sensors.report import Readings, conf_line, find_sensors, geo_line
from usarsim_server.sessions.cameras import CameraMount
from usarsim_server.sessions.robots import Battery, Vehicle
from usarsim_server.sessions.schedule import REPORT_GRID, Role, Schedule, first_report
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.query import PendingReport, RayHits
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import RobotBody, Snapshot

MOST_TOGETHER = 64
"""Sets of streams that fall due together, of which a robot keeps in mind who they are."""
SPINNING = 0.1
"""rad/s beyond which a wheel turns."""
UPRIGHTING_LIFT = 0.05
"""m that a flipped robot is set down from."""


@dataclass(frozen=True, slots=True)
class RobotRoleOptions:
    """What a lab may change about the reports."""

    quiet_period: float = 0.27
    """Simulated s after spawning without STA and SEN (protocol reference 1.8)."""
    beat: float = REPORT_GRID
    """Simulated s between the instants at which streams may begin (see `schedule.py`)."""
    udk_sta_order: bool = False  # STA in the exact UDK order, in udk (protocol 5.2 no. 1).


class RobotRole(Role):
    """Conducts one vehicle on behalf of one client.

    Attributes:
        schedule: of STA, of every sensor, of actuators and of effectors, in that order.
    """

    body: BodyHandle
    schedule: Schedule

    def __init__(
        self,
        vehicle: Vehicle,
        dialect: Dialect,
        options: RobotRoleOptions,
        battery_life: float | None,
        log: Log,
        asked: float = 0.0,
    ) -> None:
        """Take over a vehicle that has just been spawned.

        Args:
            vehicle: the vehicle.
            dialect: dialect so far; `dialect` may be changed at any time.
            options: see there.
            battery_life: s of battery life that INIT asked for; None for the robot's own.
            log: names connection and robot.
            asked: simulated time of INIT, from which the quiet period counts: a robot for which
                the world had to grow first shall not be silent the longer for it.
        """
        self._asked = asked
        self.vehicle = vehicle
        self.name, self.body = vehicle.name, vehicle.body
        self._dialect = dialect
        self._options = options
        self._log = log
        self._family = vehicle.description.family
        self._drive_controller = self._family.drive_controller(vehicle.description, vehicle.body)
        given = vehicle.description.battery
        life = battery_life if battery_life is not None or given is None else given.life
        self._power = vehicle.power
        self._power.battery = None if life is None else Battery(life)
        self._power.spawned = None
        self._limbs = Articulation(vehicle.description, vehicle.body)
        self._cameras = CameraMount(
            vehicle.description, vehicle.robot, vehicle.cameras, vehicle.board, vehicle.body.look
        )
        self._sensors = vehicle.sensors
        self._together: dict[tuple[int, ...], Readings] = {}
        self.schedule = Schedule(self._intervals(), self._first_report)
        self._dead = False
        self._news: list[str] = []

    # -- requests ----------------------------------------------------------------------------

    @property
    def dialect(self) -> Dialect:
        """Dialect of everything this pilot writes."""
        return self._dialect

    @dialect.setter
    def dialect(self, dialect: Dialect) -> None:
        if dialect is not self._dialect:
            self._dialect = dialect
            self.schedule.set_intervals(self._intervals())

    def obey(self, request: Request) -> list[str]:
        if self._dead:
            # A robot without power takes no orders (protocol reference 3.1, column B).
            self._log.debug("ignored: the battery is empty", request=type(request).__name__)
            return []
        match request:
            case Drive():
                if request.light is not None:
                    self._drive_controller.light = self._power.lit = request.light
                self._drive_controller.steer(request, self._dialect)
                self._limbs.drive(request)
                if request.flip and FACETS[self._dialect].flip:
                    self._flip()
            case MisPkg() | Act() | MultiDrive():
                self._limbs.obey(request)
            case Set():
                lines = self._obey_set(request) + self._limbs.set(request, self._dialect)
                return lines + self._cameras.set(request, self._dialect)
            case GetConf():
                return self._answer(self._configuration(request), request)
            case GetGeo():
                return self._answer(self._geometry(request), request)
            case _:
                self._log.debug("request has no effect", request=type(request).__name__)
        return []

    def moves(self, request: Request) -> bool:
        """Whether a request moves the robot, or anything on it: what somebody who takes it over
        does not want its controller to do meanwhile."""
        if isinstance(request, Set):
            return self._limbs.means(request)
        return isinstance(request, Drive | MultiDrive | MisPkg | Act)

    def halt(self) -> None:
        """Let the robot come to rest where it is: wheels stand, aircraft hover, and every joint
        keeps the place that it has now. Nothing without power: that has come to its own rest."""
        if not self._dead:
            self._drive_controller.rest()
            self.body.hold_joints()

    def restart(self, time: float) -> None:
        """Stand, with a full battery."""
        if self._power.spawned is not None:
            self._power.spawned = time
        self._dead = False
        self.halt()

    def _flip(self) -> None:
        """Set an overturned robot back on its wheels where it lies (protocol reference 3.4)."""
        state = self.body.look()
        if state is None:
            return
        pose = state.pose
        if pose.rotate((0.0, 0.0, 1.0))[2] > 0.5:
            return
        x, y, z = pose.position
        ahead = pose.rotate((1.0, 0.0, 0.0))
        yaw = math.atan2(ahead[1], ahead[0])
        upright = (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2))
        lift = self.vehicle.description.rest_height + UPRIGHTING_LIFT
        self.body.teleport(Pose((x, y, z + lift), upright))

    def _obey_set(self, request: Set) -> list[str]:
        opcode = request.opcode
        chosen = find_sensors(self._sensors, request.type, request.name, self._dialect)
        if opcode is None or not chosen:
            if not self._limbs.means(request):
                self._log.debug("SET has no addressee", type=request.type, name=request.name)
            return []
        state = self.body.look()
        if state is None:
            return []
        lines: list[str] = []
        for sensor in chosen:
            answer = sensor.set(opcode, request.params, state)
            reply = answer if isinstance(answer, SetReply) else SetReply(answer)
            if reply.result is SetResult.SCAN:
                fans, finish = Readings([sensor]).begin(state, self._dialect)
                lines += finish(self.body.cast(fans, state.snapshot) if fans else ())
            if reply.result is SetResult.UNKNOWN:
                self._log.debug("there is no such opcode", opcode=opcode, type=request.type)
            elif sends_results(self._dialect):
                ok = reply.result is not SetResult.FAILED
                lines.append(
                    messages.result(state.time, sensor.wire_type, sensor.name, ok, reply.segments)
                )
        return lines

    def _answer(self, line: str | None, request: GetConf | GetGeo) -> list[str]:
        if line:
            return [line]
        if self._log.is_heard:
            kind, named = request.type.lower(), request.name or ""
            mine = [one.name for one in self._sensors if one.wire_type.lower() == kind]
            kinds = dict.fromkeys(sensor.wire_type for sensor in self._sensors)
            hint = near(named, mine) if mine else near(request.type, kinds)
            self._log.debug(f"nothing answers{hint}", type=request.type, name=request.name)
        return []

    def _configuration(self, request: GetConf) -> str | None:
        kind, name, robot = request.type, request.name, self.vehicle.description
        if kind.lower() != "robot":
            line = conf_line(self._sensors, kind, name, self._dialect)
            line = line or self._limbs.configuration(kind, name, self._dialect)
            return line or self._cameras.configuration(kind, name, self._dialect)
        return self._family.configuration(robot, self._dialect)

    def _geometry(self, request: GetGeo) -> str | None:
        kind, name, robot = request.type, request.name, self.vehicle.description
        if kind.lower() != "robot":
            line = geo_line(self._sensors, kind, name, robot, self._dialect)
            line = line or self._limbs.geometry(kind, name)
            return line or self._cameras.geometry(kind, name, self._dialect)
        return self._family.geometry(robot, self._dialect)

    # -- reports -----------------------------------------------------------------------------

    def read(self, snapshot: Snapshot, due: Sequence[int]) -> PendingReport | None:
        state = self.body.state(snapshot)
        if state is None:
            return None
        if self._power.spawned is None:
            self._begin(state)
            return None
        if not due:
            return None
        self._tell_changes(state)
        status = [self._status(state)] if due[0] == 0 else []
        if status:
            self._watch(state)
        self._check_battery(snapshot.time)
        if self._dead:
            return PendingReport(snapshot, finish=lambda hits: status)
        last = len(self._sensors)
        fans, write = self._readings(tuple(due)).begin(state, self._dialect)

        def finish(hits: Sequence[RayHits]) -> list[str]:
            told = status + write(hits)
            if last + 1 in due:
                told += self._limbs.actuator_lines(self._dialect, state)
            if last + 2 in due:
                told += self._limbs.effector_lines(state)
            return told

        return PendingReport(snapshot, self.body.number, fans, finish)

    def _readings(self, due: tuple[int, ...]) -> Readings:
        """The sensors among the streams that are due; kept, for the same fall due together."""
        found = self._together.get(due)
        if found is None:
            if len(self._together) >= MOST_TOGETHER:
                self._together.clear()
            last = len(self._sensors)
            found = Readings([self._sensors[i - 1] for i in due if 0 < i <= last])
            self._together[due] = found
        return found

    def _begin(self, state: RobotBody) -> None:
        """Start the clock; dead reckoning starts from the pose of this moment."""
        self._power.spawned = state.time
        for sensor in self._sensors:
            if not sensor.rays(state):
                sensor.measure(state, ())
        self._limbs.changes(state)

    def _first_report(self, now: float) -> float:
        options = self._options
        return first_report(self._asked, now, options.quiet_period, options.beat)

    def _tell_changes(self, state: RobotBody) -> None:
        """Announce what hands hold, and tiles of cameras.

        Not before the first report, because some clients read exactly one line after INIT.
        """
        self._news += self._cameras.take_news(state.time, self._dialect)
        for change in self._limbs.changes(state):
            self.announce(state.time, change.event, change.wire_type, change.name)

    def announce(self, time: float, event: str, wire_type: str, name: str) -> None:
        """Have the client told that the configuration has changed by itself."""
        self._news.append(messages.status_change(time, event, wire_type, name))

    def take_news(self) -> list[str]:
        news, self._news = self._news, []
        return news

    def leave(self) -> None:
        self.vehicle.leave()

    def _battery_name(self) -> str:
        return next((one.name for one in self._sensors if one.wire_type == "Battery"), "Battery")

    def _intervals(self) -> list[float]:
        """Intervals of the streams in the order of the schedule, s."""
        sensors = [sensor.interval(self._dialect) for sensor in self._sensors]
        status = self._family.status_period(self._dialect)
        actuators, effectors = limb_periods(self._dialect, status)
        return [
            status,
            *sensors,
            actuators if self._limbs.actuators else 0.0,
            effectors if self._limbs.effectors else 0.0,
        ]

    def _status(self, state: RobotBody) -> str:
        facts = StatusFacts(
            state=state,
            joints=self._limbs.joints(state),
            battery=self._power.seconds(state.time),
            view=self._cameras.view,
            udk_order=self._options.udk_sta_order,
        )
        return self._drive_controller.status(facts, self._dialect)

    def _watch(self, state: RobotBody) -> None:
        """Log that the robot is told to move and does not, once a minute at most."""
        speed = 0.0 if self._dead else self._drive_controller.wanted_speed
        if self.vehicle.watch.see(speed, state.pose, state.time):
            wheels = np.abs(state.wheel_speeds).max(initial=0.0) > SPINNING
            how = "its wheels turn" if wheels else "something holds it"
            self._log.warning(f"DRIVE does not move the robot: {how}", speed=f"{speed:.2f} m/s")

    def _check_battery(self, time: float) -> None:
        if not self._dead and self._power.empty(time):
            self._dead, self._power.lit = True, False
            self._drive_controller.stop()
            self._log.info("battery is empty")
            self.announce(time, "BatteryEmpty", "Battery", self._battery_name())
