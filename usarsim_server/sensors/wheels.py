"""Sensors of wheels and joints: odometry by dead reckoning from the front wheels, encoders, and the
tachometer (robots reference 2.4, protocol reference 4.6).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.numbers import fixed, ranges, vector
from usarsim_server.protocol.values import Dialect, Segment, Vector
from usarsim_server.robots.description import ItemDescription, RobotDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.base import Sensor, SensorContext, register
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import RobotState

Array = NDArray[np.float64]


def has_wheel_sensors(robot: RobotDescription) -> bool:
    """Whether odometry and encoders work on this kind of robot; elsewhere they stay silent."""
    return robot.rolls


def front_wheel(robot: RobotDescription, side: str) -> int | None:
    """Index of the foremost driven wheel of a side (`left`, `right`); None if there is none.

    The index counts driven wheels in part order, as `RobotState.wheel_angles` does.
    """
    wheels = [(i, w) for i, w in enumerate(robot.driven_wheels) if w.side.lower() == side]
    if not wheels:
        return None
    return max(wheels, key=lambda entry: entry[1].position[0])[0]


@register("Odometry")
class Odometry(Sensor):
    """Pose x, y, theta since the start or RESET, theta clockwise positive and not wrapped.

    Uses the announced wheel radius and the announced, geometric track, so a skid-steered robot
    overestimates its turns as the original does. Silent on robots that do not steer by wheel speed.
    """

    wire_type: ClassVar[str] = "Odometry"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})

    encoder_resolution: float = field(
        default=0.0099, above=0.0, unit="rad", help="announced in `ut2004`"
    )
    quantised: bool = field(default=False, help="rounds wheel angles down to whole encoder steps")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        robot = context.robot
        self._left = front_wheel(robot, "left")
        self._right = front_wheel(robot, "right")
        self._works = has_wheel_sensors(robot) and robot.report.track_width > 0.0
        self._radius = robot.report.wheel_radius
        self._track = robot.report.track_width
        self._angles: tuple[float, float] | None = None
        self._pose: Vector = (0.0, 0.0, 0.0)

    @property
    def estimate(self) -> Vector:
        """The last pose: x ahead and y to the right, m, and theta, rad."""
        return self._pose

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Advance the pose by the way of both wheels since the last call (explicit Euler)."""
        angles = self._wheel_angles(robot)
        if angles is None:
            return False
        old_left, old_right = self._angles if self._angles is not None else angles
        left = self._radius * (angles[0] - old_left)
        right = self._radius * (angles[1] - old_right)
        x, y, theta = self._pose
        way = (left + right) / 2
        self._pose = (
            x + way * math.cos(theta),
            y + way * math.sin(theta),
            theta + (left - right) / self._track,
        )
        self._angles = angles
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Pose, four digits."""
        return (("Pose", vector(self._pose, 4)),)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """ScanInterval, and EncoderResolution in `ut2004`."""
        interval = ("ScanInterval", fixed(self.interval(dialect), 4))
        if not FACETS[dialect].odometry_resolution:
            return (interval,)
        return (interval, ("EncoderResolution", fixed(self.encoder_resolution, 4)))

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """RESET makes the present pose the origin."""
        if opcode != "RESET":
            return SetResult.UNKNOWN
        self._angles = self._wheel_angles(robot)
        self._pose = (0.0, 0.0, 0.0)
        return SetResult.OK

    def _wheel_angles(self, robot: RobotState) -> tuple[float, float] | None:
        if not self._works or self._left is None or self._right is None:
            return None
        angles = robot.wheel_angles
        left, right = float(angles[self._left]), float(angles[self._right])
        if self.quantised:
            step = self.encoder_resolution
            left, right = math.floor(left / step) * step, math.floor(right / step) * step
        return left, right


_NUMBERED = re.compile(r"W([0-9]+)", re.IGNORECASE)


@register("Encoder")
class Encoder(Sensor):
    """Ticks of one driven wheel since the start or RESET, positive when rolling forward.

    On the link of a mission package it counts the angle of the joint that moves the link: ECPan and
    ECTilt of a pan-tilt.

    In `ut2004` the count accumulates under the item's name; in `udk` the name is `Wk`, k the index
    of the driven wheel (on a link it keeps its name), and the angle is taken modulo one turn. The
    key `wheel` is an index among the driven wheels, or a wheel's name; by default it follows from
    the item's link, from `W2` or from `left`/`right` in the item's name.

    Noise is uniform within +-noise of the angle turned since the last report, so the error grows
    with the square root of the way. The original multiplied the whole angle with a fresh factor
    at each report, which makes encoders useless after some turns.
    """

    wire_type: ClassVar[str] = "Encoder"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    batched: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UT2004})
    announces = (("Resolution", "resolution"),)

    resolution: float = field(default=0.01745, above=0.0, unit="rad", help="of a tick")
    noise: float = field(default=0.005, low=0.0, high=1.0, help="as a share of the turn")
    udk_literal: bool = field(default=False, help="a fresh error of the whole angle, as in UDK")
    cumulative: bool = field(default=False, help="no wrapping in `udk` either")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._joint = self._find_joint(context.robot)
        self.wheel = None if self._joint else self._find_wheel(context.robot)
        self._works = self._joint is not None or has_wheel_sensors(context.robot)
        self._rng = context.rng
        self._last: float | None = None
        self._turned = 0.0
        self._reading = 0.0

    def wire_name(self, dialect: Dialect) -> str:
        """The item's name, or `Wk` in `udk`."""
        numbered = FACETS[dialect].encoder_wraps and self.wheel is not None
        return f"W{self.wheel}" if numbered else self.name

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Add the angle turned since the last call."""
        if not self._works:
            return False
        angle = self._angle(robot)
        turned = angle - (angle if self._last is None else self._last)
        self._last = angle
        factor = 1.0 + (self._rng.uniform(-self.noise, self.noise) if self.noise > 0.0 else 0.0)
        if self.udk_literal:
            self._turned += turned
            self._reading = self._turned * factor
        else:
            self._turned += turned * factor
            self._reading = self._turned
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Tick, truncated toward zero."""
        angle = self._reading
        if FACETS[dialect].encoder_wraps and not self.cumulative:
            angle = math.fmod(angle, math.tau)
        return (("Tick", str(int(angle / self.resolution))),)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """RESET starts counting from zero."""
        if opcode != "RESET":
            return SetResult.UNKNOWN
        self._last = self._angle(robot) if self._works else None
        self._turned = self._reading = 0.0
        return SetResult.OK

    def _angle(self, robot: RobotState) -> float:
        if self._joint is not None:
            return robot.joint_position(self._joint)
        return float(robot.wheel_angles[self.wheel])

    def _find_joint(self, robot: RobotDescription) -> str | None:
        """The joint of the link that carries it, if that is not the link of a wheel."""
        if self.link is None or self.parameters.raw("wheel") is not None:
            return None
        found = robot.find_link(self.link)
        if found is None:
            return None
        actuator, number = found
        return actuator.links[number - 1].joint

    def _find_wheel(self, robot: RobotDescription) -> int:
        names = [wheel.name.lower() for wheel in robot.driven_wheels]
        asked = self.parameters.raw("wheel")
        if not names:
            problem = f"robot {robot.name} has no driven wheel"
            raise self.parameters.error("wheel", problem, "remove the encoder")
        cure = f"write an index from 0 to {len(names) - 1} or one of: {', '.join(names)}"
        if asked is not None:
            if isinstance(asked, str) and asked.lower() in names:
                return names.index(asked.lower())
            if isinstance(asked, int) and not isinstance(asked, bool) and 0 <= asked < len(names):
                return asked
            raise self.parameters.error("wheel", f"{asked!r} is no driven wheel", cure)
        wheel = self._wheel_by_name(names, robot)
        if wheel is None or wheel >= len(names):
            problem = f"no driven wheel follows from the name {self.name!r}"
            raise self.parameters.error("wheel", problem, cure)
        return wheel

    def _wheel_by_name(self, names: list[str], robot: RobotDescription) -> int | None:
        if self.link is not None and self.link.lower() in names:
            return names.index(self.link.lower())
        if numbered := _NUMBERED.search(self.name):
            return int(numbered[1])
        for side in ("left", "right"):
            if side in self.name.lower():
                return front_wheel(robot, side)
        return None


@register("Tachometer")
class Tachometer(Sensor):
    """Vel: mean spin since the last report (rad/s); Pos: angle since start or RESET (rad).

    As in the original, Pos is the state at the last report and so lags by one interval. The first
    report has no interval to look back on and gives the momentary spin.
    """

    wire_type: ClassVar[str] = "Tachometer"
    announces_interval = True
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        wheels = len(context.robot.driven_wheels)
        self._works = has_wheel_sensors(context.robot) and wheels > 0
        self._time = 0.0
        self._angles: Array | None = None
        self._turned: Array = np.zeros(wheels)
        self._vel: Array = np.zeros(wheels)
        self._pos: Array = np.zeros(wheels)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep mean spins and lagging angles."""
        if not self._works:
            return False
        angles = np.array(robot.wheel_angles, dtype=np.float64)
        if self._angles is None:
            self._vel = np.array(robot.wheel_speeds, dtype=np.float64)
        elif robot.time > self._time:
            self._vel = (angles - self._angles) / (robot.time - self._time)
            self._pos = self._turned
            self._turned = self._turned + (angles - self._angles)
        self._angles, self._time = angles, robot.time
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Vel and Pos, four digits, wheels in part order."""
        return (("Vel", ranges(self._vel, 4)), ("Pos", ranges(self._pos, 4)))

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """RESET makes the present angles zero."""
        if opcode != "RESET":
            return SetResult.UNKNOWN
        self._angles = np.array(robot.wheel_angles, dtype=np.float64)
        self._time = robot.time
        self._turned = np.zeros(len(self._angles))
        self._pos = self._turned
        return SetResult.OK
