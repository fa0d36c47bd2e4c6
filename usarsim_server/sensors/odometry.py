"""Dead reckoning from the front wheels (robots reference 2.4)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.values import Dialect, Segment, Vector
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext, SetResult
from usarsim_server.sensors.registry import register
from usarsim_server.sensors.wheels import front_wheel, has_wheel_sensors
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Odometry"]


@register("Odometry")
class Odometry(Sensor):
    """Pose x, y, theta since the start or RESET, theta clockwise positive and not wrapped.

    Uses the announced wheel radius and the announced, geometric track, so a skid-steered robot
    overestimates its turns as the original does. Silent on robots that do not steer by wheel speed.

    Parameters: `encoder_resolution` (rad), announced in `ut2004`; `quantised` = true also rounds
    the wheel angles down to whole encoder steps.
    """

    wire_type: ClassVar[str] = "Odometry"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.1}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.encoder_resolution = read.number("encoder_resolution", 0.0099, above=0.0)
        self.quantised = read.flag("quantised", False)
        robot = context.robot
        self._left = front_wheel(robot, "left")
        self._right = front_wheel(robot, "right")
        self._works = has_wheel_sensors(robot) and robot.report.track_width > 0.0
        self._radius = robot.report.wheel_radius
        self._track = robot.report.track_width
        self._angles: tuple[float, float] | None = None
        self._pose: Vector = (0.0, 0.0, 0.0)

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
        if dialect is Dialect.UDK:
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
