"""Scanners that sweep rows of beams (protocol reference 4.6, RangeScanner3D)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.dialects import range_digits
from usarsim_server.protocol.numbers import ranges, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.angles import announced_angle
from usarsim_server.sensors.base import SensorContext, SetResult
from usarsim_server.sensors.fans import fan_at, wire_directions
from usarsim_server.sensors.range_scanner import MIN_RESOLUTION, beam_count
from usarsim_server.sensors.ranging import Ranging
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["RangeScanner3D", "ThreeDRangeScanner"]

Array = NDArray[np.float64]

MAX_BEAMS = 100_000
"""Limit of beams per scan; its text has half a megabyte."""


@register("RangeScanner3D")
class RangeScanner3D(Ranging):
    """A grid of ranges, row by row from up to down, each row from right to left like a scanner's.

    Clients print as many beams per row and rows as field of view / resolution + 1, and both end
    beams are part of a row. The default field is that of a published UT2004 configuration (31 rows
    of 51 beams, every 0.4 s); its text is longer than the 4096 characters that Player's driver can
    take.

    Parameters: those of `Ranging`, and `fov`, `resolution`, `vertical_fov`,
    `vertical_resolution` (rad).
    """

    wire_type: ClassVar[str] = "RangeScanner3D"
    aliases: ClassVar[tuple[str, ...]] = ("rangescanner3d", "3drangescanner")
    time_digits: ClassVar[Mapping[Dialect, int]] = {Dialect.UT2004: 2, Dialect.UDK: 4}
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.4, Dialect.UDK: 0.4}
    default_max_range: ClassVar[float] = 20.0

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.fov, self.resolution, self.columns = self._axis("", 1.0472, 0.0209, 7.0)
        self.vertical_fov, self.vertical_resolution, self.rows = self._axis(
            "vertical_", 0.4363, 0.0145, np.pi
        )
        if self.rows * self.columns > MAX_BEAMS:
            problem = f"{self.rows} rows of {self.columns} beams are more than {MAX_BEAMS} beams"
            raise self.parameters.error("resolution", problem, "write a coarser resolution")
        yaw = self.fov / 2 - self.resolution * np.arange(self.columns)
        pitch = self.vertical_fov / 2 - self.vertical_resolution * np.arange(self.rows)
        self._directions = wire_directions(np.tile(yaw, self.rows), np.repeat(pitch, self.columns))
        self._ranges: Array = np.full(self.rows * self.columns, self.max_range)

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per beam, in the order of the scan."""
        return (fan_at(self.world_pose(robot), self._directions, self.max_range),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep one scan (m)."""
        self._ranges = self.echoes(hits[0].distances)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Resolution and FOV, vertical before horizontal, and Range, row by row."""
        digits = range_digits(dialect, len(self._ranges))
        return (*self._head(dialect), ("Range", ranges(self._ranges, digits)))

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Limits, Resolution and FOV; Player's driver wants FOV in capitals here, too."""
        return (*self.limits(), *self._head(dialect))

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """SCAN asks for one scan now."""
        return SetResult.SCAN if opcode == "SCAN" else SetResult.UNKNOWN

    def _axis(
        self, prefix: str, fov: float, resolution: float, largest: float
    ) -> tuple[float, float, int]:
        """Field of view, step (rad) and number of beams along one axis."""
        read = self.parameters
        fov = read.number(f"{prefix}fov", fov, above=0.0, maximum=largest)
        resolution = read.number(
            f"{prefix}resolution", resolution, minimum=MIN_RESOLUTION, maximum=fov
        )
        return fov, resolution, beam_count(fov, resolution)

    def _head(self, dialect: Dialect) -> tuple[Segment, Segment]:
        def pair(*angles: float) -> str:
            return vector((announced_angle(angle, dialect) for angle in angles), 4)

        return (
            ("Resolution", pair(self.vertical_resolution, self.resolution)),
            ("FOV", pair(self.vertical_fov, self.fov)),
        )


@register("3DRangeScanner")
class ThreeDRangeScanner(RangeScanner3D):
    """The same under the type name that RDK knows; Player knows both."""

    wire_type: ClassVar[str] = "3DRangeScanner"
