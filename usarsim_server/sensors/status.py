"""Sensors of a robot's own state: the mission clock (robots reference 2.5), and the battery, whose
state is in STA and never in SEN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext, register
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import RobotState


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


@register("Battery")
class Battery(Sensor):
    """Silent; answers GEO with its place and CONF with its name (robots reference 2.10)."""

    wire_type: ClassVar[str] = "Battery"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.0, Dialect.UDK: 0.0}

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Nothing to report."""
        return False

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """No data."""
        return ()
