"""Inertial navigation: the true motion with an error in proportion to it (robots reference 2.5)."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.angles import ANGLE_UNIT, angle_difference, each_turn
from usarsim_server.sensors.base import NOWHERE, Sensor, SensorContext, SetResult
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.frames import Vector, wire_from_pose
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["InertialNavigation"]

Array = NDArray[np.float64]


@register("INS")
class InertialNavigation(Sensor):
    """Estimate of the pose in the world that drifts while the robot moves.

    Each interval adds the true change of every angle times 1 + N(m_a, sigma), and the true way
    along every axis plus the whole way times N(m_x, sigma). The means m are drawn once, within
    +-1/2 precision^-2 for angles and +-1/2 precision^-1 for axes. The estimate starts at the
    sensor's own place and follows the robot's reference point after the first interval in which
    the robot did not turn (less than one angle unit of the original engine).

    Parameters: `precision`, `sigma`, `drifting`.
    """

    wire_type: ClassVar[str] = "INS"
    timed: ClassVar[frozenset[Dialect]] = NOWHERE
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        precision = read.number("precision", 1000.0, above=0.0)
        self.sigma = read.number("sigma", 0.05, minimum=0.0)
        drifting = read.flag("drifting", True)
        self._rng = context.rng
        means = self._rng.uniform(-0.5, 0.5, size=(2, 3)) if drifting else np.zeros((2, 3))
        self._angle_means: Array = means[0] / precision**2
        self._axis_means: Array = means[1] / precision
        self._started = False
        self._aligned = False
        self._location: Array = np.zeros(3)
        self._orientation: Vector = (0.0, 0.0, 0.0)
        self._last_location: Array = np.zeros(3)
        self._last_orientation: Vector = (0.0, 0.0, 0.0)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Advance the estimate by the motion since the last call."""
        location, orientation = wire_from_pose(robot.pose)
        if not self._started:
            own_location, own_orientation = wire_from_pose(self.world_pose(robot))
            self._location = np.array(own_location)
            self._orientation = each_turn(own_orientation)
            self._started = True
        else:
            self._advance(np.array(location), angle_difference(orientation, self._last_orientation))
        self._last_location, self._last_orientation = np.array(location), orientation
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Location and Orientation, two digits, angles in [0, 2 pi)."""
        location = vector(self._location.tolist(), 2)
        return (("Location", location), ("Orientation", vector(self._orientation, 2)))

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """ScanInterval."""
        return (("ScanInterval", fixed(self.interval(dialect), 4)),)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """POSE x,y,z,roll,pitch,yaw sets the estimate and ends the systematic drift."""
        if opcode != "POSE":
            return SetResult.UNKNOWN
        pose = _six_numbers(params)
        if pose is None:
            return SetResult.FAILED
        location, orientation = wire_from_pose(robot.pose)
        self._location = np.array(pose[:3])
        self._orientation = each_turn(np.array(pose[3:]))
        self._last_location, self._last_orientation = np.array(location), orientation
        self._angle_means = self._axis_means = np.zeros(3)
        self._started = self._aligned = True
        return SetResult.OK

    def _advance(self, location: Array, turn: Array) -> None:
        if not self._aligned:
            self._aligned = bool(np.all(np.abs(turn) < ANGLE_UNIT))
            return
        step = location - self._last_location
        angle_error = self._angle_means + self.sigma * self._rng.standard_normal(3)
        axis_error = self._axis_means + self.sigma * self._rng.standard_normal(3)
        self._orientation = each_turn(np.array(self._orientation) + turn * (1.0 + angle_error))
        self._location = self._location + step + float(np.linalg.norm(step)) * axis_error


def _six_numbers(text: str) -> list[float] | None:
    parts = [part for part in re.split(r"[,\s]+", text.strip()) if part]
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        return None
    if len(numbers) != 6 or not all(math.isfinite(number) for number in numbers):
        return None
    return numbers
