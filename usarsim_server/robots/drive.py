"""The drive law of skid-steered and differential robots: DRIVE in, wheel speeds out.

Rules of protocol reference 3.4, 3.4.1, 3.4.3 and 5.3; no physics here.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.requests import Drive, WheelTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.simulation.articulation import Order

__all__ = ["SpeedScale", "WheelDrive"]

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
        again (protocol reference 3.4).
        """
        if dialect is Dialect.UT2004:
            self._percent = bool(drive.normalized)
            return
        if drive.normalized is not None:
            self._sticky = drive.normalized
        self._percent = self._sticky

    def read(self, value: float | None) -> float | None:
        """A wheel speed (rad/s) within the limit; not a number counts as not sent."""
        if value is None or math.isnan(value):
            return None
        speed = value * self._limit / 100.0 if self._percent else value
        return max(-self._limit, min(self._limit, speed))


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
        left, right = self._scale.read(drive.left), self._scale.read(drive.right)
        if dialect is Dialect.UDK and (left is None or right is None):
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
            speed = self._scale.read(wheel.speed)
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
