"""Aircraft that hold the velocity they are told (protocol 3.4.4, robots reference 1.5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import mujoco
import numpy as np

from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import ActuatorDescription, RobotDescription, Wheel
from usarsim_server.robots.families.base import (
    Conduct,
    StatusFacts,
    balance_weight,
    register_family,
)
from usarsim_server.robots.families.wheeled import MachineFamily
from usarsim_server.robots.tables import TableReader
from usarsim_server.simulation.flight import CHANNELS, FlightLimits, VelocityHold
from usarsim_server.simulation.frames import flip_point
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.simulation import BodyHandle

FASTEST = 100.0
"""m/s and rad/s: beyond this a command is nonsense; the original did not limit it."""


@dataclass(frozen=True, slots=True)
class Flight:
    """The `[flight]` table.

    Attributes:
        max_linear, max_lateral, max_vertical: m/s that 100 percent of Normalized stands for.
        max_yaw_rate: rad/s, likewise.
        tilt: rad that the body leans while it moves, whatever its speed.
        limits: how it answers.
        steering_type: announced in CONF.
        falls: without power it falls; a blimp only drifts to a halt.
    """

    max_linear: float = 2.0
    max_lateral: float = 2.0
    max_vertical: float = 2.0
    max_yaw_rate: float = math.radians(100.0)
    tilt: float = math.radians(25.0)
    limits: FlightLimits = field(default_factory=FlightLimits)
    steering_type: str = "RotaryWing"
    falls: bool = True


class FlightConduct(Conduct):
    """Members that are absent keep their value; without a command it hovers."""

    def __init__(self, robot: RobotDescription, body: BodyHandle) -> None:
        super().__init__(robot, body)
        gear = robot.gear
        assert isinstance(gear, Flight)
        self._gear = gear
        self._linear = self._lateral = self._vertical = self._yaw = 0.0
        """As on the wire: ahead, to the right, up, clockwise."""
        self._pitch = self._roll = 0.0
        """As on the wire: nose up and right side down, rad."""

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        # Here the flag holds for the command that carries it, in both eras (3.4).
        percent = bool(drive.normalized)
        gear = self._gear
        moved = [
            self._set("_vertical", drive.altitude_velocity, gear.max_vertical, percent),
            self._set("_yaw", drive.rotational_velocity, gear.max_yaw_rate, percent, dialect),
        ]
        if self._set("_linear", drive.linear_velocity, gear.max_linear, percent):
            self._pitch = -gear.tilt * _sign(self._linear)
            moved.append(True)
        if self._set("_lateral", drive.lateral_velocity, gear.max_lateral, percent):
            self._roll = gear.tilt * _sign(self._lateral)
            moved.append(True)
        for key, angle in (("_pitch", drive.pitch_angle), ("_roll", drive.roll_angle)):
            if FACETS[dialect].tilt_commands and angle is not None and not math.isnan(angle):
                degrees = angle * math.degrees(gear.tilt) / 100.0 if percent else angle
                setattr(self, key, math.radians(max(-80.0, min(80.0, degrees))))
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
            speed = max(-100.0, min(100.0, value)) * full / 100.0
        else:
            speed = value * (1.0 if angular is None else FACETS[angular].rotational_velocity_unit)
        setattr(self, key, max(-FASTEST, min(FASTEST, speed)))
        return True

    def _send(self, dead: bool) -> None:
        ahead, left, up = flip_point((self._linear, self._lateral, -self._vertical))
        roll, pitch, yaw = flip_point((self._roll, self._pitch, self._yaw))
        self.body.command_law(np.array([ahead, left, up, yaw, roll, pitch, float(dead)]))

    def stop(self) -> None:
        """Without power the rotors stop."""
        self._linear = self._lateral = self._vertical = self._yaw = self._pitch = self._roll = 0.0
        self._send(self._gear.falls)

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        return messages.aerial_status(
            messages.AerialStatus(
                time=facts.time,
                light=self.light,
                light_intensity=self.light_intensity(dialect),
                battery=facts.battery,
                view=facts.view,
            ),
            dialect,
            udk_order=facts.udk_order,
        )


@register_family("aerial")
class Aerial(MachineFamily):
    """Quadrotors and blimps."""

    wire_type: ClassVar[str] = "AerialVehicle"

    def conduct(self, robot: RobotDescription, body: BodyHandle) -> Conduct:
        return FlightConduct(robot, body)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        gear = robot.gear
        assert isinstance(gear, Flight)
        limits = [
            ("MaxLinearVelocity", gear.max_linear),
            ("MaxLateralVelocity", gear.max_lateral),
            ("MaxAltitudeVelocity", gear.max_vertical),
            ("MaxRotationalVelocity", _yaw_unit(gear.max_yaw_rate, dialect)),
            ("MaxTilt", _yaw_unit(gear.tilt, dialect)),
        ]
        return messages.machine_configuration(
            dialect, self.wire_type, robot.name, gear.steering_type, robot.report.mass, limits
        )

    def read(
        self,
        reader: TableReader,
        parent: RobotDescription | None,
        wheels: Sequence[Wheel],
        actuators: Sequence[ActuatorDescription],
    ) -> object | None:
        old = parent.gear if parent is not None and isinstance(parent.gear, Flight) else Flight()
        table = reader.table("flight")

        def number(key: str, default: float, low: float, high: float) -> float:
            return table.number(key, default, low=low, high=high)

        gear = Flight(
            max_linear=number("max_linear_velocity", old.max_linear, 0.01, FASTEST),
            max_lateral=number("max_lateral_velocity", old.max_lateral, 0.01, FASTEST),
            max_vertical=number("max_altitude_velocity", old.max_vertical, 0.01, FASTEST),
            max_yaw_rate=number("max_rotational_velocity", old.max_yaw_rate, 0.01, FASTEST),
            tilt=number("tilt", old.tilt, 0.0, 1.4),
            limits=FlightLimits(
                response=number("response", old.limits.response, 0.02, 60.0),
                max_acceleration=number(
                    "max_acceleration", old.limits.max_acceleration, 0.01, 1000.0
                ),
                tilt_rate=number("tilt_rate", old.limits.tilt_rate, 0.01, 100.0),
                max_turning=number("max_turning", old.limits.max_turning, 0.01, 1e4),
            ),
            steering_type=table.text("steering_type", old.steering_type),
            falls=table.boolean("falls", old.falls),
        )
        table.finish()
        return gear

    def complete(self, spec: mujoco.MjSpec, robot: RobotDescription) -> None:
        balance_weight(spec, robot)

    def laws(self, robot: RobotDescription) -> tuple[LawModel, ...]:
        gear = robot.gear
        assert isinstance(gear, Flight)
        return (LawModel(partial(_hold, gear.limits), CHANNELS),)


def _hold(limits: FlightLimits, model: mujoco.MjModel, prefix: str) -> VelocityHold:
    return VelocityHold(model, f"{prefix}base", limits)


def _sign(value: float) -> float:
    return math.copysign(1.0, value) if value else 0.0


def _yaw_unit(value: float, dialect: Dialect) -> float:
    """Angles of aircraft are in degrees in udk, in radians in ut2004 (5.2 no. 16)."""
    return math.degrees(value) if FACETS[dialect].flight_in_degrees else value
