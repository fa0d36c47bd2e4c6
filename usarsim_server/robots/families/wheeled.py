"""Skid-steered and differential robots, and what other families build on.

The drive law turns DRIVE into the wheel speeds of a left and a right side, or of single wheels
(protocol reference 3.4, 3.4.1, 3.4.3, 5.3); no physics here.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.requests import Drive, WheelTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import (
    DriveController,
    Family,
    StatusFacts,
    register_family,
    within,
)
from usarsim_server.robots.reading import parts
from usarsim_server.simulation.articulation import Order
from usarsim_server.simulation.simulation import BodyHandle

Array = NDArray[np.float64]


class SpeedScale:
    """Reads the wheel speeds of DRIVE: limited, in rad/s or percent."""

    def __init__(self, limit: float) -> None:
        """Take the limit, rad/s."""
        self._limit = limit
        self._sticky = False
        self._percent = False

    def note(self, drive: Drive, dialect: Dialect) -> None:
        """Find out what the speeds of a command are.

        In `ut2004` Normalized holds for the command that carries it, in `udk` until it is sent
        again (protocol reference 3.4); what a supervisor says never holds for the controller.
        """
        if drive.passing or not FACETS[dialect].sticky_normalized:
            self._percent = bool(drive.normalized)
            return
        if drive.normalized is not None:
            self._sticky = drive.normalized
        self._percent = self._sticky

    def read(self, what: str, value: float | None) -> float | None:
        """A wheel speed (rad/s) within the limit; not a number counts as not sent.

        Args:
            what: name of the number on the wire.
            value: rad/s, or percent of the limit.
        """
        if value is None or math.isnan(value):
            return None
        speed = value * self._limit / 100.0 if self._percent else value
        return within(what, speed, -self._limit, self._limit)


class WheelDrive:
    """Remembers what a robot's wheels were last told, as the dialects demand of it."""

    def __init__(self, robot: RobotDescription) -> None:
        """Start with all wheels at rest and the headlight off."""
        wheels = robot.driven_wheels
        self._names = [wheel.name.lower() for wheel in wheels]
        self._left = np.array([wheel.side == "left" for wheel in wheels], dtype=bool)
        self._scale = SpeedScale(robot.drive.max_wheel_speed)
        self._targets = np.zeros(len(wheels))
        self._light = False

    @property
    def light(self) -> bool:
        """Whether the headlight is on."""
        return self._light

    @property
    def targets(self) -> Array:
        """The present wheel speed targets (rad/s) of the driven wheels in part order."""
        return self._targets.copy()

    def command(self, drive: Drive, dialect: Dialect) -> Array | None:
        """Obey a DRIVE.

        Args:
            drive: the request; members of other vehicle families are ignored.
            dialect: in `ut2004` a side that is not sent keeps its speed and Normalized holds for
                this command only; in `udk` an incomplete pair is ignored and Normalized sticks.

        Returns:
            Wheel speed targets (rad/s) of the driven wheels in part order, or None if the command
            does not move the wheels.
        """
        if drive.light is not None:
            self._light = drive.light
        self._scale.note(drive, dialect)
        moved = self._set_sides(drive, dialect)
        # UDK knew no wheel by wheel form; no client of it can mean anything else by these groups.
        moved |= self._set_wheels(drive)
        return self.targets if moved else None

    def stop(self) -> Array:
        """Tell all wheels to stand still; returns the targets."""
        self._targets[:] = 0.0
        return self.targets

    def _set_sides(self, drive: Drive, dialect: Dialect) -> bool:
        left, right = self._scale.read("Left", drive.left), self._scale.read("Right", drive.right)
        if (left is None or right is None) and not FACETS[dialect].partial_drive:
            return False
        if left is not None:
            self._targets[self._left] = left
        if right is not None:
            self._targets[~self._left] = right
        return left is not None or right is not None

    def _set_wheels(self, drive: Drive) -> bool:
        """The wheel by wheel form of DRIVE; wheels it does not name keep their speed."""
        moved = False
        for wheel in (*drive.wheels, *self._named(drive)):
            speed = self._scale.read("WheelSpeed", wheel.speed)
            if speed is not None and 0 <= wheel.number < len(self._targets):
                self._targets[wheel.number] = speed
                moved = True
        return moved

    def _named(self, drive: Drive) -> tuple[WheelTarget, ...]:
        """The single joint form (protocol reference 3.4.6); wheels take velocities only."""
        name = (drive.name or "").lower()
        if name not in self._names or drive.steer or drive.order != Order.VELOCITY:
            return ()
        return (WheelTarget(self._names.index(name), drive.value),)


class WheelController(DriveController):
    """Turns DRIVE into wheel speeds by side, or wheel by wheel."""

    def __init__(self, robot: RobotDescription, body: BodyHandle) -> None:
        super().__init__(robot, body)
        self._law = WheelDrive(robot)

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        targets = self._law.command(drive, dialect)
        if targets is not None:
            self.body.drive(targets)

    def stop(self) -> None:
        self.body.drive(self._law.stop())

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        front, rear = self.steering(facts, dialect)
        return messages.ground_status(
            messages.GroundStatus(
                time=facts.time,
                light=self.light,
                light_intensity=self.light_intensity(dialect),
                battery=facts.battery,
                view=facts.view,
                front_steer=front or 0.0,
                rear_steer=rear or 0.0,
                joints=self.joints(facts),
                steered=front is not None or rear is not None,
            ),
            dialect,
            udk_order=facts.udk_order,
        )

    def joints(self, facts: StatusFacts) -> tuple[tuple[str, float], ...]:
        """Joints that STA tells of by name, such as flippers."""
        return facts.joints

    def steering(self, facts: StatusFacts, dialect: Dialect) -> tuple[float | None, float | None]:
        """Front and rear steering angle, rad; None without steering."""
        return None, None


class WheeledFamily(Family):
    """What all ground vehicles say of themselves."""

    wheel_sensors: ClassVar[bool] = True

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return WheelController(robot, body)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        report = robot.report
        return messages.ground_configuration(
            dialect,
            robot.name,
            report.steering_type,
            report.mass,
            report.max_speed,
            report.max_torque,
            report.max_front_steer,
            report.max_rear_steer,
        )

    def geometry(self, robot: RobotDescription, dialect: Dialect) -> str:
        report = robot.report
        return messages.ground_geometry(
            robot.name,
            report.dimensions,
            report.center_of_gravity,
            report.wheel_radius,
            report.track_width,
            report.wheel_base,
        )


@register_family("skid_steer", "differential")
class SkidSteer(WheeledFamily):
    """All wheels of a side turn alike; two driven wheels and casters are a special case."""

    def finish(self, robot: RobotDescription) -> RobotDescription:
        """The wheel base is that of all it stands on: casters count."""
        places = [parts.wheel_place(wheel, robot.actuators)[0] for wheel in robot.driven_wheels]
        places += [caster.position[0] for caster in robot.casters]
        return with_footprint(robot, round(max(places) - min(places), 9), robot.report.track_width)


def with_footprint(robot: RobotDescription, base: float, track: float) -> RobotDescription:
    """A robot that announces this wheel base and track (m), and dimensions if they follow."""
    old = robot.report
    derived = old.dimensions == (old.wheel_base, old.track_width, 0.0)
    size = (base, track, 0.0) if derived else old.dimensions
    return replace(robot, report=replace(old, wheel_base=base, track_width=track, dimensions=size))
