"""Submarines: propeller, rudder, stern planes (protocol reference 3.4.5)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from typing import ClassVar

import mujoco
import numpy as np

from usarsim_server.fields import field
from usarsim_server.protocol import messages
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import RobotDescription
from usarsim_server.robots.families.base import (
    DriveController,
    StatusFacts,
    balance_weight,
    register_family,
)
from usarsim_server.robots.families.wheeled import MachineFamily
from usarsim_server.simulation.diving import CHANNELS, Diving, Hull
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.tables import Table, Vector


class VesselController(DriveController):
    """Members that are absent keep their value."""

    def __init__(self, robot: RobotDescription, body: BodyHandle, vessel: Underwater) -> None:
        super().__init__(robot, body)
        self._vessel = vessel
        self._propeller = self._rudder = self._planes = 0.0

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        vessel = self._vessel
        share = vessel.max_propeller / 100.0 if drive.normalized else 1.0
        self._propeller = _within(drive.propeller, share, vessel.max_propeller, self._propeller)
        self._rudder = _within(drive.rudder, 1.0, vessel.max_rudder, self._rudder)
        self._planes = _within(drive.stern_plane, 1.0, vessel.max_stern_plane, self._planes)
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


_USUAL = Hull()


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
    propeller_diameter: float = field(default=_USUAL.diameter, low=1e-4, high=10.0, unit="m")
    thrust_coefficient: float = field(default=_USUAL.thrust, low=1e-4, high=2.0)
    drag_area: Vector = field(default=_USUAL.drag, low=0.0, high=1000.0, unit="m^2")
    turning_drag: Vector = field(default=_USUAL.turning_drag, low=0.0, high=1e7)
    plane_area: float = field(default=_USUAL.plane, low=0.0, high=100.0, unit="m^2")
    plane_arm: float = field(default=_USUAL.arm, low=0.0, high=100.0, unit="m")
    righting_moment: float = field(default=_USUAL.righting, low=0.0, high=1e7, unit="N m/rad")
    response: float = field(default=_USUAL.response, low=0.02, high=60.0, unit="s")

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
        return (LawModel(partial(_dive, self.hull()), CHANNELS),)

    def hull(self) -> Hull:
        """How it moves in the water."""
        return Hull(
            diameter=self.propeller_diameter,
            thrust=self.thrust_coefficient,
            drag=self.drag_area,
            turning_drag=self.turning_drag,
            plane=self.plane_area,
            arm=self.plane_arm,
            righting=self.righting_moment,
            response=self.response,
        )


def _dive(hull: Hull, model: mujoco.MjModel, prefix: str) -> Diving:
    return Diving(model, f"{prefix}base", hull)


def _within(value: float | None, share: float, limit: float, old: float) -> float:
    if value is None or math.isnan(value):
        return old
    return max(-limit, min(limit, value * share))
