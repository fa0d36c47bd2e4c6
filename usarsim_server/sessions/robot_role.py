"""What one robot does with requests, and what it reports; no threads, no sockets.

A pilot belongs to one connection and is used by one thread at a time. It turns requests
into wheel targets and reply lines, and snapshots into streamed lines, in the client's dialect.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.actuators.articulation import Articulation
from usarsim_server.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import sends_results
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
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.families.base import StatusFacts, family_of
from usarsim_server.robots.mounting import SetReply, SetResult
from usarsim_server.sensors.report import Survey, conf_line, find_sensors, geo_line
from usarsim_server.sessions.cameras import CameraMount
from usarsim_server.sessions.power import NO_BATTERY, Battery
from usarsim_server.sessions.robots import Vehicle
from usarsim_server.sessions.role import BEAT, Reading, Schedule, first_report
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.cast import RayQuery
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import RobotBody, Snapshot

UPRIGHTING_LIFT = 0.05
"""m that a flipped robot is set down from."""
UDK_LIMB_PERIOD = 0.1
"""Simulated s between two ASTA and two EFF lines (protocol reference 4.9)."""


@dataclass(frozen=True, slots=True)
class PilotOptions:
    """What a lab may change about the reports.

    Attributes:
        quiet_period: simulated s after spawning without STA and SEN (protocol reference 1.8).
        beat: simulated s between the instants at which streams may begin (see `schedule.py`).
        udk_sta_order: send the exact UDK order of STA in the udk dialect (5.2 no. 1).
    """

    quiet_period: float = 0.27
    beat: float = BEAT
    udk_sta_order: bool = False


class Pilot:
    """Conducts one vehicle on behalf of one client.

    Attributes:
        schedule: of STA, of every sensor, of actuators and of effectors, in that order.
    """

    slow = False

    def __init__(
        self,
        vehicle: Vehicle,
        dialect: Dialect,
        options: PilotOptions,
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
        self._dialect = dialect
        self._options = options
        self._log = log
        self._family = family_of(vehicle.description)
        self._conduct = self._family.conduct(vehicle.description, vehicle.body)
        self._battery = _battery(vehicle, battery_life)
        self._limbs = Articulation(vehicle.description, vehicle.body)
        self._cameras = CameraMount(
            vehicle.description, vehicle.robot, vehicle.cameras, vehicle.board, vehicle.look
        )
        self._sensors = vehicle.sensors
        self.schedule = Schedule(self._intervals(), self._first_report)
        self._spawned: float | None = None
        self._dead = False
        self._news: list[str] = []
        vehicle.gauge.connect(self._remaining)
        vehicle.headlight.connect(lambda: self._conduct.light and not self._dead)

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
        """Carry out a request; returns the reply lines."""
        if self._dead:
            # A robot without power takes no orders (protocol reference 3.1, column B).
            return []
        match request:
            case Drive():
                self._obey_drive(request)
            case MisPkg() | Act() | MultiDrive():
                self._limbs.obey(request)
            case Set():
                lines = self._obey_set(request) + self._limbs.set(request, self._dialect)
                return lines + self._cameras.set(request, self._dialect)
            case GetConf():
                return self._answer(self._configuration(request))
            case GetGeo():
                return self._answer(self._geometry(request))
            case _:
                self._log.debug("request has no effect", request=type(request).__name__)
        return []

    def _obey_drive(self, request: Drive) -> None:
        self._conduct.command(request, self._dialect)
        self._limbs.drive(request)
        if request.flip and self._dialect is Dialect.UT2004:
            self._flip()

    def _flip(self) -> None:
        """Set an overturned robot back on its wheels where it lies (protocol reference 3.4)."""
        state = self.vehicle.look()
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
        self.vehicle.body.teleport(Pose((x, y, z + lift), upright))

    def _obey_set(self, request: Set) -> list[str]:
        opcode = request.opcode
        chosen = find_sensors(self._sensors, request.type, request.name)
        if opcode is None or not chosen:
            self._log.debug("SET has no addressee", type=request.type, name=request.name)
            return []
        state = self.vehicle.look()
        if state is None:
            return []
        lines: list[str] = []
        for sensor in chosen:
            answer = sensor.set(opcode, request.params, state)
            reply = answer if isinstance(answer, SetReply) else SetReply(answer)
            if reply.result is SetResult.SCAN:
                survey = Survey([sensor], state)
                hits = self.vehicle.body.cast(survey.fans, state.snapshot) if survey.fans else ()
                lines += survey.lines(hits, self._dialect)
            if reply.result is not SetResult.UNKNOWN and sends_results(self._dialect):
                ok = reply.result is not SetResult.FAILED
                lines.append(
                    messages.result(state.time, sensor.wire_type, sensor.name, ok, reply.segments)
                )
        return lines

    def _answer(self, line: str | None) -> list[str]:
        return [line] if line else []

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

    def read(self, snapshot: Snapshot, due: Sequence[int]) -> Reading | None:
        """Begin the report that is due at a snapshot, see `Role.read`."""
        state = self.vehicle.state(snapshot)
        if state is None:
            return None
        if self._spawned is None:
            self._begin(state)
            return None
        if not due:
            return None
        self._tell_changes(state)
        status = [self._status(state)] if due[0] == 0 else []
        self._check_battery(snapshot.time)
        if self._dead:
            return Reading(RayQuery(()), lambda hits: status)
        last = len(self._sensors)
        survey = Survey([self._sensors[i - 1] for i in due if 0 < i <= last], state)

        def lines(hits: Sequence[RayHits]) -> list[str]:
            told = status + survey.lines(hits, self._dialect)
            if last + 1 in due:
                told += self._limbs.actuator_lines(self._dialect, state)
            if last + 2 in due:
                told += self._limbs.effector_lines(state)
            return told

        return Reading(RayQuery(survey.fans, self.vehicle.robot), lines)

    def _begin(self, state: RobotBody) -> None:
        """Start the clock; dead reckoning starts from the pose of this moment."""
        self._spawned = state.time
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
        """Lines about changes since the last call; unlike streamed lines they must arrive."""
        news, self._news = self._news, []
        return news

    def _battery_name(self) -> str:
        return next((one.name for one in self._sensors if one.wire_type == "Battery"), "Battery")

    def _intervals(self) -> list[float]:
        """Intervals of the streams in the order of the schedule, s."""
        sensors = [sensor.interval(self._dialect) for sensor in self._sensors]
        status = self._family.status_period(self.vehicle.description, self._dialect)
        udk = self._dialect is Dialect.UDK
        actuators = UDK_LIMB_PERIOD if udk else status
        effectors = UDK_LIMB_PERIOD if udk else 0.0
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
            battery=self._remaining(state.time),
            view=self._cameras.view,
            udk_order=self._options.udk_sta_order,
        )
        return self._conduct.status(facts, self._dialect)

    def _remaining(self, time: float) -> int:
        if self._battery is None or self._spawned is None:
            return NO_BATTERY
        return self._battery.remaining_seconds(time - self._spawned)

    def _check_battery(self, time: float) -> None:
        if self._dead or self._battery is None or self._spawned is None:
            return
        if self._battery.empty(time - self._spawned):
            self._dead = True
            self._conduct.stop()
            self._log.info("battery is empty")
            self.announce(time, "BatteryEmpty", "Battery", self._battery_name())


def _battery(vehicle: Vehicle, life: float | None) -> Battery | None:
    description = vehicle.description.battery
    if life is not None:
        return Battery(life=life) if description is None else Battery(life, description.energy)
    return None if description is None else Battery(description.life, description.energy)
