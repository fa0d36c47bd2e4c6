"""STA, GEO and CONF of vehicles (protocol reference 4.3, 4.4, 4.7 and 4.8)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages.text import (
    count,
    flag,
    line,
    number,
    numbers,
    segment,
    time_segment,
    triple,
)
from usarsim_server.protocol.values import Dialect, Vector

_DIGITS = 4
_ACKERMAN = "AckermanSteered"
_PLATFORMS = {Dialect.UT2004: "BaseMachine", Dialect.UDK: "StaticPlatform"}


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleStatus:
    """What STA tells of every vehicle."""

    time: float  # simulated s
    light: bool = False  # headlight is on
    light_intensity: int = 0  # percent, 0 while it is off in `ut2004`
    battery: int = 99999  # s of expected life; 99999 if there is no battery
    view: int = -1  # viewport that shows the robot, -1 if none


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundStatus(VehicleStatus):
    """What STA tells of a ground robot."""

    front_steer: float = 0.0  # rad, 0 for skid steer
    rear_steer: float = 0.0
    joints: tuple[tuple[str, float], ...] = ()
    """Name and position (rad) of flippers, in the order FR, FL, RR, RL."""
    steered: bool = False
    """The robot has steering joints; the exact UDK form prints angles only then."""


def ground_status(status: GroundStatus, dialect: Dialect, udk_order: bool = False) -> str:
    """STA of a ground robot.

    Both dialects use the order and the View of `ut2004`, which no client of either era rejects
    (protocol 5.2 no. 1); only the digits of Time differ.

    Args:
        status: the robot's state.
        dialect: decides the digits of Time.
        udk_order: in `udk`, exactly what the UDK server sent: no View, no joints, LightIntensity
            always 100, a literal 0 for the angles of skid steer.
    """
    if udk_order and dialect is Dialect.UDK:
        return line(
            "STA",
            time_segment(status.time, FACETS[Dialect.UDK].time_digits),
            count("Battery", max(status.battery, 0)),
            segment("Type", "GroundVehicle"),
            flag("LightToggle", status.light),
            count("LightIntensity", 100),
            _steer_limit("FrontSteer", status.front_steer, status.steered),
            _steer_limit("RearSteer", status.rear_steer, status.steered),
        )
    time = time_segment(status.time, FACETS[dialect].time_digits)
    rest = _behind_time(
        *(status.front_steer, status.rear_steer, status.joints),
        *(status.light, status.light_intensity, status.battery, status.view),
    )
    return f"STA {{Type GroundVehicle}} {time} {rest}"


@lru_cache(maxsize=512)
def _behind_time(
    front: float,
    rear: float,
    joints: tuple[tuple[str, float], ...],
    light: bool,
    intensity: int,
    battery: int,
    view: int,
) -> str:
    """What follows Time in STA of a ground robot; remembered, for of most robots it is the same
    again and again."""
    return " ".join(
        (
            number("FrontSteer", front, _DIGITS),
            number("RearSteer", rear, _DIGITS),
            *numbers(joints, _DIGITS),
            *_light_battery_view(light, intensity, battery, view),
        )
    )


def aerial_status(status: VehicleStatus, dialect: Dialect, udk_order: bool = False) -> str:
    """STA of a flying robot; arguments as in `ground_status`.

    The UDK form carries a Type, which the original lacked (protocol 5.2 no. 17).
    """
    kind = segment("Type", "AerialVehicle")
    if udk_order and dialect is Dialect.UDK:
        time = time_segment(status.time, FACETS[Dialect.UDK].time_digits)
        return line("STA", time, count("Battery", max(status.battery, 0)), kind)
    time = time_segment(status.time, FACETS[dialect].time_digits)
    return line("STA", kind, time, *light_battery_view(status))


def ground_geometry(
    class_name: str,
    dimensions: Vector,
    cog: Vector,
    radius: float,
    separation: float,
    base: float,
) -> str:
    """GEO of a ground robot, the same in both dialects.

    Args:
        class_name: robot class without package.
        dimensions: m. cog: centre of gravity, m, wire frame.
        radius: of the wheels, m.
        separation: left to right distance of the wheel centres, m.
        base: front to rear distance of the wheel centres, m.
    """
    return line(
        "GEO",
        segment("Type", "GroundVehicle"),
        segment("Name", class_name),
        triple("Dimensions", dimensions, _DIGITS),
        triple("COG", cog, _DIGITS),
        number("WheelRadius", radius, _DIGITS),
        number("WheelSeparation", separation, _DIGITS),
        number("WheelBase", base, _DIGITS),
    )


def ground_configuration(
    dialect: Dialect,
    class_name: str,
    steering_type: str,
    mass: float,
    max_speed: float,
    max_torque: float,
    max_front: float,
    max_rear: float,
) -> str:
    """CONF of a ground robot; Type or Name comes first by dialect.

    Args:
        dialect: `udk` puts Name first and prints steering limits only for Ackerman steering.
        class_name: robot class without package.
        steering_type: SkidSteered, AckermanSteered, OmniDrive, Unknown or None.
        mass: kg. max_speed: wheel spin limit, rad/s. max_torque: N m.
        max_front, max_rear: steering limits, rad.
    """
    kind, name = segment("Type", "GroundVehicle"), segment("Name", class_name)
    limits = dialect is Dialect.UT2004 or steering_type == _ACKERMAN
    return line(
        "CONF",
        *((kind, name) if FACETS[dialect].type_before_name else (name, kind)),
        segment("SteeringType", steering_type),
        number("Mass", mass, _DIGITS),
        number("MaxSpeed", max_speed, _DIGITS),
        number("MaxTorque", max_torque, _DIGITS),
        _steer_limit("MaxFrontSteer", max_front, limits),
        _steer_limit("MaxRearSteer", max_rear, limits),
    )


def static_status(dialect: Dialect, time: float, battery: int) -> str:
    """STA of a platform that stands fixed.

    Args:
        dialect: decides Type and digits, and only `udk` tells of the battery.
        time: simulated s.
        battery: s of expected life; 99999 if there is no battery.
    """
    kind = segment("Type", _PLATFORMS[dialect])
    stamp = time_segment(time, FACETS[dialect].time_digits)
    if dialect is Dialect.UT2004:
        return line("STA", kind, stamp)
    return line("STA", stamp, count("Battery", max(battery, 0)), kind)


def static_geometry(dialect: Dialect, class_name: str, dimensions: Vector) -> str:
    """GEO of a platform that stands fixed; only `ut2004` tells its dimensions (m)."""
    size = (triple("Dimensions", dimensions, _DIGITS),) if dialect is Dialect.UT2004 else ()
    return line("GEO", segment("Type", _PLATFORMS[dialect]), segment("Name", class_name), *size)


def static_configuration(dialect: Dialect, class_name: str) -> str:
    """CONF of a platform that stands fixed; `udk` adds that it neither steers nor weighs."""
    kind, name = segment("Type", _PLATFORMS[dialect]), segment("Name", class_name)
    if dialect is Dialect.UT2004:
        return line("CONF", kind, name)
    return line("CONF", name, kind, segment("SteeringType", "None"), segment("Mass", "0"))


def light_battery_view(status: VehicleStatus) -> tuple[str, ...]:
    """The end of most STA lines."""
    return _light_battery_view(status.light, status.light_intensity, status.battery, status.view)


def _light_battery_view(light: bool, intensity: int, battery: int, view: int) -> tuple[str, ...]:
    return (
        flag("LightToggle", light),
        count("LightIntensity", max(intensity, 0)),
        count("Battery", max(battery, 0)),
        count("View", view),
    )


def _steer_limit(key: str, value: float, steered: bool) -> str:
    """An angle, or the literal 0 that the UDK server printed for skid steer."""
    return number(key, value, _DIGITS) if steered else segment(key, "0")
