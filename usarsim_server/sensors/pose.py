"""Sensors of a robot's pose: the true one, compass, altimeter (robots reference 2.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.base.fields import field
from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext, register
from usarsim_server.sensors.inertial import each_turn
from usarsim_server.simulation.frames import IDENTITY, wire_from_pose, wrap_signed
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import RobotState


@register("GroundTruth")
class GroundTruth(Sensor):
    """Pose of the robot's reference point in the world, or of the sensor itself."""

    wire_type: ClassVar[str] = "GroundTruth"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.05, Dialect.UDK: 0.1}
    announces_interval = True
    of: str = field(default="robot", choices=("robot", "sensor"), any_case=True, help="whose pose")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._location, self._orientation = wire_from_pose(IDENTITY)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the pose in the wire frame."""
        pose = robot.pose if self.of == "robot" else self.world_pose(robot)
        self._location, self._orientation = wire_from_pose(pose)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Location and Orientation: two digits and whole turns, or three digits and signed."""
        facets = FACETS[dialect]
        digits = facets.ground_truth_digits
        signed = facets.ground_truth_signed
        orientation = self._orientation if signed else each_turn(self._orientation)
        location = vector(self._location, digits)
        return (("Location", location), ("Orientation", vector(orientation, digits)))


@register("GroundTruthMovable")
class GroundTruthMovable(GroundTruth):
    """Pose of the sensor itself; on the wire it is a GroundTruth like the other."""

    of = "sensor"


SEA_LEVEL = 111.0
"""Height of every spawn place above the sea in the original, m."""


@register("MagneticCompass")
class MagneticCompass(Sensor):
    """Heading relative to map north, signed, clockwise positive, rad.

    The original converted twice and truncated, so it always said about zero.
    """

    wire_type: ClassVar[str] = "MagneticCompass"

    literal: bool = field(default=False, help="always 0, as in the original")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._north = context.world.north
        self._heading = 0.0

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the heading."""
        _, (_, _, yaw) = wire_from_pose(robot.pose)
        self._heading = 0.0 if self.literal else wrap_signed(yaw - self._north)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """MagneticAngle, four digits."""
        return (("MagneticAngle", fixed(self._heading, 4)),)


@register("AltitudeSensor")
class Altimeter(Sensor):
    """Height above the place of the first reading, up positive, and above the sea, m."""

    wire_type: ClassVar[str] = "AltitudeSensor"

    sea_level: float = field(default=SEA_LEVEL, unit="m", help="from there up to that place")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._start: float | None = None
        self._relative = 0.0

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the height of the robot's reference point."""
        height = robot.pose.position[2]
        if self._start is None:
            self._start = height
        self._relative = height - self._start
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """relativeAltitude and absoluteAltitude (never below 0), four digits."""
        absolute = max(self._relative + self.sea_level, 0.0)
        return (
            ("relativeAltitude", fixed(self._relative, 4)),
            ("absoluteAltitude", fixed(absolute, 4)),
        )
