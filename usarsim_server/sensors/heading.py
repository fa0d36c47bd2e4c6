"""Compass, altimeter and mission clock of the UDK generation (robots reference 2.5)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.frames import wire_from_pose, wrap_signed
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Altimeter", "MagneticCompass", "MissionTime"]

SEA_LEVEL = 111.0
"""Height of every spawn place above the sea in the original, m."""


@register("MagneticCompass")
class MagneticCompass(Sensor):
    """Heading relative to map north, signed, clockwise positive, rad.

    The original converted twice and truncated, so it always said about zero: `literal` = true.
    """

    wire_type: ClassVar[str] = "MagneticCompass"

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.literal = self.parameters.flag("literal", False)
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
    """Height above the place of the first reading, up positive, and above the sea, m.

    Parameter: `sea_level`, height of that place above the sea.
    """

    wire_type: ClassVar[str] = "AltitudeSensor"

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.sea_level = self.parameters.number("sea_level", SEA_LEVEL)
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


@register("MissionTime")
class MissionTime(Sensor):
    """Whole minutes since the first reading."""

    wire_type: ClassVar[str] = "MissionTime"

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._start: float | None = None
        self._minutes = 0

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the time."""
        if self._start is None:
            self._start = robot.time
        self._minutes = int((robot.time - self._start) // 60.0)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Minutes."""
        return (("Minutes", str(self._minutes)),)
