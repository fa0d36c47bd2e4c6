"""Accelerometers of the UDK generation (robots reference 2.5, protocol reference 4.6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.motion import AccelerationMeter
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.frames import Vector, flip_point
from usarsim_server.simulation.rays import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Acceleration", "Accelerometer"]

GRAVITY = 9.81
"""m/s^2, downward."""


@register("Acceleration", "Accel")
class Acceleration(Sensor):
    """Change of velocity without gravity, in the sensor's wire frame (z down), m/s^2.

    The first call has no interval to differentiate over and reports nothing.
    """

    wire_type: ClassVar[str] = "Accel"
    key: ClassVar[str] = "Acceleration"
    gravity: ClassVar[float] = 0.0

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._meter = AccelerationMeter()
        self._reading: Vector = (0.0, 0.0, 0.0)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Difference the velocity since the last call."""
        self._meter.update(robot)
        total = self._meter.value + np.array([0.0, 0.0, -self.gravity])
        x, y, z = (total @ self.world_pose(robot).matrix()).tolist()
        self._reading = flip_point((x, y, z))
        return self._meter.ready

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """One vector, four digits."""
        return ((self.key, vector(self._reading, 4)),)


@register("Accelerometer")
class Accelerometer(Acceleration):
    """The same with the gravity vector added: +9.81 on z at rest, opposite to a real device."""

    wire_type: ClassVar[str] = "AcceleroMeter"
    key: ClassVar[str] = "ProperAcceleration"
    gravity: ClassVar[float] = GRAVITY
