"""Machines on legs, which are moved joint by joint (protocol 3.4.6, 3.4.7, 4.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from usarsim_server.base.fields import field
from usarsim_server.base.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import (
    DriveController,
    MachineFamily,
    StatusFacts,
    register_family,
)
from usarsim_server.simulation.simulation import BodyHandle

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
