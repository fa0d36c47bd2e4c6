"""Submarines: propeller, rudder, stern planes (protocol reference 3.4.5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import ClassVar

import mujoco
import numpy as np

from usarsim_server.protocol import messages
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
from usarsim_server.simulation.diving import CHANNELS, Diving, Hull
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.simulation import BodyHandle


@dataclass(frozen=True, slots=True)
class Vessel:
    """The `[vessel]` table.

    Attributes:
        max_propeller: rad/s.
        max_rudder, max_stern_plane: rad.
        rudder_sense: 1 if a positive Rudder turns to the right, -1 if to the left; no source tells.
        stern_plane_sense: 1 if a positive SternPlane turns the nose down, -1 if up; likewise.
        hull: see there.
    """

    max_propeller: float = 60.0
    max_rudder: float = 0.6
    max_stern_plane: float = 0.6
    rudder_sense: int = 1
    stern_plane_sense: int = 1
    hull: Hull = field(default_factory=Hull)


class VesselConduct(Conduct):
    """Members that are absent keep their value."""

    def __init__(self, robot: RobotDescription, body: BodyHandle) -> None:
        super().__init__(robot, body)
        gear = robot.gear
        assert isinstance(gear, Vessel)
        self._gear = gear
        self._propeller = self._rudder = self._planes = 0.0

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        gear = self._gear
        share = gear.max_propeller / 100.0 if drive.normalized else 1.0
        self._propeller = _within(drive.propeller, share, gear.max_propeller, self._propeller)
        self._rudder = _within(drive.rudder, 1.0, gear.max_rudder, self._rudder)
        self._planes = _within(drive.stern_plane, 1.0, gear.max_stern_plane, self._planes)
        if not drive.propeller is drive.rudder is drive.stern_plane is None:
            self._send()

    def _send(self) -> None:
        gear = self._gear
        # The law turns the rudder to the left.
        rudder, planes = -gear.rudder_sense * self._rudder, gear.stern_plane_sense * self._planes
        self.body.command_law(np.array([self._propeller, rudder, planes]))

    def stop(self) -> None:
        self._propeller = 0.0
        self._send()

    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        return messages.nautic_status(
            dialect,
            facts.time,
            self._rudder,
            self._planes,
            self.light,
            self.light_intensity(dialect),
            facts.battery,
            facts.view,
        )


@register_family("underwater")
class Underwater(MachineFamily):
    """Torpedo-shaped submarines in balance with the water."""

    wire_type: ClassVar[str] = "NauticVehicle"

    def conduct(self, robot: RobotDescription, body: BodyHandle) -> Conduct:
        return VesselConduct(robot, body)

    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        gear = robot.gear
        assert isinstance(gear, Vessel)
        limits = [
            ("MaxPropeller", gear.max_propeller),
            ("MaxRudder", gear.max_rudder),
            ("MaxSternPlane", gear.max_stern_plane),
        ]
        return messages.machine_configuration(
            dialect, self.wire_type, robot.name, "VariableDepth", robot.report.mass, limits
        )

    def read(
        self,
        reader: TableReader,
        parent: RobotDescription | None,
        wheels: Sequence[Wheel],
        actuators: Sequence[ActuatorDescription],
    ) -> object | None:
        old = parent.gear if parent is not None and isinstance(parent.gear, Vessel) else Vessel()
        table = reader.table("vessel")
        hull = old.hull

        def number(key: str, default: float, high: float, low: float = 1e-4) -> float:
            return table.number(key, default, low=low, high=high)

        gear = Vessel(
            max_propeller=number("max_propeller", old.max_propeller, 1e4),
            max_rudder=number("max_rudder", old.max_rudder, 1.5),
            max_stern_plane=number("max_stern_plane", old.max_stern_plane, 1.5),
            rudder_sense=_sense(table, "rudder_sense", old.rudder_sense),
            stern_plane_sense=_sense(table, "stern_plane_sense", old.stern_plane_sense),
            hull=Hull(
                diameter=number("propeller_diameter", hull.diameter, 10.0),
                thrust=number("thrust_coefficient", hull.thrust, 2.0),
                drag=table.vector("drag_area", hull.drag, low=0.0, high=1000.0),
                turning_drag=table.vector("turning_drag", hull.turning_drag, low=0.0, high=1e7),
                plane=number("plane_area", hull.plane, 100.0, 0.0),
                arm=number("plane_arm", hull.arm, 100.0, 0.0),
                righting=number("righting_moment", hull.righting, 1e7, 0.0),
                response=number("response", hull.response, 60.0, 0.02),
            ),
        )
        table.finish()
        return gear

    def complete(self, spec: mujoco.MjSpec, robot: RobotDescription) -> None:
        balance_weight(spec, robot)

    def laws(self, robot: RobotDescription) -> tuple[LawModel, ...]:
        gear = robot.gear
        assert isinstance(gear, Vessel)
        return (LawModel(partial(_dive, gear.hull), CHANNELS),)


def _dive(hull: Hull, model: mujoco.MjModel, prefix: str) -> Diving:
    return Diving(model, f"{prefix}base", hull)


def _within(value: float | None, share: float, limit: float, old: float) -> float:
    if value is None or math.isnan(value):
        return old
    return max(-limit, min(limit, value * share))


def _sense(table: TableReader, key: str, default: int) -> int:
    value = table.whole(key, default, low=-1, high=1)
    if value == 0:
        table.fail("is 0", "write 1 or -1", key)
    return value
