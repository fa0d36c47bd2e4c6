"""Cars, whose wheels are steered by axle (protocol reference 3.4.2, robots reference 1.4, 4.9), and
robots whose wheels are driven and steered one by one (protocol 3.4.3, 3.4.6).

A steered wheel sits on a link of an actuator with `package = false`; as in the original, joints
whose name contains FrontSteer or RearSteer are the steering joints. By default every wheel stands
square to the line to the centre of the turn and rolls at its own speed, so the robot turns on the
radius that its angles ask for; the original gave all of them the same angle and speed. The limits
of a robot file are those of the angles that clients send; the wheel inside of a turn goes further,
and its joint has the room for it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import mujoco
import numpy as np

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.requests import Drive, WheelTarget
from usarsim_server.protocol.values import Dialect
from usarsim_server.robots.description import (
    ActuatorDescription,
    LinkDescription,
    RobotDescription,
    Wheel,
)
from usarsim_server.robots.families.base import (
    DriveController,
    StatusFacts,
    register_family,
    tell_clamped,
    within,
)
from usarsim_server.robots.families.wheeled import SpeedScale, WheelController, WheeledFamily
from usarsim_server.robots.reading import parts
from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.simulation import BodyHandle

FRONT, REAR = "frontsteer", "rearsteer"
GRID = 41
"""Angles of an axle that are tried to find out how far its wheels turn."""
STRAIGHT = 1e-4
"""rad: below this a wheel counts as straight when the mean angle of an axle is taken."""


@dataclass(frozen=True, slots=True)
class SteeredWheel:
    """A wheel as steering sees it, simulation frame."""

    x: float  # of its contact with the floor, m from the reference point
    y: float
    joint: str | None = None  # its steering joint; None: it points ahead
    front: bool = True  # its joint follows FrontSteer, otherwise RearSteer
    sense: float = 1.0
    """+1 if a positive joint position turns the wheel to the left, -1 if to the right."""
    limits: tuple[float, float] = (-math.pi, math.pi)  # of the joint, rad
    driven: bool = True  # it has a drive
    radius: float = 1.0  # m


def steered_wheels(
    wheels: Sequence[Wheel], actuators: Sequence[ActuatorDescription]
) -> tuple[SteeredWheel, ...]:
    """The wheels with the joints of the links that carry them."""
    by_body = {link.body: (actuator, link) for actuator in actuators for link in actuator.links}
    found = []
    for wheel in wheels:
        x, y, _ = parts.wheel_place(wheel, actuators)
        one = SteeredWheel(x, y, driven=wheel.driven, radius=wheel.radius)
        if wheel.link is not None:
            actuator, link = by_body[wheel.link]
            one = replace(
                one,
                joint=link.joint,
                front=REAR not in link.joint.lower(),
                sense=_sense(actuator, link),
                limits=link.limits or one.limits,
            )
        found.append(one)
    return tuple(found)


def _sense(actuator: ActuatorDescription, link: LinkDescription) -> float:
    """Whether positive positions of an upright axis turn to the left."""
    pose = actuator.pose if link.parent is None else Pose((0.0, 0.0, 0.0))
    up = (pose @ link.pose).rotate(link.axis)[2]
    return 1.0 if up >= 0.0 else -1.0


def turn(
    wheels: Sequence[SteeredWheel], front: float, rear: float, literal: bool
) -> tuple[list[float], list[float]]:
    """Angles and speeds of all wheels in a turn.

    The two angles are those of imagined wheels in the middle of the front and rear axle. The
    lines through the axles of all wheels meet in one point, the centre of the turn.

    Args:
        wheels: the wheels.
        front, rear: angles of the imagined wheels, rad, positive to the left.
        literal: the same for all instead.

    Returns:
        Angle of every wheel (rad, positive to the left; wheels without joint are straight) and
        its spin over that of the first wheel when running straight.
    """
    if literal:
        angles = [(front if wheel.front else rear) if wheel.joint else 0.0 for wheel in wheels]
        return angles, [1.0] * len(wheels)
    ahead, behind = _axles(wheels)
    # Rigid motion with unit speed ahead: sideways speed and yaw rate from the two conditions
    # tan(angle) = sideways speed at the axle.
    apart = max(ahead - behind, 1e-6)
    curvature = (math.tan(front) - math.tan(rear)) / apart
    sideways = math.tan(rear) - curvature * behind
    angles, speeds = [], []
    for wheel in wheels:
        forward, left = 1.0 - curvature * wheel.y, sideways + curvature * wheel.x
        smaller = wheels[0].radius / wheel.radius
        if wheel.joint is None:
            angles.append(0.0)
            speeds.append(forward * smaller)
            continue
        # A wheel beyond the centre of the turn rolls backwards rather than turn about.
        sign = 1.0 if forward >= 0.0 else -1.0
        angles.append(math.atan2(sign * left, sign * forward))
        speeds.append(sign * math.hypot(forward, left) * smaller)
    return angles, speeds


def wire_range(wheels: Sequence[SteeredWheel], front: bool) -> tuple[float, float]:
    """Lowest and highest FrontSteer or RearSteer (rad, positive to the right) of all joints."""
    ranges = [
        sorted(-wheel.sense * limit for limit in wheel.limits)
        for wheel in wheels
        if wheel.joint is not None and wheel.front == front
    ]
    low = max((one[0] for one in ranges), default=0.0)
    high = min((one[1] for one in ranges), default=0.0)
    return min(low, high), max(low, high)


def joint_ranges(steering: SteeredFamily) -> dict[str, tuple[float, float]]:
    """Positions (rad) that steering joints take in all turns within the limits."""
    found: dict[str, tuple[float, float]] = {}
    front, rear = (np.linspace(*wire_range(steering.wheels, one), GRID) for one in (True, False))
    for first in np.unique(front):
        for second in np.unique(rear):
            angles, _ = turn(steering.wheels, -first, -second, steering.literal)
            for wheel, angle in zip(steering.wheels, angles, strict=True):
                if wheel.joint is not None:
                    low, high = found.get(wheel.joint, wheel.limits)
                    position = wheel.sense * angle
                    found[wheel.joint] = min(low, position), max(high, position)
    return found


def _axles(wheels: Sequence[SteeredWheel]) -> tuple[float, float]:
    """Distance ahead of the reference point of the front and of the rear axle, m."""
    xs = [wheel.x for wheel in wheels]
    middle = (max(xs) + min(xs)) / 2.0
    front = [x for x in xs if x >= middle]
    rear = [x for x in xs if x < middle] or [min(xs)]
    return sum(front) / len(front), sum(rear) / len(rear)


@dataclass(frozen=True)
class SteeredFamily(WheeledFamily):
    """A family whose wheels are steered."""

    wheel_sensors: ClassVar[bool] = False

    literal: bool = field(
        default=False,
        help="all steered wheels of an axle take the same angle, all wheels the same speed",
    )
    wheels: tuple[SteeredWheel, ...] = ()  # all, in part order

    @classmethod
    def read(
        cls,
        reader: Table,
        parent: Self | None,
        wheels: Sequence[Wheel],
        actuators: Sequence[ActuatorDescription],
    ) -> Self:
        family = super().read(reader, parent, wheels, actuators)
        return replace(family, wheels=steered_wheels(wheels, actuators))


class SteeredController(WheelController):
    """Drives a robot some of whose wheels are steered."""

    def __init__(self, robot: RobotDescription, body: BodyHandle, steering: SteeredFamily) -> None:
        super().__init__(robot, body)
        self._steering = steering
        self._limit = robot.drive.max_wheel_speed
        self._scale = SpeedScale(self._limit)

    def joints(self, facts: StatusFacts) -> tuple[tuple[str, float], ...]:
        """Joints that STA tells of by name: all but the steering."""
        steering = {wheel.joint for wheel in self._steering.wheels}
        return tuple(joint for joint in facts.joints if joint[0] not in steering)


class CarController(SteeredController):
    """Speed, FrontSteer and RearSteer become wheel speeds and steering angles."""

    def __init__(self, robot: RobotDescription, body: BodyHandle, steering: SteeredFamily) -> None:
        super().__init__(robot, body, steering)
        self._speed = 0.0
        self._angles = [0.0, 0.0]
        """FrontSteer and RearSteer as on the wire: positive to the right."""
        wheels = self._steering.wheels
        self._ranges = wire_range(wheels, True), wire_range(wheels, False)

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        """Obey; UDK wants all three members, elsewhere one that is absent keeps its value."""
        members = [_sent(one) for one in (drive.speed, drive.front_steer, drive.rear_steer)]
        if None in members and not FACETS[dialect].partial_drive:
            return
        self._scale.note(drive, dialect)
        speed = self._scale.read("Speed", members[0])
        if speed is not None:
            self._speed = speed
        for axle, angle in enumerate(members[1:]):
            if angle is not None:
                what = ("FrontSteer", "RearSteer")[axle]
                self._angles[axle] = within(what, angle, *self._ranges[axle])
        if any(member is not None for member in members):
            self._move()

    def _move(self) -> None:
        front, rear = (-angle for angle in self._angles)
        angles, ratios = turn(self._steering.wheels, front, rear, self._steering.literal)
        pairs = list(zip(self._steering.wheels, ratios, strict=True))
        driven = np.array([ratio for wheel, ratio in pairs if wheel.driven])
        # No tread may run faster than that of the first wheel at its limit; all slow down
        # together, so that the turn stays true.
        first = self._steering.wheels[0].radius
        treads = [abs(ratio) * wheel.radius / first for wheel, ratio in pairs if wheel.driven]
        highest = self._limit / max(treads)
        self.body.drive(driven * within("Speed in this turn", self._speed, -highest, highest))
        self.body.command_joints(
            {
                wheel.joint: JointOrder(Order.POSITION, wheel.sense * angle)
                for wheel, angle in zip(self._steering.wheels, angles, strict=True)
                if wheel.joint is not None
            }
        )

    def stop(self) -> None:
        self._speed = 0.0
        self.body.drive(np.zeros(len(self.robot.driven_wheels)))

    def steering(self, facts: StatusFacts, dialect: Dialect) -> tuple[float | None, float | None]:
        """As commanded in udk, as they are in ut2004 (protocol reference 4.3)."""
        if FACETS[dialect].steering_as_commanded:
            return self._angles[0], self._angles[1]
        return self._measured(facts, True), self._measured(facts, False)

    def _measured(self, facts: StatusFacts, front: bool) -> float:
        """Angle of the imagined wheel in the middle of an axle, rad, positive to the right."""
        angles = [
            -wheel.sense * facts.state.joint_position(wheel.joint)
            for wheel in self._steering.wheels
            if wheel.joint is not None and wheel.front == front
        ]
        if not angles:
            return 0.0
        if self._steering.literal or any(abs(angle) < STRAIGHT for angle in angles):
            return sum(angles) / len(angles)
        # The cotangent grows evenly from the inner to the outer wheel.
        mean = sum(1.0 / math.tan(angle) for angle in angles) / len(angles)
        return math.atan(1.0 / mean) if mean else 0.0


def _sent(value: float | None) -> float | None:
    """A member of DRIVE; not a number counts as not sent."""
    return None if value is None or math.isnan(value) else value


@register_family("ackerman")
class Ackerman(SteeredFamily):
    """Cars and trucks."""

    section: ClassVar[str] = "steering"
    steering_type: ClassVar[str] = "AckermanSteered"

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return CarController(robot, body, self)

    @classmethod
    def read(
        cls,
        reader: Table,
        parent: Self | None,
        wheels: Sequence[Wheel],
        actuators: Sequence[ActuatorDescription],
    ) -> Self:
        family = super().read(reader, parent, wheels, actuators)
        joints = [wheel.joint for wheel in family.wheels if wheel.joint]
        if not joints:
            raise reader.error(
                "wheel",
                "no wheel is steered",
                "let wheels sit on links whose joint is called ...FrontSteer or ...RearSteer",
            )
        for joint in joints:
            if not any(word in joint.lower() for word in (FRONT, REAR)):
                raise reader.error(
                    "wheel",
                    f"the joint {joint!r} steers neither axle",
                    "call it ...FrontSteer or ...RearSteer",
                )
        return family

    def max_steer(self) -> tuple[float, float]:
        """The original announced the width of the joint's range (robots reference 1.4)."""
        widths = [0.0, 0.0]
        for wheel in self.wheels:
            if wheel.joint is not None:
                width = round(wheel.limits[1] - wheel.limits[0], 9)
                widths[0 if wheel.front else 1] = width
        return widths[0], widths[1]

    def complete(self, spec: mujoco.MjSpec, robot: RobotDescription) -> None:
        for name, limits in joint_ranges(self).items():
            joint = spec.joint(name)
            if joint.limited == mujoco.mjtLimited.mjLIMITED_TRUE:
                joint.range = limits


class OmniController(SteeredController):
    """Wheels that are not named, or members that are absent, keep what they had.

    A wheel that has not been named yet rolls along: clients of Player drive wheels 0 and 1 only.
    """

    def __init__(self, robot: RobotDescription, body: BodyHandle, steering: SteeredFamily) -> None:
        super().__init__(robot, body, steering)
        self._wheels = [wheel for wheel in self._steering.wheels if wheel.driven]
        self._names = [wheel.name.lower() for wheel in robot.driven_wheels]
        self._speeds = np.full(len(self._wheels), np.nan)

    def steer(self, drive: Drive, dialect: Dialect) -> None:
        """Obey the groups of a command, then its single wheel if it names one."""
        self._scale.note(drive, dialect)
        orders: dict[str, JointOrder] = {}
        moved = [self._turn(target, orders) for target in (*drive.wheels, *self._single(drive))]
        if any(moved):
            self.body.drive(self._speeds.copy())
        if orders:
            self.body.command_joints(orders)

    def _single(self, drive: Drive) -> tuple[WheelTarget, ...]:
        """The single joint form: Steer 1 is the steering axis of a wheel, 0 its spin."""
        name = (drive.name or "").lower()
        if drive.value is None or name not in self._names:
            return ()
        number = self._names.index(name)
        if drive.steer:
            return (WheelTarget(number, steer=drive.value),)
        return (WheelTarget(number, speed=drive.value),) if drive.order == Order.VELOCITY else ()

    def _turn(self, target: WheelTarget, orders: dict[str, JointOrder]) -> bool:
        if not 0 <= target.number < len(self._wheels):
            return False
        wheel = self._wheels[target.number]
        if wheel.joint is not None and target.steer is not None and not math.isnan(target.steer):
            orders[wheel.joint] = JointOrder(Order.POSITION, _position(wheel, target.steer))
        speed = self._scale.read("WheelSpeed", target.speed)
        if speed is None:
            return False
        self._speeds[target.number] = speed
        return True

    def stop(self) -> None:
        self._speeds[:] = 0.0
        self.body.drive(self._speeds.copy())


def _position(wheel: SteeredWheel, steer: float) -> float:
    """Joint position for an angle of the wire, which is positive to the right; within limits."""
    low, high = wheel.limits
    wanted = -wheel.sense * steer
    position = max(low, min(high, wanted))
    if position != wanted:
        tell_clamped("WheelSteer", steer, -wheel.sense * position)
    return position


@register_family("omni")
@dataclass(frozen=True)
class Omni(SteeredFamily):
    """Every wheel on a knuckle of its own."""

    steering_type: ClassVar[str] = "OmniDrive"
    literal: bool = True

    def drive_controller(self, robot: RobotDescription, body: BodyHandle) -> DriveController:
        return OmniController(robot, body, self)
