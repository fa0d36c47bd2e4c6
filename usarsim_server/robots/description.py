"""What a robot is, as plain values. Robot files (TOML) are read into these by `loader.py`.

All poses here are already in the simulation frame (x forward, y left, z up) relative to the
robot's reference point; robot files are written in the wire frame, as the original's were.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

from usarsim_server.protocol.values import Dialect, Vector
from usarsim_server.simulation.frames import Pose

__all__ = [
    "BatteryDescription",
    "Caster",
    "DriveDescription",
    "ItemDescription",
    "Kind",
    "RobotDescription",
    "RobotReport",
    "Shape",
    "Wheel",
]

Color = tuple[float, float, float, float]


class Kind(Enum):
    """Families of vehicles; each has one drive law and one STA form."""

    SKID_STEER = "skid_steer"
    DIFFERENTIAL = "differential"


@dataclass(frozen=True, slots=True)
class Shape:
    """One rigid piece of the chassis.

    Attributes:
        kind: box, cylinder, sphere, ellipsoid or capsule.
        size: full extents for a box (length, width, height); (radius, length) for cylinder and
            capsule; (radius,) for a sphere; three semi-axes for an ellipsoid. Metres.
        pose: centre relative to the reference point.
        mass: kg; 0 for a purely visual piece.
        color: red, green, blue, alpha in 0..1.
        collides: whether it takes part in contacts (rays and cameras always see it).
    """

    kind: str
    size: tuple[float, ...]
    pose: Pose
    mass: float
    color: Color
    collides: bool = True


@dataclass(frozen=True, slots=True)
class Wheel:
    """A wheel on a hinge whose axis points to the robot's left, so positive spin rolls forward.

    Attributes:
        name: joint name, unique within the robot.
        side: `left` or `right`.
        position: centre relative to the reference point, m.
        radius: m. width: m. mass: kg.
        driven: False for a free wheel.
    """

    name: str
    side: str
    position: Vector
    radius: float
    width: float
    mass: float
    driven: bool = True


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
        servo_gain: N m s/rad of the velocity servo; torque over gain is the speed that a wheel
            loses under load.
        wheel_acceleration: rad/s^2, the ramp of wheel speed targets.
        wheel_deceleration: rad/s^2, the ramp towards standstill.
        parking_brake_delay: s of zero command after which the wheels are held in place.
    """

    max_wheel_speed: float
    wheel_torque: float = 8.0
    servo_gain: float = 100.0
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
        steering_type: SkidSteered for both families here.
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


@dataclass(frozen=True, slots=True)
class ItemDescription:
    """A sensor (later: actuator) as the robot file asks for it.

    Attributes:
        type: sensor type of the registry, for example `RangeScanner` or `SICK`.
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
class RobotDescription:
    """One robot class.

    Attributes:
        name: class name on the wire, as the client's own spelling resolves to it (an alias keeps
            its own name here).
        model: name of the class whose geometry this is; robots of one model share parked slots.
        kind: drive family.
        dialect: dialect of the era the class comes from (`auto` starts with it).
        description: one line for listings.
        shapes, wheels, casters: the body.
        rest_height: height of the reference point above a flat floor, m.
        drive, battery, report: see there; battery None means the robot has none (99999 in STA).
        items: sensors in mount order.
        source: the file it came from.
    """

    name: str
    model: str
    kind: Kind
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

    @property
    def driven_wheels(self) -> tuple[Wheel, ...]:
        """The driven wheels in part order."""
        return tuple(wheel for wheel in self.wheels if wheel.driven)
