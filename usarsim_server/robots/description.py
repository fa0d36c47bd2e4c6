"""What a robot is, as plain values. Robot files (TOML) are read into these by `loader.py`.

All poses here are already in the simulation frame (x forward, y left, z up) relative to the
robot's reference point; robot files are written in the wire frame, as the original's were.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.values import Dialect, Vector
from usarsim_server.simulation.frames import IDENTITY, Pose

Color = tuple[float, float, float, float]

SERVO_DROOP = 0.01
"""rad/s that a wheel loses at its full torque unless its robot file says otherwise: next to
nothing, as with a speed controller that has an integral part. A wheel that gives way under the
drag of a turn makes slow turns slower still (robots reference 3.3 V7)."""


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
    """One rigid piece of the chassis or of a link.

    Attributes:
        kind: box, cylinder, sphere, ellipsoid, capsule or mesh.
        size: full extents for a box (length, width, height); (radius, length) for cylinder and
            capsule; (radius,) for a sphere; three semi-axes for an ellipsoid; () for a mesh. m.
        pose: centre relative to the reference point, or to the link.
        mass: kg; 0 for a purely visual piece.
        color: red, green, blue, alpha in 0..1.
        collides: whether it takes part in contacts (rays and cameras always see it).
        mesh: its triangles; it collides as their convex hull.
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mass: float
    color: Color
    collides: bool = True
    mesh: Mesh | None = None


@dataclass(frozen=True, slots=True)
class Wheel:
    """A wheel on a hinge whose axis points to the robot's left, so positive spin rolls forward.

    Attributes:
        name: joint name, unique within the robot.
        side: `left` or `right`.
        position: centre relative to the reference point, or to the link that carries it, m.
        radius: m. width: m. mass: kg.
        driven: False for a free wheel.
        link: name of the link that carries it, such as a steering knuckle; None: the chassis.
        collides: False for a wheel that touches nothing, such as the sprocket of a track.
    """

    name: str
    side: str
    position: Vector
    radius: float
    width: float
    mass: float
    driven: bool = True
    link: str | None = None
    collides: bool = True


@dataclass(frozen=True, slots=True)
class Caster:
    """A frictionless ball that stands in for a swivel caster."""

    position: Vector
    radius: float
    mass: float


@dataclass(frozen=True, slots=True)
class DriveDescription:
    """Limits of the wheel servos.

    Attributes:
        max_wheel_speed: rad/s, announced as MaxSpeed and never exceeded.
        wheel_torque: N m per wheel that the servo can exert.
        servo_gain: N m s/rad of the velocity servo; load over gain is the speed that a wheel loses
            under that load.
        wheel_acceleration: rad/s^2, the ramp of wheel speed targets.
        wheel_deceleration: rad/s^2, the ramp towards standstill.
        parking_brake_delay: s of zero command after which the wheels are held in place.
    """

    max_wheel_speed: float
    wheel_torque: float = 8.0
    servo_gain: float = 8.0 / SERVO_DROOP
    wheel_acceleration: float = 10.0
    wheel_deceleration: float = 40.0
    parking_brake_delay: float = 0.3


@dataclass(frozen=True, slots=True)
class BatteryDescription:
    """A store that drains evenly (robots reference 2.10).

    Attributes:
        life: s of operation on a full charge.
        energy: J on a full charge.
    """

    life: float = 1200.0
    energy: float = 1.0e6


@dataclass(frozen=True, slots=True)
class RobotReport:
    """What GEO and CONF announce; clients compute with these numbers.

    Attributes:
        steering_type: SkidSteered, AckermanSteered, OmniDrive, Unknown or None.
        dimensions: m, as printed in GEO.
        center_of_gravity: wire frame, m.
        wheel_radius: m. track_width: m, printed as WheelSeparation. wheel_base: m.
        mass: kg.
        max_speed: wheel spin limit, rad/s.
        max_torque: N m, announced only.
        max_front_steer: rad. max_rear_steer: rad.
    """

    steering_type: str
    dimensions: Vector
    center_of_gravity: Vector
    wheel_radius: float
    track_width: float
    wheel_base: float
    mass: float
    max_speed: float
    max_torque: float
    max_front_steer: float = 0.0
    max_rear_steer: float = 0.0


class JointType(Enum):
    """Joints of links, as CONF names them."""

    REVOLUTE = "Revolute"
    PRISMATIC = "Prismatic"


@dataclass(frozen=True, slots=True)
class LinkDescription:
    """A link that moves on one joint: of an arm, a pan-tilt, a flipper, a finger.

    Attributes:
        body: name of the link; sensors and effectors are mounted on it by this name.
        joint: name of the joint that moves it.
        parent: index of the link that carries it; None for the base of the chain.
        type: of the joint.
        axis: unit vector in the link's frame; right-handed turns about it, or shifts along it,
            are positive.
        pose: of the link's frame, through whose origin the axis goes, relative to the parent
            while the joint is at zero.
        shapes: the link's body.
        limits: lowest and highest position of the joint, rad or m; None if it has no stops.
        max_speed: rad/s or m/s. max_torque: N m or N.
        damping: passive resistance, N m s/rad or N s/m.
        home: position in which the robot appears, rad or m.
        follows: name of a joint that this one is coupled to; it then takes no orders of its own.
    """

    body: str
    joint: str
    parent: int | None
    type: JointType
    axis: Vector
    pose: Pose
    shapes: tuple[Shape, ...]
    limits: tuple[float, float] | None
    max_speed: float
    max_torque: float
    damping: float = 0.0
    home: float = 0.0
    follows: str | None = None

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
    """A chain or tree of links: a mission package, an arm, or bare joints such as flippers.

    Attributes:
        name: item name on the wire.
        mount: name of the link of another actuator that carries it; None for the chassis.
        pose: of its base, relative to the link or to the reference point.
        links: in the order of their numbers on the wire; a parent stands before its children.
        tip: tool point in the frame of the last link.
        package: it is an item with CONF, GEO and status lines; otherwise its joints are driven by
            name and STA tells where they are.
    """

    name: str
    mount: str | None
    pose: Pose
    links: tuple[LinkDescription, ...]
    tip: Vector = (0.0, 0.0, 0.0)
    package: bool = True


@dataclass(frozen=True, slots=True)
class ItemDescription:
    """A sensor or an effector as the robot file asks for it.

    Attributes:
        type: type of the registry, for example `RangeScanner` or `SICK`.
        name: item name on the wire.
        link: link that carries it; None for the chassis.
        pose: relative to the link (or the reference point).
        parameters: remaining keys of the table, checked by the sensor's own factory.
        where: `file: [[sensor]] number n (name)` for error messages.
    """

    type: str
    name: str
    link: str | None
    pose: Pose
    parameters: Mapping[str, object] = field(default_factory=dict)
    where: str = ""


@dataclass(frozen=True, slots=True)
class EffectorDescription:
    """A gripper, a suction cup, a tool changer: something that takes hold of things.

    Attributes:
        item: type, name, link that carries it, pose on that link, parameters of its type.
        shapes: its body.
        fingers: links on joints of their own; they open towards their lowest position and close
            towards their highest one.
        tip: where it holds, relative to its pose.
        detached: it lies loose beside the robot until a tool changer takes it; its pose is then
            relative to the reference point.
    """

    item: ItemDescription
    shapes: tuple[Shape, ...] = ()
    fingers: tuple[LinkDescription, ...] = ()
    tip: Vector = (0.0, 0.0, 0.0)
    detached: bool = False

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
    """A camera with a zoom lens (robots reference 2.7).

    Attributes:
        name: item name on the wire.
        link: link that carries it; None for the chassis.
        pose: relative to the link (or the reference point); it looks along x, z is up.
        fov: horizontal field of view when the robot appears, rad.
        min_fov, max_fov: ends of the zoom, rad.
        rate: pictures per second of simulated time; None: as the server is set.
        where: `file: [[camera]] number n (name)` for error messages.
        size: width and height of its pictures, pixels; None: those of a tile.
    """

    name: str
    link: str | None = None
    pose: Pose = IDENTITY
    fov: float = 1.3963
    min_fov: float = 0.3491
    max_fov: float = 2.0944
    rate: float | None = None
    where: str = ""
    size: tuple[int, int] | None = None


@dataclass(frozen=True, slots=True)
class RobotDescription:
    """One robot class.

    Attributes:
        name: class name on the wire, as the client's own spelling resolves to it (an alias keeps
            its own name here).
        model: name of the class whose geometry this is; robots of one model share parked slots.
        kind: family of vehicles (see `families/`).
        dialect: dialect of the era the class comes from (`auto` starts with it).
        description: one line for listings.
        shapes, wheels, casters: the body.
        rest_height: height of the reference point above a flat floor, m.
        drive, battery, report: see there; battery None means the robot has none (99999 in STA).
        items: sensors in mount order.
        source: the file it came from.
        actuators: mission packages, arms, flippers; what carries another stands before it.
        effectors: what takes hold of things.
        cameras: in mount order.
        gear: what the family alone knows of its robots, such as steering or rotors.
        rolls: odometry and encoders work on it.
    """

    name: str
    model: str
    kind: str
    dialect: Dialect
    description: str
    shapes: tuple[Shape, ...]
    wheels: tuple[Wheel, ...]
    casters: tuple[Caster, ...]
    rest_height: float
    drive: DriveDescription
    battery: BatteryDescription | None
    report: RobotReport
    items: tuple[ItemDescription, ...]
    source: Path
    actuators: tuple[ActuatorDescription, ...] = ()
    effectors: tuple[EffectorDescription, ...] = ()
    cameras: tuple[CameraDescription, ...] = ()
    gear: object | None = None
    rolls: bool = True

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
