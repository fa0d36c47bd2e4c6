"""What a family of vehicles is, and which there are; every family is one class in this folder.

A family knows the words of its vehicles on the wire, the law that turns DRIVE into targets, the
tables of its own in robot files, and whatever it adds to the body in the physics. It is found by
the `kind` of a robot file: a new file in this package is enough to add one, outside packages use
the entry point group `usarsim_server.families` (see `usarsim_server.base.plugins`).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.logs import Log
from usarsim_server.base.plugins import PluginTypes
from usarsim_server.base.tables import Table
from usarsim_server.protocol import messages
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages import VehicleStatus
from usarsim_server.protocol.requests import Drive
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import (
    ActuatorDescription,
    RobotDescription,
    Wheel,
)
from usarsim_server.simulation.motion_laws import LawModel
from usarsim_server.simulation.simulation import BodyHandle
from usarsim_server.simulation.snapshot import RobotBody

Array = NDArray[np.float64]

_log = Log("robot")

LIGHT_INTENSITY = 100
"""Percent; the only intensity the original ever reported for a lit lamp (protocol 4.3)."""


@dataclass(frozen=True, slots=True)
class StatusFacts:
    """What every STA line may need."""

    state: RobotBody  # the robot at the instant of the line
    joints: tuple[tuple[str, float], ...]
    """Name and position (rad or m) of joints that STA tells of, in model order."""
    battery: int  # s of expected life; 99999 if there is none
    view: int = -1  # viewport that shows the robot, -1 if none
    udk_order: bool = False
    """The udk line is to be exactly as the original's (protocol reference 5.2 no. 1)."""

    @property
    def time(self) -> float:
        """Simulated s."""
        return self.state.time


class DriveController(ABC):
    """Drives one robot on behalf of its pilot; remembers what it was last told.

    Attributes:
        robot: its class. body: the handle that takes the orders.
        light: whether the headlight is on.
    """

    def __init__(self, robot: RobotDescription, body: BodyHandle) -> None:
        self.robot = robot
        self.body = body
        self.light = False

    @abstractmethod
    def steer(self, drive: Drive, dialect: Dialect) -> None:
        """Obey what concerns motion in a DRIVE; members of other families are ignored."""

    @abstractmethod
    def stop(self) -> None:
        """Stand still, or do what a machine without power does."""

    @property
    def wanted_speed(self) -> float:
        """How fast the robot is told to go, m/s; that of its fastest wheel, 0 while it rests."""
        radii = [wheel.radius for wheel in self.robot.driven_wheels]
        speeds = np.nan_to_num(self.body.last_drive)
        return float(np.max(np.abs(speeds) * radii, initial=0.0)) if len(speeds) else 0.0

    def rest(self) -> None:
        """Stand still where it is, under power."""
        self.stop()

    @abstractmethod
    def status(self, facts: StatusFacts, dialect: Dialect) -> str:
        """The STA line."""

    def vehicle_status(self, facts: StatusFacts, dialect: Dialect) -> VehicleStatus:
        """What the STA lines of all vehicles tell: time, lamp, battery, view."""
        return VehicleStatus(
            time=facts.time,
            light=self.light,
            light_intensity=self.light_intensity(dialect),
            battery=facts.battery,
            view=facts.view,
        )

    def light_intensity(self, dialect: Dialect) -> int:
        """Percent; udk prints the full one whether the lamp is lit or not (protocol 4.3)."""
        return LIGHT_INTENSITY if self.light or FACETS[dialect].lamp_always_full else 0


@dataclass(frozen=True)
class Family(ABC):
    """What the family knows of the robots of one class; registered under its `kind`s.

    A value: its fields are what the family's own tables in robot files say, those made by `field`
    the keys of the table `section`. It counts as part of the body, so that robots whose families
    differ do not share slots.
    """

    section: ClassVar[str] = ""
    """Name of the family's own table in robot files; empty if it has none."""
    wheeled: ClassVar[bool] = True  # its robots need driven wheels on both sides; others have none
    anchored: ClassVar[bool] = False  # its robots stand fixed wherever they are put
    wheel_sensors: ClassVar[bool] = False  # odometry and encoders work on it
    steering_type: ClassVar[str] = "SkidSteered"  # announced in CONF unless the file says otherwise

    @abstractmethod
    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        """What drives one robot of this family."""

    @abstractmethod
    def configuration(self, robot: RobotDescription, dialect: Dialect) -> str:
        """The CONF line of the vehicle."""

    @abstractmethod
    def geometry(self, robot: RobotDescription, dialect: Dialect) -> str:
        """The GEO line of the vehicle."""

    def status_period(self, dialect: Dialect) -> float:
        """Simulated s between two STA lines."""
        return FACETS[dialect].sta_period

    @classmethod
    def read(
        cls,
        reader: Table,
        parent: Self | None,
        wheels: Sequence[Wheel],
        actuators: Sequence[ActuatorDescription],
    ) -> Self:
        """The family of a robot file; the declared fields are read from `section`.

        Args:
            reader: the file.
            parent: the family of the robot that is extended, if it is of this family.
            wheels, actuators: of the robot.

        Raises:
            RobotDescriptionError: if the family's own tables cannot be used.
        """
        if not cls.section:
            return parent or cls()
        table = reader.table(cls.section)
        family = table.read(cls, parent)
        table.finish()
        return family

    def support(self, actuators: Sequence[ActuatorDescription]) -> float | None:
        """Height of the reference point above a flat floor when standing on what is no wheel, m.

        None: only wheels, if any, touch the floor.
        """
        return None

    def max_steer(self) -> tuple[float, float]:
        """MaxFrontSteer and MaxRearSteer of CONF unless the file says otherwise, rad."""
        return 0.0, 0.0

    def finish(self, robot: RobotDescription) -> RobotDescription:
        """The last word on what has just been read: adds what follows from the family's tables."""
        return robot

    def complete(self, spec: mujoco.MjSpec, robot: RobotDescription) -> None:
        """Add to the body what the common parts do not have (called last by `build_spec`)."""
        return

    def laws(self, robot: RobotDescription) -> tuple[LawModel, ...]:
        """What moves the body before every physics step, beside wheels and joints."""
        return ()


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


def within(what: str, value: float, low: float, high: float) -> float:
    """A number of a command within its limits; who looks on is told what was clamped."""
    limited = max(low, min(high, value))
    if limited != value:
        tell_clamped(what, value, limited)
    return limited


def tell_clamped(what: str, value: float, limited: float) -> None:
    """Say that a number of a command, named as on the wire, was taken for its limit."""
    _log.debug(f"{what} {value:g}: clamped to {limited:g}")


def balance_weight(spec: mujoco.MjSpec, robot: RobotDescription) -> None:
    """Let something else than the floor carry a robot: rotors, gas, water.

    What lies loose beside it keeps its weight.
    """
    loose: set[str] = set()
    for effector in robot.effectors:
        if effector.detached:
            loose |= {effector.name, *(finger.body for finger in effector.fingers)}
    for body in spec.bodies:
        if body.name not in {"world", *loose}:
            body.gravcomp = 1.0


GROUP = "usarsim_server.families"
"""Entry point group for families of other packages."""

TYPES: PluginTypes[Family] = PluginTypes(
    "vehicle", Family, ("usarsim_server.robots.families",), GROUP
)

register_family = TYPES.register
"""Class decorator: make a family available under these kinds of a robot file."""

families = TYPES.names
"""All kinds a robot file may name, sorted."""


def find_family(kind: str, place: str = "") -> type[Family]:
    """The family of a kind.

    Args:
        kind: as robot files write it.
        place: where it stands, for the error.

    Raises:
        RobotDescriptionError: if there is none.
    """
    return TYPES.find(kind, place)
