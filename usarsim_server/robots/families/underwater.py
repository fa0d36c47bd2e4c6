"""Submarines, with propeller, rudder and stern planes (protocol 3.4.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table, Vector
from usarsim_server.protocol import messages
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
from usarsim_server.simulation import diving
from usarsim_server.simulation.diving import Diving, Hull
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.simulation import BodyHandle


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
