"""Robots whose wheels are driven and steered one by one (protocol reference 3.4.3, 3.4.6)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from usarsim_server.protocol.requests import Drive, WheelTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.ackerman import SteeredController, SteeredFamily, SteeredWheel
from usarsim_server.robots.families.base import DriveController, register_family
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.simulation import BodyHandle


class OmniController(SteeredController):
    """Wheels that are not named, or members that are absent, keep what they had.

    A wheel that has not been named yet rolls along: clients of Player drive wheels 0 and 1 only.
    """

    def __init__(self, robot: RobotDescription, body: BodyHandle, steering: SteeredFamily) -> None:
        super().__init__(robot, body, steering)
        self._wheels = [wheel for wheel in self._steering.wheels if wheel.driven]
        self._names = [wheel.name.lower() for wheel in robot.driven_wheels]
        self._speeds = np.full(len(self._wheels), np.nan)

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        """Obey the groups of a command, then its single wheel if it names one."""
        self._scale.note(drive, dialect)
        orders: dict[str, JointOrder] = {}
        moved = [self._turn(target, orders) for target in (*drive.wheels, *self._single(drive))]
        if any(moved):
            self.body.drive(self._speeds.copy())
        if orders:
            self.body.command_joints(orders)

    def _single(self, drive: Drive) -> tuple[WheelTarget, ...]:
        """The single joint form: Steer 1 is the steering axis of a wheel, 0 its spin."""
        name = (drive.name or "").lower()
        if drive.value is None or name not in self._names:
            return ()
        number = self._names.index(name)
        if drive.steer:
            return (WheelTarget(number, steer=drive.value),)
        return (WheelTarget(number, speed=drive.value),) if drive.order == Order.VELOCITY else ()

    def _turn(self, target: WheelTarget, orders: dict[str, JointOrder]) -> bool:
        if not 0 <= target.number < len(self._wheels):
            return False
        wheel = self._wheels[target.number]
        if wheel.joint is not None and target.steer is not None and not math.isnan(target.steer):
            orders[wheel.joint] = JointOrder(Order.POSITION, _position(wheel, target.steer))
        speed = self._scale.read(target.speed)
        if speed is None:
            return False
        self._speeds[target.number] = speed
        return True

    def stop(self) -> None:
        self._speeds[:] = 0.0
        self.body.drive(self._speeds.copy())


def _position(wheel: SteeredWheel, steer: float) -> float:
    """Joint position for an angle of the wire, which is positive to the right; within limits."""
    low, high = wheel.limits
    return max(low, min(high, -wheel.sense * steer))


@register_family("omni")
@dataclass(frozen=True)
class Omni(SteeredFamily):
    """Every wheel on a knuckle of its own."""

    steering_type: ClassVar[str] = "OmniDrive"
    literal: bool = True

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return OmniController(robot, body, self)
