"""What flying, diving and walking machines have in common: no wheels, and one form of GEO."""

from __future__ import annotations

from typing import ClassVar

from usarsim_server.protocol import messages
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import Family

__all__ = ["MachineFamily"]


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
