"""Aircraft, which hold the velocity they are told (protocol 3.4.4, robots reference 1.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from usarsim_server.base.fields import field
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import (
    DriveController,
    MachineFamily,
    StatusFacts,
    balance_weight,
    register_family,
    within,
)
from usarsim_server.simulation import flight
from usarsim_server.simulation.flight import FlightLimits, VelocityHold
from usarsim_server.simulation.frames import flip_point
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.simulation import BodyHandle

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
