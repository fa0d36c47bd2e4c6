"""Sensors that report points in their own frame: PCL (robots reference 2.3).

Both are built of sonars in the original, which amount to one ray each (robots reference 2.2), and
like those they clamp to both range limits, so that a beam without echo gives a point at the maximum
range and the number of points is constant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import SensorContext
from usarsim_server.sensors.fans import AHEAD, fan_at, wire_directions
from usarsim_server.sensors.point_lists import point_texts, wire_points
from usarsim_server.sensors.ranging import Ranging
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["RotatingPointCloudScanner", "SonarArray"]

Array = NDArray[np.float64]

PHASE_SLACK = 1e-9
"""Part of a turn by which simulated time may fall short of a turn and still count as the next."""


class _PointCloud(Ranging):
    """A list of points (n, 3) in the sensor's frame."""

    wire_type: ClassVar[str] = "PCL"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    default_max_range: ClassVar[float] = 40.0
    separator: ClassVar[str]
    digits: ClassVar[int]

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._points: Array = np.zeros((0, 3))

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """One segment without a key."""
        return ((self.separator.join(point_texts(wire_points(self._points), self.digits)), ""),)

    def keep(self, hits: RayHits, starts: Array, directions: Array) -> None:
        """Keep the points of one reading; rays are given in the sensor's frame."""
        ranges = np.maximum(self.echoes(hits.distances), self.min_range)
        self._points = starts + directions * ranges[:, None]


@register("RotatingPointCloudScanner", "PCL")
class RotatingPointCloudScanner(_PointCloud):
    """A row of beams, from left to right, that rises from -FOV/2 to +FOV/2 and starts again.

    Each reading is one row, at the pitch of its moment. Parameters: those of `Ranging`, and
    `beams`, `fov`, `vertical_fov` (rad), `spin_period` (s per rise).
    """

    separator: ClassVar[str] = ";"
    digits: ClassVar[int] = 2

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.beams = read.count("beams", 256, minimum=2, maximum=10_000)
        self.fov = read.number("fov", 2.094395, above=0.0, maximum=7.0)
        self.vertical_fov = read.number("vertical_fov", 0.785398, minimum=0.0, maximum=np.pi)
        self.spin_period = read.number("spin_period", 1.0, minimum=0.01)
        self._yaw = np.linspace(-self.fov / 2, self.fov / 2, self.beams)

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per beam of the present row."""
        return (fan_at(self.world_pose(robot), self._directions(robot.time), self.max_range),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the points of one row."""
        self.keep(hits[0], np.zeros(3), self._directions(robot.time))
        return True

    def _directions(self, time: float) -> Array:
        phase = math.fmod(time / self.spin_period + PHASE_SLACK, 1.0)
        return wire_directions(self._yaw, self.vertical_fov * (phase - 0.5))


@register("ExampleSonarArray", "RangeSensorArray")
class SonarArray(_PointCloud):
    """A square grid of parallel rays; columns from left to right, each from bottom to top.

    Parameters: those of `Ranging`, and `grid` (rays per side), `spacing` (m).
    """

    separator: ClassVar[str] = " "
    digits: ClassVar[int] = 4

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.grid = read.count("grid", 30, minimum=1, maximum=100)
        self.spacing = read.number("spacing", 0.05, above=0.0, maximum=10.0)
        places = self.spacing * (np.arange(self.grid) - (self.grid - 1) / 2)
        left = np.repeat(-places, self.grid)
        self._starts = np.column_stack((np.zeros(self.grid**2), left, np.tile(places, self.grid)))
        self._directions = np.repeat(AHEAD, self.grid**2, axis=0)

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per place of the grid."""
        pose = self.world_pose(robot)
        return (fan_at(pose, self._directions, self.max_range, starts=self._starts),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the points of the whole grid."""
        self.keep(hits[0], self._starts, self._directions)
        return True
