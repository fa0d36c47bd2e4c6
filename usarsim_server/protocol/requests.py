"""What clients ask for, as typed frozen values (protocol reference 3).

Numbers are as sent: finite, in the units and the frame of the wire. `None` means that the client
did not send the segment; whether an absent member keeps its last value is the dialect's matter.
Create these only through `commands.interpret` or by keyword.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TypeVar

from usarsim_server.protocol.grammar import first_value
from usarsim_server.protocol.values import Dialect, Hearing, Segment, Vector

T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Init:
    """Spawn a robot (protocol 3.2)."""

    class_name: str  # class without package, spelled as sent; empty if the segment is missing
    package: str = ""  # text before the last point of the class, empty if there is none
    spelled_classname_exactly: bool = False
    """The segment was named `Classname`, as the ROS and MOAST family does (dialect signal 1)."""
    name: str | None = None  # robot label; None if missing or empty
    location: Vector | None = None  # metres, wire frame; None if missing or empty
    rotation: Vector | None = None  # roll, pitch, yaw in rad; None if missing or empty
    start: str | None = None  # tag of a start position, wins over location and rotation
    dialect: Dialect | None = None  # the dialect that the client forces
    battery: float | None = None  # battery life in s
    team: int | None = None  # team number
    skin: str | None = None  # texture name
    exact_name: bool = False
    """It comes under its name as it is spelled or not at all, and is told why not (of our own)."""
    segments: tuple[Segment, ...] = ()  # everything as sent


@dataclass(frozen=True, slots=True)
class GetStartPoses:
    """List the start positions (protocol 3.3)."""

    exact_name: bool = False  # first of all, say that `Init.exact_name` is known here


@dataclass(frozen=True, slots=True)
class GetPathNodes:
    """List the nodes of the walking graph (protocol 3.3)."""


@dataclass(frozen=True, slots=True)
class GetClosestPathNode:
    """Name the node nearest to a location (m); without a location there is no answer
    (protocol 3.3)."""

    location: Vector | None = None


@dataclass(frozen=True, slots=True)
class WheelTarget:
    """One group of a wheel by wheel DRIVE (protocol 3.4.3)."""

    number: int  # wheel, counted from 0
    speed: float | None = None  # wheel spin in rad/s or percent; None if the group has none
    steer: float | None = None  # steering angle in rad; None if the group has none


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """Targets for the vehicle, all families of protocol 3.4 in one value; clients mix them.

    Attributes:
        normalized: speeds are percent of the maximum; None if the client did not say.
        passing: not the controller's own: `normalized` holds for this command in every dialect.
        light: headlight. flip: put the overturned robot back on its wheels.
        left, right: skid steer, wheel spin of each side, rad/s, positive rolls forward.
        speed: Ackerman, wheel spin, rad/s. front_steer, rear_steer: rad.
        wheels: omnidirectional, wheel by wheel.
        altitude_velocity: m/s, up positive. linear_velocity: m/s, forward.
        lateral_velocity: m/s, right. rotational_velocity: clockwise, unit by dialect.
        pitch_angle, roll_angle: degrees (UDK). spin1, spin2: propeller visuals (UDK).
        propeller: rad/s. rudder, stern_plane: rad.
        name: joint of the single joint form; wheel commands may carry a robot's name here.
        value: rad or m (order 0), rad/s or m/s (order 1), N m or N (order 2).
        order: 0 position, 1 velocity, 2 torque. steer: 1 for the steering axis of a wheel joint.
        bone, axis: skeletal robots.
        p_gain, i_gain, d_gain, max_torque: servo of the joint (UT3).
    """

    normalized: bool | None = None
    light: bool | None = None
    flip: bool = False
    left: float | None = None
    right: float | None = None
    speed: float | None = None
    front_steer: float | None = None
    rear_steer: float | None = None
    wheels: tuple[WheelTarget, ...] = ()
    altitude_velocity: float | None = None
    linear_velocity: float | None = None
    lateral_velocity: float | None = None
    rotational_velocity: float | None = None
    pitch_angle: float | None = None
    roll_angle: float | None = None
    spin1: float | None = None
    spin2: float | None = None
    propeller: float | None = None
    rudder: float | None = None
    stern_plane: float | None = None
    name: str | None = None
    value: float | None = None
    order: int = 0
    steer: int = 0
    bone: str | None = None
    axis: str | None = None
    p_gain: float | None = None
    i_gain: float | None = None
    d_gain: float | None = None
    max_torque: float | None = None
    passing: bool = False


@dataclass(frozen=True, slots=True)
class MultiDrive:
    """Position targets (rad) of several joints by name in lower case (protocol 3.5)."""

    joints: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class Set:
    """Change an item (protocol 3.7)."""

    type: str  # item type as sent
    name: str | None = None  # item name; None addresses all items of the type
    opcode: str | None = None  # upper case; None if the client sent none
    params: str = ""  # text of the parameter, empty if there is none
    segments: tuple[Segment, ...] = ()
    """Everything as sent, for the types that have segments of their own."""
    hearing: Hearing | None = None  # takes notice of what is asked for

    def get(self, name: str, default: str | None = None) -> str | None:
        """Value of the first segment of this name in any case, `default` if there is none."""
        if self.hearing is not None:
            self.hearing.ask(name)
        return first_value(self.segments, name, default)


@dataclass(frozen=True, slots=True)
class GetConf:
    """Ask for the configuration of the items of a type, or of one of them (protocol 3.8)."""

    type: str
    name: str | None = None


@dataclass(frozen=True, slots=True)
class GetGeo:
    """Ask for the geometry of the items of a type, or of one of them (protocol 3.8)."""

    type: str
    name: str | None = None


@dataclass(frozen=True, slots=True)
class LinkTarget:
    """Target of one link of an actuator."""

    link: int  # number as sent: from 1 in MISPKG, from 0 in ACT (protocol 5.2 no. 5).
    value: float  # rad or m for order 0, their rates for order 1, N m or N for order 2
    order: int = 0  # 0 position, 1 velocity, 2 torque


@dataclass(frozen=True, slots=True, kw_only=True)
class MisPkg:
    """Move a mission package; links count from 1 (protocol 3.9, and 3.6 for the old pan-tilt
    form)."""

    name: str
    groups: tuple[LinkTarget, ...] = ()
    gripper: int | None = None
    seq: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Act:
    """Move an actuator; links count from 0 (protocol 3.10)."""

    name: str
    groups: tuple[LinkTarget, ...] = ()
    gripper: int | None = None
    seq: int | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Move:
    """Let an avatar walk (protocol 3.13)."""

    type: str | None = None  # gait, for example Walk_Forward
    action: str | None = None  # New, Append, Pause or Resume
    location: tuple[float, float] | None = None  # x and y in m
    pathnode: str | None = None  # node to walk to


@dataclass(frozen=True, slots=True)
class Goto:
    """Let an avatar walk to a path node (protocol 3.13)."""

    name: str


@dataclass(frozen=True, slots=True)
class Control:
    """A request to the world controller (protocol 3.14); its segments depend on the type."""

    type: str
    segments: tuple[Segment, ...] = ()
    hearing: Hearing | None = None  # takes notice of what is asked for

    def get(self, name: str, default: str | None = None) -> str | None:
        """Value of the first segment of this name in any case, `default` if there is none."""
        if self.hearing is not None:
            self.hearing.ask(name)
        return first_value(self.segments, name, default)

    def read(self, name: str, read: Callable[[str], T]) -> T | None:
        """What that value means, None if there is none."""
        if self.hearing is not None:
            self.hearing.ask(name, read)
        text = first_value(self.segments, name)
        return None if text is None else read(text)


@dataclass(frozen=True, slots=True)
class Ignored:
    """A command that is known and has no effect here (protocol 3.12, 3.15)."""

    word: str


@dataclass(frozen=True, slots=True)
class Unknown:
    """A command nobody knows, at most 40 characters of it; logged, without effect
    (protocol 1.7)."""

    word: str


@dataclass(frozen=True, slots=True)
class Sync:
    """The world may go on, as far as this controller is concerned (lockstep; new here)."""

    ticks: int = 1  # how many ticks, at least one


Request = (
    Init
    | GetStartPoses
    | GetPathNodes
    | GetClosestPathNode
    | Drive
    | MultiDrive
    | Set
    | GetConf
    | GetGeo
    | MisPkg
    | Act
    | Move
    | Goto
    | Control
    | Sync
    | Ignored
    | Unknown
)
"""Everything `commands.interpret` can return."""
