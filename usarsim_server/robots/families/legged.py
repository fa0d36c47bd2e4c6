"""Machines on legs, moved joint by joint (protocol reference 3.4.6, 3.4.7, 4.4)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from usarsim_server.logs import Log
from usarsim_server.protocol import messages
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import ActuatorDescription, RobotDescription, Wheel
from usarsim_server.robots.families.base import Conduct, StatusFacts, register_family
from usarsim_server.robots.families.wheeled import MachineFamily
from usarsim_server.robots.tables import TableReader
from usarsim_server.simulation.simulation import BodyHandle

_log = Log("robot")


@dataclass(frozen=True, slots=True)
class Legs:
    """The `[legs]` table.

    Attributes:
        steering_type: TwoLegs or FourLegs, announced in CONF.
        status_period: s between two STA lines; None for that of the dialect.
    """

    steering_type: str = "TwoLegs"
    status_period: float | None = None


class LeggedConduct(Conduct):
    """A machine that takes no DRIVE but that of single joints, and stands where it stands."""

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        if drive.name is None and (drive.left, drive.right, drive.speed) != (None, None, None):
            _log.debug("DRIVE is refused: legs are moved by their joints")

    def stop(self) -> None:
        pass

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        return messages.legged_status(
            dialect,
            facts.time,
            facts.joints,
            self.light,
            self.light_intensity(dialect),
            facts.battery,
            facts.view,
        )


@register_family("legged")
class Legged(MachineFamily):
    """Two legs or four; every joint holds the place it is told."""

    wire_type: ClassVar[str] = "LeggedRobot"

    def conduct(self, robot: RobotDescription, body: BodyHandle) -> Conduct:
        return LeggedConduct(robot, body)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        gear = robot.gear
        assert isinstance(gear, Legs)
        return messages.machine_configuration(
            dialect, self.wire_type, robot.name, gear.steering_type, robot.report.mass, []
        )

    def status_period(self, robot: RobotDescription, dialect: Dialect) -> float:
        gear = robot.gear
        assert isinstance(gear, Legs)
        return gear.status_period or super().status_period(robot, dialect)

    def read(
        self,
        reader: TableReader,
        parent: RobotDescription | None,
        wheels: Sequence[Wheel],
        actuators: Sequence[ActuatorDescription],
    ) -> object | None:
        old = parent.gear if parent is not None and isinstance(parent.gear, Legs) else Legs()
        table = reader.table("legs")
        gear = Legs(
            steering_type=table.choice(
                "steering_type", ("TwoLegs", "FourLegs", "SixLegs"), old.steering_type
            ),
            status_period=(
                table.number("status_period", low=0.005, high=10.0)
                if table.has("status_period")
                else old.status_period
            ),
        )
        table.finish()
        return gear
