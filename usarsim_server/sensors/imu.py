"""Inertial measurement unit (robots reference 2.5, protocol reference 4.6)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.angles import angle_difference
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.motion import AccelerationMeter
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.frames import Vector, flip_point, wire_from_pose
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["InertialMeasurement"]

Array = NDArray[np.float64]


@register("IMU")
class InertialMeasurement(Sensor):
    """Acceleration, rates of the roll, pitch and yaw angles, their change, and the angles.

    AngularVel is the difference of the robot's wire Euler angles per second, not the body rate.
    XYZAcceleration is in the sensor's frame without gravity: forward, right and, the exception in
    this frame, up. The first call has no interval to differentiate over and reports nothing.
    """

    wire_type: ClassVar[str] = "IMU"

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._meter = AccelerationMeter()
        self._acceleration: Vector = (0.0, 0.0, 0.0)
        self._rotation: Vector = (0.0, 0.0, 0.0)
        self._rates: Array | None = None
        self._rate_changes: Array = np.zeros(3)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Difference the motion since the last call."""
        elapsed = self._meter.update(robot)
        _, rotation = wire_from_pose(robot.pose)
        if elapsed > 0.0:
            rates = angle_difference(rotation, self._rotation) / elapsed
            if self._rates is not None:
                self._rate_changes = (rates - self._rates) / elapsed
            self._rates = rates
            self._acceleration = self._in_sensor_frame(robot)
        self._rotation = rotation
        return self._meter.ready

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """The four vectors, four digits."""
        rates = np.zeros(3) if self._rates is None else self._rates
        return (
            ("XYZAcceleration", vector(self._acceleration, 4)),
            ("AngularVel", vector(rates.tolist(), 4)),
            ("AngularAccel", vector(self._rate_changes.tolist(), 4)),
            ("Rotation", vector(self._rotation, 4)),
        )

    def _in_sensor_frame(self, robot: RobotState) -> Vector:
        x, y, z = (self._meter.value @ self.world_pose(robot).matrix()).tolist()
        forward, right, _ = flip_point((x, y, z))
        return forward, right, z
