"""Depth cameras and point clouds, by rays (robots reference 2.3, protocol reference 4.6).

A depth image is sent in frames of a few rows, one frame per interval, and each frame casts only its
own rows at its own moment: 3840 rays ten times a second instead of 76,800 at once. A robot that
moves meanwhile distorts its image, as it did in the original.

Point clouds (PCL) are in the sensor's own frame. Both kinds are built of sonars in the original,
which amount to one ray each (robots reference 2.2), and like those they clamp to both range limits,
so that a beam without echo gives a point at the maximum range and the number of points is constant.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.dialects import FACETS, announced_angle
from usarsim_server.protocol.numbers import boolean, fixed, ranges, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.robots.mounting import SetResult
from usarsim_server.sensors.base import SensorContext, register
from usarsim_server.sensors.ranges import (
    AHEAD,
    Ranging,
    fan_at,
    point_texts,
    wire_directions,
    wire_points,
)
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

Array = NDArray[np.float64]

DIGITS = 2
"""Digits of a depth; the original lost the zero of 3.05 (protocol reference 5.2 number 28)."""


@register("RangeImager", "KinectDepth")
class RangeImager(Ranging):
    """Depth image on request: SET SCAN starts one, it comes in `frames` reports, then it is idle.

    Depth is measured along the sensor's axis, not along the ray. Rows come from top to bottom, the
    pixels of a row from left to right. The first ray of a row points to -FOV/2, the first row to
    +FOV/2, the next a FOV/pixels further, as in the original (KinectDepth.uc of robocup-usarsim). A
    SCAN during an image changes nothing. With an interval of 0 each SCAN sends one frame.
    """

    wire_type: ClassVar[str] = "RangeImager"
    time_digits: ClassVar[Mapping[Dialect, int]] = {Dialect.UT2004: 2, Dialect.UDK: 4}
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.1, Dialect.UDK: 0.1}
    max_range = 20.0

    fov: float = field(default=1.01226, above=0.0, high=np.pi, unit="rad")
    vertical_fov: float = field(default=0.7854, above=0.0, high=np.pi, unit="rad")
    width: int = field(default=320, low=1, high=1280, help="pixels")
    height: int = field(default=240, low=1, high=1024, help="pixels")
    frames: int = field(default=20, low=1, high=1024, help="reports that an image takes")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        if self.height % self.frames:
            problem = f"{self.height} rows cannot be divided into {self.frames} equal frames"
            raise self.parameters.error("frames", problem, "write a divisor of height")
        self._yaw = self.fov * (np.arange(self.width) / self.width - 0.5)
        self._pitch = self.vertical_fov * (0.5 - np.arange(self.height) / self.height)
        self._next: int | None = None
        """Frame of the next report; None while idle."""
        self._frame: int | None = None
        """Frame of the last report; None if it was idle."""
        self._depths: Array = np.zeros(0)

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per pixel of the next frame, none while idle."""
        if self._next is None:
            return ()
        return (fan_at(self.world_pose(robot), self._directions(self._next), self.max_range),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the depths (m) of one frame, or that there is nothing to send."""
        self._frame = self._next
        if self._frame is None:
            return True
        distances = hits[0].distances
        depths = self.echoes(distances) * self._directions(self._frame)[:, 0]
        self._depths = np.where(distances < self.max_range, depths, self.max_range)
        following = self._frame + 1
        self._next = following if following < self.frames else None
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Size of the image, numbers of frames, and the Range list of one frame.

        The list ends in a comma in the udk dialect, as clients of that generation expect.
        """
        counts = (
            ("Frames", str(0 if self._frame is None else self.frames)),
            ("Frame", str(self._frame or 0)),
        )
        comma = "," if FACETS[dialect].image_pairs else ""
        text = "" if self._frame is None else ranges(self._depths, DIGITS) + comma
        depths = (("Range", text),) if text else ()
        resolution, fov = self._size(dialect)
        head = (("Resolution", resolution), ("FOV", fov))
        if FACETS[dialect].image_pairs:
            return (*head, *counts, *depths)
        return (*counts, *head, *depths)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """As a scanner in ut2004, with the size of the image in udk (protocol reference 4.8)."""
        resolution, fov = self._size(dialect)
        head = (*self.limits(), ("Resolution", resolution), ("Fov", fov))
        if FACETS[dialect].image_pairs:
            return head
        flags = ((FACETS[dialect].panning_key, boolean(True)), ("Tilting", boolean(False)))
        return (*head, *flags)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """SCAN starts an image with the next report."""
        if opcode != "SCAN":
            return SetResult.UNKNOWN
        if self._next is None:
            self._next = 0
        return SetResult.SCAN if self.own_interval == 0.0 else SetResult.OK

    def _directions(self, frame: int) -> Array:
        """Rays (n, 3) of one frame in the sensor's frame."""
        rows = self.height // self.frames
        pitch = self._pitch[frame * rows : (frame + 1) * rows]
        return wire_directions(np.tile(self._yaw, rows), np.repeat(pitch, self.width))

    def _size(self, dialect: Dialect) -> tuple[str, str]:
        """Values of Resolution and FOV: pixels and both angles, or in ut2004 one angle each."""

        def angle(value: float) -> float:
            return announced_angle(value, dialect)

        if FACETS[dialect].image_pairs:
            fov = vector((angle(self.fov), angle(self.vertical_fov)), 4)
            return f"{self.width},{self.height}", fov
        return fixed(angle(self.fov / self.width), 4), fixed(angle(self.fov), 4)


PHASE_SLACK = 1e-9
"""Part of a turn by which simulated time may fall short of a turn and still count as the next."""


class _PointCloud(Ranging):
    """A list of points (n, 3) in the sensor's frame."""

    wire_type: ClassVar[str] = "PCL"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    max_range = 40.0
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

    Each reading is one row, at the pitch of its moment.
    """

    separator: ClassVar[str] = ";"
    digits: ClassVar[int] = 2

    beams: int = field(default=256, low=2, high=10_000, help="in a row")
    fov: float = field(default=2.094395, above=0.0, high=7.0, unit="rad")
    vertical_fov: float = field(default=0.785398, low=0.0, high=np.pi, unit="rad")
    spin_period: float = field(default=1.0, low=0.01, unit="s", help="of one rise")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
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
    """A square grid of parallel rays; columns from left to right, each from bottom to top."""

    separator: ClassVar[str] = " "
    digits: ClassVar[int] = 4

    grid: int = field(default=30, low=1, high=100, help="rays per side")
    spacing: float = field(default=0.05, above=0.0, high=10.0, unit="m", help="of the rays")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
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
