"""Vehicles without wheels.

Platforms stay where they are put, such as the foot of an arm (protocol reference 3.4.7). Aircraft
hold the velocity they are told (protocol 3.4.4, robots reference 1.5), submarines have propeller,
rudder and stern planes (protocol 3.4.5), machines on legs are moved joint by joint (protocol 3.4.6,
3.4.7, 4.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from usarsim_server.base.fields import field
from usarsim_server.base.logs import Log
from usarsim_server.base.tables import Table, Vector
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import (
    DriveController,
    Family,
    StatusFacts,
    balance_weight,
    register_family,
    within,
)
from usarsim_server.simulation import diving, flight
from usarsim_server.simulation.diving import Diving, Hull
from usarsim_server.simulation.flight import FlightLimits, VelocityHold
from usarsim_server.simulation.frames import flip_point
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.simulation import BodyHandle


class PlatformController(DriveController):
    """A platform goes nowhere."""

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        pass

    def stop(self) -> None:
        pass

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        return messages.static_status(dialect, facts.time, facts.battery)


@register_family("static")
class Platform(Family):
    """Neither wheels nor weight, as far as anybody outside can tell."""

    wheeled: ClassVar[bool] = False
    anchored: ClassVar[bool] = True

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return PlatformController(robot, body)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        return messages.static_configuration(dialect, robot.name)

    def geometry(self, robot: RobotDescription, dialect: Dialect) -> str:
        return messages.static_geometry(dialect, robot.name, robot.report.dimensions)


class MachineFamily(Family):
    """A family without wheels that is not fixed either.

    Attributes:
        wire_type: Type of its CONF and GEO.
    """

    wheeled: ClassVar[bool] = False
    wire_type: ClassVar[str]

    def geometry(self, robot: RobotDescription, dialect: Dialect) -> str:
        report = robot.report
        return messages.machine_geometry(
            dialect, self.wire_type, robot.name, report.dimensions, report.center_of_gravity
        )


FASTEST = 100.0
"""m/s and rad/s: beyond this a command is nonsense; the original did not limit it."""


_WIRE_NAMES = {
    "_vertical": "AltitudeVelocity",
    "_yaw": "RotationalVelocity",
    "_linear": "LinearVelocity",
    "_lateral": "LateralVelocity",
    "_pitch": "PitchAngle",
    "_roll": "RollAngle",
}


class FlightController(DriveController):
    """Members that are absent keep their value; without a command it hovers."""

    def __init__(self, robot: RobotDescription, body: BodyHandle, flight: Aerial) -> None:
        super().__init__(robot, body)
        self._flight = flight
        self._linear = self._lateral = self._vertical = self._yaw = 0.0
        """As on the wire: ahead, to the right, up, clockwise."""
        self._pitch = self._roll = 0.0
        """As on the wire: nose up and right side down, rad."""

    @property
    def wanted_speed(self) -> float:
        return max(abs(self._linear), abs(self._lateral), abs(self._vertical))

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        # Here the flag holds for the command that carries it, in both eras (protocol 3.4).
        percent = bool(drive.normalized)
        limits = self._flight
        rate, full = drive.rotational_velocity, limits.max_rotational_velocity
        moved = [
            self._set("_vertical", drive.altitude_velocity, limits.max_altitude_velocity, percent),
            self._set("_yaw", rate, full, percent, dialect),
        ]
        if self._set("_linear", drive.linear_velocity, limits.max_linear_velocity, percent):
            self._pitch = -limits.tilt * _sign(self._linear)
            moved.append(True)
        if self._set("_lateral", drive.lateral_velocity, limits.max_lateral_velocity, percent):
            self._roll = limits.tilt * _sign(self._lateral)
            moved.append(True)
        for key, angle in (("_pitch", drive.pitch_angle), ("_roll", drive.roll_angle)):
            if FACETS[dialect].tilt_commands and angle is not None and not math.isnan(angle):
                degrees = angle * math.degrees(limits.tilt) / 100.0 if percent else angle
                setattr(self, key, math.radians(within(_WIRE_NAMES[key], degrees, -80.0, 80.0)))
                moved.append(True)
        if any(moved):
            self._send(False)

    def _set(
        self,
        key: str,
        value: float | None,
        full: float,
        percent: bool,
        angular: Dialect | None = None,
    ) -> bool:
        """Take over a member if it was sent; a yaw rate is in degrees per second in udk."""
        if value is None or math.isnan(value):
            return False
        if percent:
            speed = within(_WIRE_NAMES[key], value, -100.0, 100.0) * full / 100.0
        else:
            speed = value * (1.0 if angular is None else FACETS[angular].rotational_velocity_unit)
        setattr(self, key, within(_WIRE_NAMES[key], speed, -FASTEST, FASTEST))
        return True

    def _send(self, dead: bool) -> None:
        ahead, left, up = flip_point((self._linear, self._lateral, -self._vertical))
        roll, pitch, yaw = flip_point((self._roll, self._pitch, self._yaw))
        self.body.command_law(np.array([ahead, left, up, yaw, roll, pitch, float(dead)]))

    def stop(self) -> None:
        """Without power the rotors stop."""
        self._end(self._flight.falls)

    def rest(self) -> None:
        """Hover."""
        self._end(False)

    def _end(self, dead: bool) -> None:
        self._linear = self._lateral = self._vertical = self._yaw = self._pitch = self._roll = 0.0
        self._send(dead)

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        return messages.aerial_status(
            self.vehicle_status(facts, dialect), dialect, udk_order=facts.udk_order
        )


_FLIGHT = FlightLimits()


@register_family("aerial")
@dataclass(frozen=True)
class Aerial(MachineFamily):
    """Quadrotors and blimps."""

    wire_type: ClassVar[str] = "AerialVehicle"
    section: ClassVar[str] = "flight"

    max_linear_velocity: float = field(
        default=2.0, low=0.01, high=FASTEST, unit="m/s", help="at 100 percent of Normalized"
    )
    max_lateral_velocity: float = field(
        default=2.0, low=0.01, high=FASTEST, unit="m/s", help="likewise"
    )
    max_altitude_velocity: float = field(
        default=2.0, low=0.01, high=FASTEST, unit="m/s", help="likewise"
    )
    max_rotational_velocity: float = field(
        default=math.radians(100.0), low=0.01, high=FASTEST, unit="rad/s", help="likewise"
    )
    tilt: float = field(
        default=math.radians(25.0),
        low=0.0,
        high=1.4,
        unit="rad",
        help="by which the body leans while it moves, whatever its speed",
    )
    response: float = field(default=_FLIGHT.response, low=0.02, high=60.0, unit="s")
    max_acceleration: float = field(
        default=_FLIGHT.max_acceleration, low=0.01, high=1000.0, unit="m/s^2"
    )
    tilt_rate: float = field(default=_FLIGHT.tilt_rate, low=0.01, high=100.0, unit="rad/s")
    max_turning: float = field(default=_FLIGHT.max_turning, low=0.01, high=1e4, unit="rad/s^2")
    flight_type: str = field(default="RotaryWing", key="steering_type", help="announced in CONF")
    falls: bool = field(default=True, help="without power it falls; a blimp only drifts to a halt")

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return FlightController(robot, body, self)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        limits = [
            ("MaxLinearVelocity", self.max_linear_velocity),
            ("MaxLateralVelocity", self.max_lateral_velocity),
            ("MaxAltitudeVelocity", self.max_altitude_velocity),
            ("MaxRotationalVelocity", _yaw_unit(self.max_rotational_velocity, dialect)),
            ("MaxTilt", _yaw_unit(self.tilt, dialect)),
        ]
        return messages.machine_configuration(
            dialect, self.wire_type, robot.name, self.flight_type, robot.report.mass, limits
        )

    def complete(self, spec: mujoco.MjSpec, robot: RobotDescription) -> None:
        balance_weight(spec, robot)

    def laws(self, robot: RobotDescription) -> tuple[LawModel, ...]:
        limits = FlightLimits(
            response=self.response,
            max_acceleration=self.max_acceleration,
            tilt_rate=self.tilt_rate,
            max_turning=self.max_turning,
        )
        return (
            LawModel(lambda m, prefix: VelocityHold(m, f"{prefix}base", limits), flight.CHANNELS),
        )


def _sign(value: float) -> float:
    return math.copysign(1.0, value) if value else 0.0


def _yaw_unit(value: float, dialect: Dialect) -> float:
    """Angles of aircraft are in degrees in udk, in radians in ut2004 (protocol 5.2 no. 16)."""
    return math.degrees(value) if FACETS[dialect].flight_in_degrees else value


class VesselController(DriveController):
    """Members that are absent keep their value."""

    def __init__(self, robot: RobotDescription, body: BodyHandle, vessel: Underwater) -> None:
        super().__init__(robot, body)
        self._vessel = vessel
        self._propeller = self._rudder = self._planes = 0.0

    @property
    def wanted_speed(self) -> float:
        """The speed at which thrust and drag ahead are equal, m/s (see `simulation/diving.py`)."""
        vessel = self._vessel
        push = 2.0 * vessel.thrust_coefficient / max(vessel.drag_area[0], 1e-6)
        turns = abs(self._propeller) / math.tau
        return turns * vessel.propeller_diameter**2 * math.sqrt(push)

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        vessel = self._vessel
        share = vessel.max_propeller / 100.0 if drive.normalized else 1.0
        most = vessel.max_propeller
        self._propeller = _read("Propeller", drive.propeller, share, most, self._propeller)
        self._rudder = _read("Rudder", drive.rudder, 1.0, vessel.max_rudder, self._rudder)
        most = vessel.max_stern_plane
        self._planes = _read("SternPlane", drive.stern_plane, 1.0, most, self._planes)
        if not drive.propeller is drive.rudder is drive.stern_plane is None:
            self._send()

    def _send(self) -> None:
        vessel = self._vessel
        # The law turns the rudder to the left.
        rudder = -vessel.rudder_sense * self._rudder
        planes = vessel.stern_plane_sense * self._planes
        self.body.command_law(np.array([self._propeller, rudder, planes]))

    def stop(self) -> None:
        self._propeller = 0.0
        self._send()

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        return messages.nautic_status(
            self.vehicle_status(facts, dialect), self._rudder, self._planes, dialect
        )


_HULL = Hull()


def _sense(table: Table, key: str) -> int:
    value = table.count(key, low=-1, high=1)
    if value == 0:
        raise table.error(key, "is 0", "write 1 or -1")
    return value


@register_family("underwater")
@dataclass(frozen=True)
class Underwater(MachineFamily):
    """Torpedo-shaped submarines in balance with the water."""

    wire_type: ClassVar[str] = "NauticVehicle"
    section: ClassVar[str] = "vessel"

    max_propeller: float = field(default=60.0, low=1e-4, high=1e4, unit="rad/s")
    max_rudder: float = field(default=0.6, low=1e-4, high=1.5, unit="rad")
    max_stern_plane: float = field(default=0.6, low=1e-4, high=1.5, unit="rad")
    rudder_sense: int = field(
        default=1,
        parse=_sense,
        help="1 if a positive Rudder turns to the right, -1 if to the left; no source tells",
    )
    stern_plane_sense: int = field(
        default=1,
        parse=_sense,
        help="1 if a positive SternPlane turns the nose down, -1 if up; likewise",
    )
    propeller_diameter: float = field(default=_HULL.diameter, low=1e-4, high=10.0, unit="m")
    thrust_coefficient: float = field(default=_HULL.thrust, low=1e-4, high=2.0)
    drag_area: Vector = field(default=_HULL.drag, low=0.0, high=1000.0, unit="m^2")
    turning_drag: Vector = field(default=_HULL.turning_drag, low=0.0, high=1e7)
    plane_area: float = field(default=_HULL.plane, low=0.0, high=100.0, unit="m^2")
    plane_arm: float = field(default=_HULL.arm, low=0.0, high=100.0, unit="m")
    righting_moment: float = field(default=_HULL.righting, low=0.0, high=1e7, unit="N m/rad")
    response: float = field(default=_HULL.response, low=0.02, high=60.0, unit="s")

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return VesselController(robot, body, self)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        limits = [
            ("MaxPropeller", self.max_propeller),
            ("MaxRudder", self.max_rudder),
            ("MaxSternPlane", self.max_stern_plane),
        ]
        return messages.machine_configuration(
            dialect, self.wire_type, robot.name, "VariableDepth", robot.report.mass, limits
        )

    def complete(self, spec: mujoco.MjSpec, robot: RobotDescription) -> None:
        balance_weight(spec, robot)

    def laws(self, robot: RobotDescription) -> tuple[LawModel, ...]:
        hull = Hull(
            diameter=self.propeller_diameter,
            thrust=self.thrust_coefficient,
            drag=self.drag_area,
            turning_drag=self.turning_drag,
            plane=self.plane_area,
            arm=self.plane_arm,
            righting=self.righting_moment,
            response=self.response,
        )
        return (LawModel(lambda m, prefix: Diving(m, f"{prefix}base", hull), diving.CHANNELS),)


def _read(what: str, value: float | None, share: float, limit: float, old: float) -> float:
    if value is None or math.isnan(value):
        return old
    return within(what, value * share, -limit, limit)


_log = Log("robot")


class LeggedController(DriveController):
    """A machine that takes no DRIVE but that of single joints, and stands where it stands."""

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        if drive.name is None and (drive.left, drive.right, drive.speed) != (None, None, None):
            _log.debug("DRIVE is refused: legs are moved by their joints")

    def stop(self) -> None:
        pass

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        return messages.legged_status(self.vehicle_status(facts, dialect), facts.joints, dialect)


@register_family("legged")
@dataclass(frozen=True)
class Legged(MachineFamily):
    """Two legs or more; every joint holds the place it is told."""

    wire_type: ClassVar[str] = "LeggedRobot"
    section: ClassVar[str] = "legs"

    legs: str = field(
        default="TwoLegs",
        key="steering_type",
        choices=("TwoLegs", "FourLegs", "SixLegs"),
        help="announced in CONF",
    )
    own_period: float | None = field(
        default=None,
        key="status_period",
        low=0.005,
        high=10.0,
        unit="s",
        help="between two STA lines, if not that of the dialect",
    )

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return LeggedController(robot, body)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        return messages.machine_configuration(
            dialect, self.wire_type, robot.name, self.legs, robot.report.mass, []
        )

    def status_period(self, dialect: Dialect) -> float:
        return self.own_period or super().status_period(dialect)
