"""What a server says beside sensors: status, configuration, geometry, results, the world.

Frozen values in m, rad, s and the frame of the wire (see `frames`), the same for both dialects.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from usarsim_client.declared import NOWHERE, Part, many, text, whole, wire
from usarsim_client.segments import Item, boolean, groups, integer, number, vector
from usarsim_server.protocol.values import Segment, Vector


class Report:
    """What a line tells that is none of sensors."""

    __slots__ = ()


_STATUS = frozenset(
    {
        *("time", "type", "battery", "lighttoggle", "lightintensity", "frontsteer", "rearsteer"),
        *("view", "name"),
    }
)


def _joints(item: Item) -> dict[str, float]:
    """What a status tells beside what all do."""
    return {key: number(value) for key, value in item.segments if key.lower() not in _STATUS}


def _closed(item: Item) -> bool:
    return item.fields.get("status", "").upper() == "CLOSED" or "on" in item.fields


def _extents(value: str) -> Vector:
    """UDK negates the height."""
    width, depth, height = vector(value)
    return abs(width), abs(depth), abs(height)


def _bones(item: Item) -> dict[str, Vector]:
    found = (bone.fields for bone in groups(item, ("bone",)))
    return {bone["bone"]: vector(bone.get("rotation", "")) for bone in found}


def _own(key: str) -> Part:
    """A place of an item; a mission package tells those of its links only."""

    def part(item: Item) -> Vector:
        if item.segments and item.segments[0][0].lower() == "link":
            return NOWHERE
        return vector(item.fields.get(key, ""))

    return part


def _beyond_status(item: Item) -> tuple[Segment, ...]:
    told = ("time", "type", "name", "status")
    return tuple(segment for segment in item.segments if segment[0].lower() not in told)


@dataclass(frozen=True, slots=True)
class Status(Report):
    """STA: a robot.

    Attributes:
        time: simulated s.
        type: kind of vehicle, as GroundVehicle; empty where the server tells none.
        battery: s of expected life; 99999 without a battery, None if not told.
        light: headlight is on. light_intensity: percent.
        front_steer, rear_steer: rad, right positive; 0 for skid steer.
        view: viewport that shows the robot, -1 for none.
        joints: positions by name, rad or m: flippers, legs, rudder, what else the line tells.
    """

    time: float
    type: str = wire(text, "Type", default="")
    battery: int | None = wire(integer, "Battery", default=None)
    light: bool = wire(boolean, "LightToggle", default=False)
    light_intensity: int = wire(integer, "LightIntensity", default=0)
    front_steer: float = wire(number, "FrontSteer", default=0.0)
    rear_steer: float = wire(number, "RearSteer", default=0.0)
    view: int = wire(integer, "View", default=-1)
    joints: Mapping[str, float] = whole(_joints)


@dataclass(frozen=True, slots=True)
class LinkState:
    """A link of an actuator, numbered from 1. value: rad or m. torque: N m or N; NaN in `udk`."""

    link: int = wire(integer, "Link")
    value: float = wire(number, "Value", default=math.nan)
    torque: float = wire(number, "Torque", default=math.nan)


@dataclass(frozen=True, slots=True)
class MissionState(Report):
    """MISSTA, ASTA: an arm, a pan-tilt, a mission package."""

    name: str
    time: float
    links: tuple[LinkState, ...] = many(LinkState, "Link")


@dataclass(frozen=True, slots=True)
class EffectorState(Report):
    """EFF: a gripper or tool changer.

    Attributes:
        name, type: of the item. time: simulated s.
        closed: holds something, or is switched on.
        tool_type, tool: what a tool changer holds; empty for nothing.
    """

    name: str
    time: float
    type: str = wire(text, "Type", default="")
    closed: bool = whole(_closed)
    tool_type: str = wire(text, "ToolType", default="")
    tool: str = wire(text, "Tool", default="")


@dataclass(frozen=True, slots=True)
class AvatarStatus(Report):
    """STA of an avatar. location: m. orientation: roll, pitch, yaw, rad. walking: under way."""

    name: str
    time: float
    type: str = wire(text, "Type", default="")
    location: Vector = wire(vector, "Location", default=NOWHERE)
    orientation: Vector = wire(vector, "Orientation", default=NOWHERE)
    walking: bool = wire(boolean, "Walking")


@dataclass(frozen=True, slots=True)
class AvatarBones(Report):
    """BSTA: rotation (roll, pitch, yaw, rad) of the bones of an avatar, by their names."""

    name: str
    time: float
    bones: Mapping[str, Vector] = whole(_bones)


@dataclass(frozen=True, slots=True)
class ObjectStatus:
    """An object of a world controller.

    Attributes:
        name: of the object. size: extents, m. memory: text of its creation.
        location: m. rotation: roll, pitch, yaw, rad.
    """

    name: str
    size: Vector = wire(_extents, "Size", default=NOWHERE)
    location: Vector = wire(vector, "Location", default=NOWHERE)
    rotation: Vector = wire(vector, "Rotation", default=NOWHERE)
    memory: str = wire(text, "Memory", default="")


@dataclass(frozen=True, slots=True)
class ObjectList(Report):
    """STA of a world controller: all objects that it asked for."""

    objects: tuple[ObjectStatus, ...]


@dataclass(frozen=True, slots=True)
class ItemConfiguration:
    """CONF of one item.

    Attributes:
        name: of the item.
        fields: the first value of each key, as sent, by the key in lower case.
        links: the same for each link of an actuator, in order.
    """

    name: str
    fields: Mapping[str, str] = whole(lambda item: item.fields)
    links: tuple[Mapping[str, str], ...] = whole(
        lambda item: tuple(link.fields for link in groups(item, ("link",)))
    )

    def number(self, key: str) -> float:
        """A value as a number, in the unit of the wire; NaN without one."""
        return number(self.fields.get(key.lower(), ""))


@dataclass(frozen=True, slots=True)
class Configuration(Report):
    """CONF of sensors, actuators and effectors of a type."""

    type: str
    items: tuple[ItemConfiguration, ...]


@dataclass(frozen=True, slots=True)
class VehicleConfiguration(Report):
    """CONF of a vehicle; NaN for what is not told.

    Attributes:
        class_name, type: P3AT and GroundVehicle, for example.
        steering: SkidSteered, AckermanSteered, RotaryWing ...; empty if not told.
        mass: kg. max_speed: of the wheels, rad/s. max_torque: N m.
        max_front_steer, max_rear_steer: rad.
        fields: all values as sent, by the key in lower case.
    """

    class_name: str = wire(text, "Name", default="")
    type: str = wire(text, "Type", default="")
    steering: str = wire(text, "SteeringType", default="")
    mass: float = wire(number, "Mass", default=math.nan)
    max_speed: float = wire(number, "MaxSpeed", default=math.nan)
    max_torque: float = wire(number, "MaxTorque", default=math.nan)
    max_front_steer: float = wire(number, "MaxFrontSteer", default=math.nan)
    max_rear_steer: float = wire(number, "MaxRearSteer", default=math.nan)
    fields: Mapping[str, str] = whole(lambda item: item.fields)


@dataclass(frozen=True, slots=True)
class CameraConfiguration:
    """CONF of one camera.

    Attributes:
        name: of the camera.
        tile: x, y, width, height of its part of the picture of the image port, pixels; None
            where the dialect tells none.
        fov, default_fov, min_fov, max_fov: horizontal, rad.
    """

    name: str
    tile: tuple[int, int, int, int] | None
    fov: float
    default_fov: float
    min_fov: float
    max_fov: float


@dataclass(frozen=True, slots=True)
class CameraConfigurations(Report):
    """CONF of cameras; may come unasked, when a tile is assigned."""

    cameras: tuple[CameraConfiguration, ...]


@dataclass(frozen=True, slots=True)
class LinkGeometry:
    """Where a link is at zero. link, parent: numbers from 1, 0 or less for the base; m, rad."""

    link: int = wire(integer, "Link")
    parent: int = wire(integer, "ParentLink", "Parent", default=-1)
    location: Vector = wire(vector, "Location", default=NOWHERE)
    orientation: Vector = wire(vector, "Orientation", default=NOWHERE)


@dataclass(frozen=True, slots=True)
class ItemGeometry:
    """GEO of one item.

    Attributes:
        name: of the item.
        location: m. orientation: roll, pitch, yaw, rad; in the frame of what carries it.
        mount: what carries it, a part, an actuator, the class of the robot, or HARD.
        mount_link: link of that actuator, from 1; None if not told.
        tip: tool point of an actuator or effector, m; None if not told.
        links: of an actuator.
    """

    name: str
    location: Vector = whole(_own("location"))
    orientation: Vector = whole(_own("orientation"))
    mount: str = wire(text, "Mount", default="")
    mount_link: int | None = wire(integer, "MountLink", default=None)
    tip: Vector | None = wire(vector, "Tip", default=None)
    links: tuple[LinkGeometry, ...] = many(LinkGeometry, "Link")


@dataclass(frozen=True, slots=True)
class Geometry(Report):
    """GEO of sensors, actuators and effectors of a type."""

    type: str
    items: tuple[ItemGeometry, ...]


@dataclass(frozen=True, slots=True)
class VehicleGeometry(Report):
    """GEO of a vehicle, m; NaN for what is not told.

    Attributes:
        class_name, type: P3AT and GroundVehicle, for example.
        dimensions: length, width, height. cog: centre of gravity.
        wheel_radius: of the wheels. wheel_separation: left to right. wheel_base: front to rear.
    """

    class_name: str = wire(text, "Name", default="")
    type: str = wire(text, "Type", default="")
    dimensions: Vector = wire(vector, "Dimensions", default=NOWHERE)
    cog: Vector = wire(vector, "COG", default=NOWHERE)
    wheel_radius: float = wire(number, "WheelRadius", default=math.nan)
    wheel_separation: float = wire(number, "WheelSeparation", default=math.nan)
    wheel_base: float = wire(number, "WheelBase", "Wheelbase", default=math.nan)


@dataclass(frozen=True, slots=True)
class Result(Report):
    """RES: what became of a SET (`ut2004` only).

    Attributes:
        type, name: of the item. time: simulated s.
        ok: whether the item obeyed.
        segments: what follows the status, as `("Mem", "text of the tag")`.
    """

    name: str
    time: float
    type: str = wire(text, "Type", default="")
    ok: bool = wire(lambda value: value.upper() == "OK", "Status", default=False)
    segments: tuple[Segment, ...] = whole(_beyond_status)


@dataclass(frozen=True, slots=True)
class Greeting(Report):
    """The first line of a server. level: name of the world. time_limit: minutes, 0 for none."""

    game_type: str = wire(text, "Gametype", default="")
    level: str = wire(text, "Level", default="")
    time_limit: int = wire(integer, "TimeLimit", default=0)


@dataclass(frozen=True, slots=True)
class StartPose:
    """A place with a name: a start pose or a path node; m and rad."""

    tag: str
    location: Vector
    orientation: Vector


@dataclass(frozen=True, slots=True)
class StartPoses(Report):
    """The places where robots can start."""

    poses: tuple[StartPose, ...]


@dataclass(frozen=True, slots=True)
class PathNodes(Report):
    """The nodes that avatars walk along."""

    nodes: tuple[StartPose, ...]


@dataclass(frozen=True, slots=True)
class ClosestNode(Report):
    """The node next to a place; m."""

    tag: str = wire(text, "Pathnode", default="")
    location: Vector = wire(vector, "Location", default=NOWHERE)


@dataclass(frozen=True, slots=True)
class Tick(Report):
    """A tick of lockstep has passed; the world stands still. time: simulated s."""

    time: float


@dataclass(frozen=True, slots=True)
class Event(Report):
    """NFO with a Status: something happened by itself, as BatteryEmpty.

    Attributes:
        event: one word. type, name: of the item; empty if not told. time: simulated s.
        reason: what the server says about it; empty if nothing.
    """

    name: str
    time: float
    event: str = wire(text, "Status", default="")
    type: str = wire(text, "Type", default="")
    reason: str = wire(text, "Reason", default="")


@dataclass(frozen=True, slots=True)
class Death(Report):
    """DIE: the game killed the robot."""

    killer: str = wire(text, "Killer", default="")
    damage_type: str = wire(text, "DamageType", default="")


@dataclass(frozen=True, slots=True)
class Other(Report):
    """A line of a head that this client does not know; at most 16 letters of the head."""

    head: str
    segments: tuple[Segment, ...]


def camera(item: Item) -> CameraConfiguration:
    """A camera by its CONF; `udk` tells degrees and a tile, `ut2004` radians and none."""
    fields = item.fields
    corner = ("textureoffsetx", "textureoffsety", "textureresolutionx", "textureresolutiony")
    tiled = all(key in fields for key in corner)
    unit = math.radians(1.0) if tiled else 1.0

    def angle(key: str) -> float:
        return number(fields.get(key, "")) * unit

    tile = None
    if tiled:
        x, y, width, height = (number(fields[key]) for key in corner)
        if width > 0 and height > 0 and x >= 0 and y >= 0:
            tile = int(x), int(y), int(width), int(height)
    return CameraConfiguration(
        item.name,
        tile,
        angle("camerafov"),
        angle("cameradeffov"),
        angle("cameraminfov"),
        angle("cameramaxfov"),
    )


def start_poses(segments: tuple[Segment, ...]) -> tuple[StartPose, ...]:
    """Places in all three forms of the generations (protocol reference 4.2).

    Flat, `{tag v v tag v v}`; one segment each, `{tag v v}`; named, `{Name tag Location v
    Orientation v}`.

    Args:
        segments: what follows the count.
    """
    poses: list[StartPose] = []
    for key, value in segments:
        words = [key, *value.split()]
        if key.lower() == "name":
            words = [word for word in words[1:] if word.lower() not in ("location", "orientation")]
        poses += [
            StartPose(tag, vector(location), vector(orientation))
            for tag, location, orientation in zip(
                words[::3], words[1::3], words[2::3], strict=False
            )
        ]
    return tuple(poses)
