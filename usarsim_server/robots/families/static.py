"""Platforms, which stay where they are put, such as the foot of an arm (protocol 3.4.7)."""

from __future__ import annotations

from typing import ClassVar

from usarsim_server.protocol import messages
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import (
    DriveController,
    Family,
    StatusFacts,
    register_family,
)
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
