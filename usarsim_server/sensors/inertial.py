"""Inertial sensors: INS, its forerunner INU, IMU and accelerometers (robots reference 2.5, protocol
reference 4.6 and addendum).

The INS adds an error in proportion to the true motion. Accelerations are finite differences of the
robot's velocity, as in the original.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.dialects import ANGLE_UNIT, FACETS
from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.base import NOWHERE, Sensor, SensorContext, register
from usarsim_server.simulation.frames import (
    Vector,
    flip_point,
    wire_from_pose,
    wrap_signed,
    wrap_turn,
)
from usarsim_server.simulation.rays.query import RayHits
from usarsim_server.simulation.snapshot import RobotState

Array = NDArray[np.float64]


class AccelerationMeter:
    """Mean acceleration of the robot's reference point between calls.

    Attributes:
        value: (3,) in the simulation's world frame, m/s^2, without gravity.
        ready: whether two calls at different times have been made.
    """

    def __init__(self) -> None:
        self.value: Array = np.zeros(3)
        self.ready = False
        self._time: float | None = None
        self._velocity: Array = np.zeros(3)

    def update(self, robot: RobotState) -> float:
        """Take one sample; returns the seconds since the last one, 0 for the first."""
        velocity = np.array(robot.linear_velocity)
        elapsed = 0.0 if self._time is None else robot.time - self._time
        if elapsed > 0.0:
            self.value = (velocity - self._velocity) / elapsed
            self.ready = True
        if self._time is None or elapsed > 0.0:
            self._time, self._velocity = robot.time, velocity
        return elapsed


def angle_difference(new: Vector, old: Vector) -> Array:
    """Smallest turns (3,) that lead from one triple of angles to the other, rad."""
    return np.array(_turns(new, old))


def _turns(new: Vector, old: Vector) -> Vector:
    (a, b, c), (d, e, f) = new, old
    return wrap_signed(a - d), wrap_signed(b - e), wrap_signed(c - f)


def each_turn(angles: Vector | Array) -> Vector:
    """Three angles, each in [0, 2 pi)."""
    x, y, z = angles
    return wrap_turn(float(x)), wrap_turn(float(y)), wrap_turn(float(z))


@register("INS")
class InertialNavigation(Sensor):
    """Estimate of the pose in the world that drifts while the robot moves.

    Each interval adds the true change of every angle times 1 + N(m_a, sigma), and the true way
    along every axis plus the whole way times N(m_x, sigma). The means m are drawn once, within
    +-1/2 precision^-2 for angles and +-1/2 precision^-1 for axes. The estimate starts at the
    sensor's own place and follows the robot's reference point after the first interval in which
    the robot did not turn (less than one angle unit of the original engine).
    """

    wire_type: ClassVar[str] = "INS"
    timed: ClassVar[frozenset[Dialect]] = NOWHERE
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    announces_interval = True

    precision: float = field(default=1000.0, above=0.0, help="the greater, the less it drifts")
    sigma: float = field(default=0.05, low=0.0, help="of the random error, as a share of the way")
    drifting: bool = field(default=True, help="false: no systematic error")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._rng = context.rng
        means = self._rng.uniform(-0.5, 0.5, size=(2, 3)) if self.drifting else np.zeros((2, 3))
        scales = np.array([[self.precision**2], [self.precision]])
        self._means: list[float] = (means / scales).ravel().tolist()
        """Of the random errors of three angles and three axes."""
        self._started = False
        self._aligned = False
        self._location: Vector = (0.0, 0.0, 0.0)
        self._orientation: Vector = (0.0, 0.0, 0.0)
        self._last_location: Vector = (0.0, 0.0, 0.0)
        self._last_orientation: Vector = (0.0, 0.0, 0.0)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Advance the estimate by the motion since the last call."""
        location, orientation = wire_from_pose(robot.pose)
        if not self._started:
            own_location, own_orientation = wire_from_pose(self.world_pose(robot))
            self._location = own_location
            self._orientation = each_turn(own_orientation)
            self._started = True
        else:
            self._advance(location, _turns(orientation, self._last_orientation))
        self._last_location, self._last_orientation = location, orientation
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Location and Orientation, two digits, angles in [0, 2 pi)."""
        location = vector(self._location, 2)
        return (("Location", location), ("Orientation", vector(self._orientation, 2)))

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """POSE x,y,z,roll,pitch,yaw sets the estimate and ends the systematic drift."""
        if opcode != "POSE":
            return SetResult.UNKNOWN
        pose = _six_numbers(params)
        if pose is None:
            return SetResult.FAILED
        location, orientation = wire_from_pose(robot.pose)
        x, y, z, *angles = pose
        self._location = x, y, z
        self._orientation = each_turn(np.array(angles))
        self._last_location, self._last_orientation = location, orientation
        self._means = [0.0] * 6
        self._started = self._aligned = True
        return SetResult.OK

    def _advance(self, location: Vector, turn: Vector) -> None:
        if not self._aligned:
            self._aligned = all(abs(angle) < ANGLE_UNIT for angle in turn)
            return
        # Plain numbers: arrays of three take several times as long.
        drawn = self._rng.standard_normal(6).tolist()
        sigma = self.sigma
        a, b, c, i, j, k = [
            mean + sigma * one for mean, one in zip(self._means, drawn, strict=True)
        ]
        (roll, pitch, yaw), (droll, dpitch, dyaw) = self._orientation, turn
        self._orientation = (
            wrap_turn(roll + droll * (1.0 + a)),
            wrap_turn(pitch + dpitch * (1.0 + b)),
            wrap_turn(yaw + dyaw * (1.0 + c)),
        )
        (x, y, z), (u, v, w) = location, self._last_location
        step = np.array((x - u, y - v, z - w))
        way = math.sqrt(float(step.dot(step)))
        (x, y, z), (u, v, w) = self._location, step.tolist()
        self._location = x + u + way * i, y + v + way * j, z + w + way * k


def _six_numbers(text: str) -> list[float] | None:
    parts = [part for part in re.split(r"[,\s]+", text.strip()) if part]
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return None
    if len(numbers) != 6 or not all(math.isfinite(number) for number in numbers):
        return None
    return numbers


@register("INU")
class InertialUnit(InertialNavigation):
    """The orientation of an INS, with the same drift; no location, nothing to set.

    Early UT2004 servers had it, later ones the INS (robots reference 2.5).
    """

    wire_type: ClassVar[str] = "INU"
    announces_interval = False

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Orientation, two digits, angles in [0, 2 pi)."""
        _, orientation = super().data(dialect)
        return (orientation,)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """It has no estimate of a pose to set."""
        return SetResult.UNKNOWN


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
        if not (self.oriented and FACETS[dialect].acceleration_orientation):
            return reading
        return (*reading, ("Orientation", vector(each_turn(self._orientation), 4)))


@register("Accelerometer")
class Accelerometer(Acceleration):
    """The same with the gravity vector added: +9.81 on z at rest, opposite to a real device."""

    wire_type: ClassVar[str] = "AcceleroMeter"
    key: ClassVar[str] = "ProperAcceleration"
    gravity: ClassVar[float] = GRAVITY
    oriented: ClassVar[bool] = False
