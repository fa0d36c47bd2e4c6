"""What a robot is, as plain values; `catalog.py` reads robot files (TOML) into them.

A field made by `field` stands in robot files under its name; `reading/` adds what follows from more
than one key. All poses and points here are in the simulation frame (x forward, y left, z up)
relative to the robot's reference point; robot files are written in the wire frame, as the
original's were.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from dataclasses import field as plain
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.protocol.values import Dialect, Vector
from usarsim_server.robots.coupling import Coefficients
from usarsim_server.robots.keys import (
    CHANNELS,
    FASTEST,
    GREY,
    HEAVIEST,
    LIGHTEST,
    LONGEST,
    MASS,
    ORIGIN,
    POINT,
    RAMP,
    SIZE,
    STRENGTH,
    STRONGEST,
    Color,
    read_axis,
)
from usarsim_server.simulation.frames import IDENTITY, Pose

if TYPE_CHECKING:
    from usarsim_server.robots.families.base import Family

SERVO_DROOP = 0.01
"""rad/s that a wheel loses at its full torque unless its robot file says otherwise: next to
nothing, as with a speed controller that has an integral part. A wheel that gives way under the
drag of a turn makes slow turns slower still (robots reference 3.3 V7)."""

STEERING_TYPES = ("SkidSteered", "AckermanSteered", "OmniDrive", "Unknown", "None")
"""What CONF may announce (protocol reference 4.8)."""

DEFAULT_TORQUE = 20.0
"""N m: MotorTorque of UT2004 (robots reference 1.6)."""
ANNOUNCED_TORQUE = 50000.0
"""MaxTorque of a joint that says nothing else, N m (robots reference 1.2)."""


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles of a shape.

    Attributes:
        vertices: (n, 3), m, in the frame of the shape. faces: (m, 3) indices.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.intc]


@dataclass(frozen=True, slots=True)
class Shape:
    """One rigid piece of the chassis or of a link."""

    kind: str  # box, cylinder, sphere, ellipsoid, capsule or mesh
    size: tuple[float, ...]
    """Full extents for a box (length, width, height); (radius, length) for cylinder and capsule;
    (radius,) for a sphere; three semi-axes for an ellipsoid; () for a mesh. m."""
    pose: Pose  # centre relative to the reference point, or to the link
    mass: float = field(default=0.0, **MASS, help="0 for a purely visual piece")
    color: Color = field(default=GREY, **CHANNELS, help="red, green, blue, alpha")
    collides: bool = field(
        default=True, help="takes part in contacts; rays and cameras see it anyway"
    )
    mesh: Mesh | None = None  # its triangles; it collides as their convex hull


@dataclass(frozen=True, slots=True)
class Wheel:
    """A wheel on a hinge whose axis points to the robot's left, so positive spin rolls forward."""

    name: str  # joint name, unique within the robot
    side: str  # `left` or `right`
    position: Vector = field(
        **POINT, help="centre relative to the reference point, or to the link that carries it"
    )
    radius: float = field(**SIZE)
    width: float = field(**SIZE)
    mass: float = field(low=LIGHTEST, high=HEAVIEST, unit="kg")
    driven: bool = field(default=True, help="false for a free wheel")
    link: str | None = None
    """Name of the link that carries it, such as a steering knuckle; None: the chassis."""
    collides: bool = field(
        default=True, help="false for a wheel that touches nothing, such as a sprocket"
    )


@dataclass(frozen=True, slots=True)
class Caster:
    """A frictionless ball that stands in for a swivel caster."""

    position: Vector = field(**POINT)
    radius: float = field(**SIZE)
    mass: float = field(default=0.0, **MASS)


@dataclass(frozen=True, slots=True)
class DriveDescription:
    """Limits of the wheel servos."""

    max_wheel_speed: float = field(
        low=1e-3, high=FASTEST, unit="rad/s", help="announced as MaxSpeed and never exceeded"
    )
    wheel_torque: float = field(default=8.0, **STRENGTH, unit="N m", help="of a wheel's servo")
    servo_gain: float = field(
        default=8.0 / SERVO_DROOP,
        **STRENGTH,
        unit="N m s/rad",
        help="of the velocity servo: load over gain is the speed that a wheel loses under load",
    )
    wheel_acceleration: float = field(default=10.0, **RAMP, help="ramp of wheel speed targets")
    wheel_deceleration: float = field(default=40.0, **RAMP, help="ramp towards standstill")
    parking_brake_delay: float = field(
        default=0.3, low=0.0, high=1e6, unit="s", help="of zero command before wheels are held"
    )


@dataclass(frozen=True, slots=True)
class BatteryDescription:
    """A store that drains evenly (robots reference 2.10)."""

    life: float = field(
        default=1200.0, low=1.0, high=1e9, unit="s", help="of operation on a full charge"
    )
    energy: float = field(default=1.0e6, low=1.0, high=1e15, unit="J", help="of a full charge")


@dataclass(frozen=True, slots=True)
class RobotReport:
    """What GEO and CONF announce; clients compute with these numbers.

    Attributes:
        wheel_radius: m. track_width: m, printed as WheelSeparation. wheel_base: m.
        mass: kg.
    """

    wheel_radius: float
    track_width: float
    wheel_base: float
    mass: float
    steering_type: str = field(choices=STEERING_TYPES)
    dimensions: Vector = field(low=0.0, high=LONGEST, unit="m", help="as printed in GEO")
    center_of_gravity: Vector = field(unit="m", help="in the wire frame, here as well")
    max_speed: float = field(low=0.0, unit="rad/s", help="limit of the spin of wheels")
    max_torque: float = field(low=0.0, unit="N m", help="announced only")
    max_front_steer: float = field(default=0.0, unit="rad")
    max_rear_steer: float = field(default=0.0, unit="rad")


class JointType(Enum):
    """Joints of links, as CONF names them."""

    REVOLUTE = "Revolute"
    PRISMATIC = "Prismatic"


def _joint_type(table: Table, key: str) -> JointType:
    words = {one.value.lower(): one for one in JointType}
    return words[table.choice(key, tuple(words))]


@dataclass(frozen=True, slots=True)
class LinkDescription:
    """A link that moves on one joint: of an arm, a pan-tilt, a flipper, a finger."""

    body: str  # name of the link; sensors and effectors are mounted on it by this name
    joint: str  # name of the joint that moves it
    parent: int | None  # index of the link that carries it; None for the base of the chain
    type: JointType = field(parse=_joint_type, key="joint", default=JointType.REVOLUTE)
    axis: Vector = field(
        parse=read_axis,
        default=(0.0, 0.0, -1.0),
        help="in the link's frame: right-handed turns about it, or shifts along it, are positive",
    )
    pose: Pose = IDENTITY
    """Of the link's frame, through whose origin the axis goes, relative to the parent while the
    joint is at zero."""
    shapes: tuple[Shape, ...] = ()  # the link's body
    limits: tuple[float, float] | None = None
    """Lowest and highest position of the joint, rad or m; None if it has no stops."""
    max_speed: float = 1.0  # rad/s or m/s
    max_torque: float = field(default=DEFAULT_TORQUE, **STRENGTH, unit="N m or N")
    damping: float = field(
        default=0.0, low=0.0, high=STRONGEST, unit="N m s/rad or N s/m", help="passive resistance"
    )
    home: float = 0.0  # position in which the robot appears, rad or m
    follows: str | None = field(
        default=None, help="joint that this one is coupled to; it takes no orders of its own"
    )
    coupling: Coefficients | None = None
    """The position as a polynomial of that of the joint that it follows, by gears or rods and
    without a drive of its own; where it follows none, the joint stays at the first coefficient.
    None: it has a drive, which takes the orders of the joint that it follows, if any."""

    @property
    def mass(self) -> float:
        """Mass of the link, kg."""
        return sum(shape.mass for shape in self.shapes)

    def placed(self, position: float) -> Pose:
        """Pose relative to the parent at a position (rad or m) of the joint."""
        x, y, z = self.axis
        if self.type is JointType.PRISMATIC:
            return self.pose @ Pose((x * position, y * position, z * position))
        sine = math.sin(position / 2.0)
        turn = (math.cos(position / 2.0), x * sine, y * sine, z * sine)
        return self.pose @ Pose((0.0, 0.0, 0.0), turn)


@dataclass(frozen=True, slots=True)
class ActuatorDescription:
    """A chain or tree of links: a mission package, an arm, or bare joints such as flippers."""

    name: str  # item name on the wire
    mount: str | None  # name of the link of another actuator that carries it; None for the chassis
    pose: Pose  # of its base, relative to the link or to the reference point
    links: tuple[LinkDescription, ...]
    """In the order of their numbers on the wire; a parent stands before its children."""
    tip: Vector = field(default=ORIGIN, **POINT, help="tool point in the frame of the last link")
    package: bool = field(
        default=True,
        help="an item with CONF, GEO and status lines; otherwise STA tells where its joints are",
    )


@dataclass(frozen=True, slots=True)
class ItemDescription:
    """A sensor or an effector as the robot file asks for it."""

    type: str  # type of the registry, for example `RangeScanner` or `SICK`
    name: str  # item name on the wire
    link: str | None  # link that carries it; None for the chassis
    pose: Pose  # relative to the link (or the reference point)
    parameters: Mapping[str, object] = plain(default_factory=dict)
    """Remaining keys of the table, checked by the sensor's own factory."""
    where: str = ""  # `file: [[sensor]] n (name)` for error messages


@dataclass(frozen=True, slots=True)
class EffectorDescription:
    """A gripper, a suction cup, a tool changer: something that takes hold of things."""

    item: ItemDescription
    """Type, name, link that carries it, pose on that link, parameters of its type."""
    shapes: tuple[Shape, ...] = ()  # its body
    fingers: tuple[LinkDescription, ...] = ()
    """Links on joints of their own; they open towards their lowest position and close towards their
    highest one."""
    tip: Vector = field(default=ORIGIN, **POINT, help="where it holds, relative to its pose")
    detached: bool = field(
        default=False, help="lies loose beside the robot, where its pose says, until it is taken"
    )

    @property
    def name(self) -> str:
        """Item name on the wire, and name of its body."""
        return self.item.name

    @property
    def mass(self) -> float:
        """Mass with fingers, kg."""
        pieces = sum(shape.mass for shape in self.shapes)
        return pieces + sum(finger.mass for finger in self.fingers)


@dataclass(frozen=True, slots=True)
class CameraDescription:
    """A camera with a zoom lens (robots reference 2.7)."""

    name: str  # item name on the wire
    link: str | None = None  # link that carries it; None for the chassis
    pose: Pose = IDENTITY
    """Relative to the link (or the reference point); it looks along x, z is up."""
    fov: float = 1.3963  # horizontal field of view when the robot appears, rad
    min_fov: float = 0.3491  # ends of the zoom, rad
    max_fov: float = 2.0944
    rate: float | None = field(
        default=None, low=0.1, high=60.0, unit="Hz", help="of simulated time; else the server's"
    )
    where: str = ""  # `file: [[camera]] n (name)` for error messages
    size: tuple[int, int] | None = None
    """Width and height of its pictures, pixels; None: those of a tile."""


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """One robot class."""

    name: str
    """Class name on the wire, as the client's own spelling resolves to it (an alias keeps its own
    name here)."""
    model: str  # name of the class whose geometry this is; robots of one model share parked slots
    kind: str  # name of its family in robot files
    dialect: Dialect  # dialect of the era the class comes from (`auto` starts with it)
    description: str  # one line for listings
    shapes: tuple[Shape, ...]  # the body
    wheels: tuple[Wheel, ...]
    casters: tuple[Caster, ...]
    rest_height: float  # height of the reference point above a flat floor, m
    drive: DriveDescription  # see there; battery None means the robot has none (99999 in STA)
    battery: BatteryDescription | None
    report: RobotReport
    items: tuple[ItemDescription, ...]  # sensors in mount order
    source: Path  # the file it came from
    family: Family
    """What kind of vehicle it is, with all that the family alone knows of it, such as steering or
    rotors."""
    actuators: tuple[ActuatorDescription, ...] = ()
    """Mission packages, arms, flippers; what carries another stands before it."""
    effectors: tuple[EffectorDescription, ...] = ()  # what takes hold of things
    cameras: tuple[CameraDescription, ...] = ()  # in mount order

    @property
    def rolls(self) -> bool:
        """Whether odometry and encoders work on it."""
        return self.family.wheel_sensors

    @property
    def driven_wheels(self) -> tuple[Wheel, ...]:
        """The driven wheels in part order."""
        return tuple(wheel for wheel in self.wheels if wheel.driven)

    @property
    def links(self) -> Iterator[LinkDescription]:
        """All links that move on a joint with a drive, fingers included; wheels are not."""
        for actuator in self.actuators:
            yield from actuator.links
        for effector in self.effectors:
            yield from effector.fingers

    def home_pose(self, link: str | None) -> Pose:
        """Pose of a link relative to the reference point when the robot appears; None: chassis.

        Raises:
            KeyError: if no actuator has such a link.
        """
        return home_pose(self.actuators, link)

    def find_link(self, name: str) -> tuple[ActuatorDescription, int] | None:
        """The actuator that a link (by name, any case) belongs to, and its number, from 1."""
        return find_link(self.actuators, name)


def home_pose(actuators: Sequence[ActuatorDescription], link: str | None) -> Pose:
    """Pose of a link relative to the reference point when the robot appears; None: chassis.

    Raises:
        KeyError: if no actuator has such a link.
    """
    if link is None:
        return IDENTITY
    found = find_link(actuators, link)
    if found is None:
        raise KeyError(link)
    actuator, number = found
    one = actuator.links[number - 1]
    if one.parent is None:
        carrier = home_pose(actuators, actuator.mount) @ actuator.pose
    else:
        carrier = home_pose(actuators, actuator.links[one.parent].body)
    return carrier @ one.placed(one.home)


def find_link(
    actuators: Sequence[ActuatorDescription], name: str
) -> tuple[ActuatorDescription, int] | None:
    """The actuator that a link (by name, any case) belongs to, and its number, from 1."""
    for actuator in actuators:
        for number, link in enumerate(actuator.links, start=1):
            if link.body.lower() == name.lower():
                return actuator, number
    return None
