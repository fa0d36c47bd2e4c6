"""Mission packages, arms and effectors (protocol reference 4.7 to 4.9).

Links are given in model order and are numbered from 1 on the wire, in both dialects.

GEO, CONF and STA of what neither rolls nor stands fixed (protocol reference 4.4, 4.7, 4.8).

The UDK server told nothing but the name of flying and legged machines; a Type is always added,
since clients need one and none is known to reject it (protocol 5.2 no. 17). Where the UT2004 form
is only partly known, further members follow those that are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.messages.sensors import carrier
from usarsim_server.protocol.messages.text import (
    count,
    line,
    listing,
    number,
    numbers,
    segment,
    time_segment,
    token,
    triple,
)
from usarsim_server.protocol.messages.vehicles import VehicleStatus, light_battery_view
from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Item, Vector

_ZERO: Vector = (0.0, 0.0, 0.0)

ENDLESS = (-math.pi, math.pi)
"""Limits (rad or m) that CONF Actuator states for a joint without any: programs of that generation
make sliders of them, and a minimum above the maximum ends those."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorLink:
    """One link of an actuator."""

    joint_type: str = "Revolute"  # Revolute, Prismatic, Scissor (`ut2004`) or Unknown (`udk`)
    max_speed: float = 0.0  # rad/s or m/s
    max_torque: float = 0.0  # N m or N
    limits: tuple[float, float] | None = None
    """Lowest and highest position, rad or m; None if it moves freely."""
    parent: int | None = None  # number of the parent link, from 1; None for the base
    location: Vector = _ZERO  # m, relative to the parent at zero
    rotation: Vector = _ZERO  # roll, pitch, yaw, rad


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectorMount:
    """Where a gripper or tool changer sits."""

    name: str  # item name
    location: Vector = _ZERO  # m, wire frame of the carrier
    rotation: Vector = _ZERO  # roll, pitch, yaw, rad
    mount: str = "HARD"  # robot class, or the actuator that carries this one
    mount_link: int | None = None  # link of that actuator, from 1
    tip: Vector = _ZERO  # tool point, m, relative to the last link of an actuator


@dataclass(frozen=True, slots=True, kw_only=True)
class ActuatorItem(EffectorMount):
    """A mission package or arm, its base where an effector would sit."""

    links: tuple[ActuatorLink, ...] = ()  # in model order


def actuator_status(
    dialect: Dialect, time: float, name: str, links: Sequence[tuple[float, float]]
) -> str:
    """MISSTA (`ut2004`, with Torque) or ASTA (`udk`) of one actuator.

    Args:
        dialect: decides head, digits and Torque.
        time: simulated s.
        name: item name.
        links: present position (rad or m) and torque (N m or N) of each link.
    """
    facets = FACETS[dialect]
    body: list[str] = []
    for index, (value, torque) in enumerate(links, start=1):
        body += (count("Link", index), number("Value", value, 4))
        if dialect is Dialect.UT2004:
            body.append(number("Torque", torque, 2))
    stamp = time_segment(time, facets.time_digits)
    return line(facets.mission_package_head, stamp, segment("Name", name), *body)


def effector_status(
    time: float, wire_type: str, name: str, closed: bool, tool: tuple[str, str] | None = None
) -> str:
    """EFF of a gripper or tool changer (`udk`).

    Args:
        time: simulated s.
        wire_type: Gripper or ToolChanger.
        name: item name.
        closed: whether it holds.
        tool: type and name of the tool that a tool changer holds.
    """
    held = (segment("ToolType", tool[0]), segment("Tool", tool[1])) if tool and closed else ()
    return line(
        "EFF",
        time_segment(time, FACETS[Dialect.UDK].time_digits),
        segment("Type", wire_type),
        segment("Name", name),
        segment("Status", "CLOSED" if closed else "OPEN"),
        *held,
    )


def mission_package_geometry(packages: Sequence[ActuatorItem]) -> str:
    """GEO MisPkg: links relative to their parents, ParentLink -1 for the body."""
    body: list[str] = []
    for package in packages:
        body.append(segment("Name", package.name))
        for index, link in enumerate(package.links, start=1):
            body += (
                count("Link", index),
                count("ParentLink", -1 if link.parent is None else link.parent),
                triple("Location", link.location, 4),
                triple("Orientation", link.rotation, 4),
            )
    return listing("GEO", "MisPkg", body)


def actuator_geometry(actuators: Sequence[ActuatorItem]) -> str:
    """GEO Actuator: base, links relative to their parents (Parent 0 for the base), tool point."""
    body: list[str] = []
    for actuator in actuators:
        body += (
            segment("Name", actuator.name),
            triple("Location", actuator.location, 3),
            triple("Orientation", actuator.rotation, 3),
            *carrier(actuator.mount, actuator.mount_link),
        )
        for index, link in enumerate(actuator.links, start=1):
            body += (
                count("Link", index),
                count("Parent", link.parent or 0),
                triple("Location", link.location, 3),
                triple("Orientation", link.rotation, 2),
            )
        body.append(triple("Tip", actuator.tip, 2))
    return listing("GEO", "Actuator", body)


def effector_geometry(wire_type: str, mounts: Sequence[EffectorMount]) -> str:
    """GEO of grippers or tool changers."""
    body: list[str] = []
    for mount in mounts:
        body += (
            segment("Name", mount.name),
            triple("Location", mount.location, 2),
            triple("Orientation", mount.rotation, 2),
            *carrier(mount.mount, mount.mount_link),
            triple("Tip", mount.tip, 2),
        )
    return listing("GEO", wire_type, body)


def mission_package_configuration(dialect: Dialect, packages: Sequence[ActuatorItem]) -> str:
    """CONF MisPkg; answered in both dialects, `udk` in its own old form."""
    body: list[str] = []
    for package in packages:
        body.append(segment("Name", package.name))
        for index, link in enumerate(package.links, start=1):
            body += (count("Link", index), segment("JointType", link.joint_type))
            if dialect is Dialect.UT2004:
                body += (
                    number("MaxSpeed", link.max_speed, 2),
                    number("MaxTorque", link.max_torque, 2),
                )
            else:
                body += (
                    number("MaxRotationSpeed", link.max_speed, 3),
                    number("MaxTorque", link.max_torque, 4),
                )
            body += _limits("MinRange", "MaxRange", link.limits)
    return listing("CONF", "MisPkg", body)


def actuator_configuration(actuators: Sequence[ActuatorItem]) -> str:
    """CONF Actuator: joint type, torque and limits of every link."""
    body: list[str] = []
    for actuator in actuators:
        body.append(segment("Name", actuator.name))
        for index, link in enumerate(actuator.links, start=1):
            body += (
                count("Link", index),
                segment("JointType", link.joint_type),
                number("MaxTorque", link.max_torque, 4),
                *_limits("MinValue", "MaxValue", link.limits or ENDLESS),
            )
    return listing("CONF", "Actuator", body)


def gripper_item(name: str) -> Item:
    """A gripper as `configuration("Gripper", ...)` wants it."""
    opcodes = (("Opcode", "Grip"), ("MaxVal", "1"), ("MinVal", "0"))
    return Item(name, (*opcodes, ("Opcode", "Close"), ("Opcode", "Open")))


def tool_changer_item(name: str, position_tolerance: float, angle_tolerance: float) -> Item:
    """A tool changer as `configuration("ToolChanger", ...)` wants it; tolerances in m and rad."""
    return Item(
        name,
        (
            ("PositionTolerance", fixed(position_tolerance, 4)),
            ("AngleTolerance", fixed(angle_tolerance, 4)),
            ("Opcode", "Close"),
            ("Opcode", "Open"),
        ),
    )


def _limits(low: str, high: str, limits: tuple[float, float] | None) -> tuple[str, str]:
    """Position limits; a minimum above the maximum means none (protocol reference 4.8)."""
    if limits is None:
        return segment(low, "1"), segment(high, "0")
    return number(low, limits[0], 4), number(high, limits[1], 4)


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
    status: VehicleStatus, joints: Sequence[tuple[str, float]], dialect: Dialect
) -> str:
    """STA of a legged machine.

    Args:
        status: of the machine.
        joints: names and positions (rad) in model order.
        dialect: decides Type, order and digits.
    """
    kind = segment("Type", _LEGGED[dialect])
    stamp = time_segment(status.time, FACETS[dialect].time_digits)
    values = numbers(joints, _DIGITS)
    if dialect is Dialect.UDK:
        return line("STA", stamp, count("Battery", max(status.battery, 0)), kind, *values)
    return line("STA", kind, stamp, *values, *light_battery_view(status))


def nautic_status(
    status: VehicleStatus, rudder: float, stern_plane: float, dialect: Dialect
) -> str:
    """STA of an underwater machine, which only the UT2004 generation had.

    Args:
        status: of the machine.
        rudder, stern_plane: as commanded, rad.
        dialect: decides the digits of Time.
    """
    return line(
        "STA",
        segment("Type", "NauticVehicle"),
        time_segment(status.time, FACETS[dialect].time_digits),
        number("RudderAngle", rudder, _DIGITS),
        number("SternPlaneAngle", stern_plane, _DIGITS),
        *light_battery_view(status),
    )
