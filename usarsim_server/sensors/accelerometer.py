"""Accelerometers (robots reference 2.5, protocol reference 4.6 and addendum)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.angles import each_turn
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.motion import AccelerationMeter
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.frames import Vector, flip_point, wire_from_pose
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Acceleration", "Accelerometer"]

GRAVITY = 9.81
"""m/s^2, downward."""


@register("Acceleration", "Accel")
class Acceleration(Sensor):
    """Change of velocity without gravity, in the sensor's wire frame (z down), m/s^2.

    In `ut2004`, whose AR.Drone client reads it there, the line goes on with the orientation of the
    robot: roll, pitch, yaw in the wire frame, rad, each in [0, 2 pi) as in GroundTruth. The first
    call has no interval to differentiate over and reports nothing.
    """

    wire_type: ClassVar[str] = "Accel"
    key: ClassVar[str] = "Acceleration"
    gravity: ClassVar[float] = 0.0
    oriented: ClassVar[bool] = True
    """The ut2004 line carries Orientation."""

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._meter = AccelerationMeter()
        self._reading: Vector = (0.0, 0.0, 0.0)
        self._orientation: Vector = (0.0, 0.0, 0.0)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Difference the velocity since the last call."""
        self._meter.update(robot)
        total = self._meter.value + np.array([0.0, 0.0, -self.gravity])
        x, y, z = (total @ self.world_pose(robot).matrix()).tolist()
        self._reading = flip_point((x, y, z))
        self._orientation = wire_from_pose(robot.pose)[1]
        return self._meter.ready

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """The vector, in `ut2004` also Orientation; four digits."""
        reading = ((self.key, vector(self._reading, 4)),)
        if dialect is Dialect.UDK or not self.oriented:
            return reading
        return (*reading, ("Orientation", vector(each_turn(self._orientation), 4)))


@register("Accelerometer")
class Accelerometer(Acceleration):
    """The same with the gravity vector added: +9.81 on z at rest, opposite to a real device."""

    wire_type: ClassVar[str] = "AcceleroMeter"
    key: ClassVar[str] = "ProperAcceleration"
    gravity: ClassVar[float] = GRAVITY
    oriented: ClassVar[bool] = False
