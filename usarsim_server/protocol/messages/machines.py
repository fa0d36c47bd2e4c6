"""GEO, CONF and STA of what neither rolls nor stands fixed (protocol reference 4.4, 4.7, 4.8).

The UDK server told nothing but the name of flying and legged machines; a Type is always added,
since clients need one and none is known to reject it (5.2 no. 17). Where the UT2004 form is only
partly known, further members follow those that are.
"""

from __future__ import annotations

from collections.abc import Sequence

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages.text import (
    count,
    flag,
    line,
    number,
    segment,
    time_segment,
    token,
    triple,
)
from usarsim_server.protocol.values import Dialect, Vector

__all__ = [
    "legged_status",
    "machine_configuration",
    "machine_geometry",
    "nautic_status",
]

_DIGITS = 4
_LEGGED = {Dialect.UT2004: "LeggedRobot", Dialect.UDK: "LeggedVehicle"}


def machine_geometry(
    dialect: Dialect, wire_type: str, class_name: str, dimensions: Vector, cog: Vector
) -> str:
    """GEO of a machine without wheels; only `ut2004` tells dimensions and centre of gravity, m.

    Args:
        dialect: decides the members.
        wire_type: AerialVehicle, NauticVehicle or LeggedRobot.
        class_name: robot class without package.
        dimensions: length, width, height. cog: in the wire frame.
    """
    sizes = (triple("Dimensions", dimensions, _DIGITS), triple("COG", cog, _DIGITS))
    return line(
        "GEO",
        segment("Type", wire_type),
        segment("Name", class_name),
        *(sizes if dialect is Dialect.UT2004 else ()),
    )


def machine_configuration(
    dialect: Dialect,
    wire_type: str,
    class_name: str,
    steering_type: str,
    mass: float,
    limits: Sequence[tuple[str, float]],
) -> str:
    """CONF of a machine without wheels.

    Args:
        dialect: `udk` puts Name first.
        wire_type: AerialVehicle, NauticVehicle or LeggedRobot.
        class_name: robot class without package.
        steering_type: RotaryWing, VariableDepth, TwoLegs, FourLegs and the like.
        mass: kg.
        limits: names and values of further members.
    """
    kind, name = segment("Type", wire_type), segment("Name", class_name)
    return line(
        "CONF",
        *((kind, name) if FACETS[dialect].type_before_name else (name, kind)),
        segment("SteeringType", steering_type),
        number("Mass", mass, _DIGITS),
        *(number(token(key), value, _DIGITS) for key, value in limits),
    )


def legged_status(
    dialect: Dialect,
    time: float,
    joints: Sequence[tuple[str, float]],
    light: bool,
    light_intensity: int,
    battery: int,
    view: int,
) -> str:
    """STA of a legged machine.

    Args:
        dialect: decides Type, order and digits.
        time: simulated s.
        joints: names and positions (rad) in model order.
        light: headlight is on. light_intensity: percent.
        battery: s of expected life; 99999 if there is no battery.
        view: viewport that shows the robot, -1 if none.
    """
    kind = segment("Type", _LEGGED[dialect])
    stamp = time_segment(time, FACETS[dialect].time_digits)
    values = [number(token(name), value, _DIGITS) for name, value in joints]
    charge = count("Battery", max(battery, 0))
    if dialect is Dialect.UDK:
        return line("STA", stamp, charge, kind, *values)
    lamp = (flag("LightToggle", light), count("LightIntensity", max(light_intensity, 0)))
    return line("STA", kind, stamp, *values, *lamp, charge, count("View", view))


def nautic_status(
    dialect: Dialect,
    time: float,
    rudder: float,
    stern_plane: float,
    light: bool,
    light_intensity: int,
    battery: int,
    view: int,
) -> str:
    """STA of an underwater machine, which only the UT2004 generation had.

    Args:
        dialect: decides the digits of Time.
        time: simulated s.
        rudder, stern_plane: rad.
        light: headlight is on. light_intensity: percent.
        battery: s of expected life; 99999 if there is no battery.
        view: viewport that shows the robot, -1 if none.
    """
    return line(
        "STA",
        segment("Type", "NauticVehicle"),
        time_segment(time, FACETS[dialect].time_digits),
        number("RudderAngle", rudder, _DIGITS),
        number("SternPlaneAngle", stern_plane, _DIGITS),
        flag("LightToggle", light),
        count("LightIntensity", max(light_intensity, 0)),
        count("Battery", max(battery, 0)),
        count("View", view),
    )
