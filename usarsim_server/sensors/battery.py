"""The battery as an item of the robot file; its state is in STA, never in SEN."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.sensors.base import Sensor, register
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import RobotState


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
