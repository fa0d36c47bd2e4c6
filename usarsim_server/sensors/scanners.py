"""Laser range finders that scan a plane, or rows (robots reference 2.3, protocol reference 4.5 to
4.8).

A scan starts at the right, +FOV/2 of wire yaw, and ends at the left; both end beams are part of it.
Scanners in a plane are all `RangeScanner` on the wire.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.protocol.dialects import FACETS, announced_angle, range_digits
from usarsim_server.protocol.numbers import boolean, fixed, ranges, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import EVERYWHERE, SensorContext, register
from usarsim_server.sensors.ranges import LightRanging, Ranging, fan_at, shared, wire_directions
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

Array = NDArray[np.float64]

MIN_RESOLUTION = 1e-4
"""Finest angle between beams, rad: the last digit that is announced."""

MAX_LINE = 2000
LINE_HEAD = 128
"""Clients of UT2004 have line buffers of 2048 bytes, so a scan whose text could outgrow them prints
two digits (protocol reference 5.2 number 14)."""


@register("RangeScanner")
class RangeScanner(LightRanging):
    """A scan of ranges."""

    wire_type: ClassVar[str] = "RangeScanner"
    time_digits: ClassVar[Mapping[Dialect, int]] = {Dialect.UT2004: 2, Dialect.UDK: 4}
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    scans = True
    max_range = 4.0
    last_beam: ClassVar[bool] = True
    """Whether a beam at exactly -FOV/2 is part of the scan."""

    fov: float = field(default=3.14, above=0.0, high=7.0, unit="rad")
    resolution: float = field(default=0.157, low=MIN_RESOLUTION, unit="rad", help="between beams")
    sweep: str = field(
        default="yaw", choices=("yaw", "pitch"), any_case=True, help="pitch: nods, from up to down"
    )
    strict_min_range: bool = field(
        default=False, help="nearer echoes are misses, as they never were in the original"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        check_resolution(self.parameters, self.resolution, self.fov)
        self.beams = beam_count(self.fov, self.resolution, self.last_beam)
        self._directions = shared(self._scan_directions())
        self._ranges: Array = np.full(self.beams, self.max_range)
        self._heads = {dialect: self._head(dialect) for dialect in Dialect}
        self._digits = {dialect: self._range_digits(dialect) for dialect in Dialect}

    @property
    def scan(self) -> Array:
        """The last scan (m), (beams,), from the right to the left; not to be written to."""
        return self._ranges

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per beam, in the order of the scan."""
        return self.beams_of(robot, self._directions)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep one scan (m)."""
        distances = self._sight.receive(hits[0].distances)
        if self.strict_min_range:
            distances = np.where(distances < self.min_range, np.inf, distances)
        self._ranges = self._sight.blank(self.echoes(distances))
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Resolution, FOV and, last, Range."""
        return (*self._heads[dialect], ("Range", ranges(self._ranges, self._digits[dialect])))

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Limits, Resolution, Fov and the flags for panning and tilting."""
        (resolution, (_, fov)) = self._heads[dialect]
        return (
            *self.limits(),
            resolution,
            ("Fov", fov),
            (FACETS[dialect].panning_key, boolean(self.sweep == "yaw")),
            ("Tilting", boolean(self.sweep == "pitch")),
        )

    def _scan_directions(self) -> Array:
        angles: Array = self.fov / 2 - self.resolution * np.arange(self.beams, dtype=np.float64)
        return wire_directions(angles) if self.sweep == "yaw" else wire_directions(0.0, angles)

    def _head(self, dialect: Dialect) -> tuple[Segment, Segment]:
        return (
            ("Resolution", fixed(announced_angle(self.resolution, dialect), 4)),
            ("FOV", fixed(announced_angle(self.fov, dialect), 4)),
        )

    def _range_digits(self, dialect: Dialect) -> int:
        digits = range_digits(dialect, self.beams)
        longest = self.beams * (len(fixed(self.max_range, digits)) + 1) + LINE_HEAD
        return digits if longest <= MAX_LINE else min(digits, 2)


@register("SICK")
class Sick(RangeScanner):
    """SICK LMS200 as USARSim had it: 181 beams of one degree, 20 m."""

    max_range = 20.0
    fov = 3.14159
    resolution = 0.01745


@register("Hokuyo", "HokuyoURG04LX")
class Hokuyo(RangeScanner):
    """Hokuyo URG-04LX as USARSim had it: 228 beams over 240 degrees, 4 m."""

    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.3}
    fov = 4.189
    smoke = "budget"
    resolution = 0.0184086914


@register("IRScanner")
class InfraredScanner(RangeScanner):
    """Infrared scanner: looks through glass, keeps to both limits, has no beam at the very end.

    UDK sent a single range by mistake; the scanner form is what clients expect (protocol
    reference 4.6).
    """

    wire_type: ClassVar[str] = "IRScanner"
    timed: ClassVar[frozenset[Dialect]] = EVERYWHERE
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.1}
    min_range = 0.2
    max_range = 10.0
    resolution = 0.087
    through_glass: ClassVar[bool] = True
    last_beam: ClassVar[bool] = False

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep one scan (m), no range below the minimum."""
        super().measure(robot, hits)
        self._ranges = np.maximum(self._ranges, self.min_range)
        return True


def check_resolution(table: Table, resolution: float, fov: float, key: str = "resolution") -> None:
    """Refuse steps between beams that are wider than their field of view (both rad)."""
    if resolution > fov:
        cure = f"write a number of at most {fov:g}"
        raise table.error(key, f"{resolution!r} is out of range", cure)


def beam_count(fov: float, resolution: float, last_beam: bool = True) -> int:
    """Number of beams over a field of view, as clients compute it.

    The count that follows from the printed numbers is the upper bound, in either dialect: a client
    that divides them allocates that much (protocol reference 5.2 number 15).
    """
    steps = [math.floor(fov / resolution + 1e-6)]
    for dialect in Dialect:
        printed_fov = float(fixed(announced_angle(fov, dialect), 4))
        printed_resolution = float(fixed(announced_angle(resolution, dialect), 4))
        if printed_resolution > 0.0:
            steps.append(math.floor(printed_fov / printed_resolution + 1e-6))
    ends_on_a_beam = math.isclose(min(steps) * resolution, fov, rel_tol=1e-6)
    return min(steps) + (1 if last_beam or not ends_on_a_beam else 0)


MAX_BEAMS = 100_000
"""Limit of beams per scan; its text has half a megabyte."""


@register("RangeScanner3D")
class RangeScanner3D(Ranging):
    """A grid of ranges, row by row from up to down, each row from right to left like a scanner's.

    Clients print as many beams per row and rows as field of view / resolution + 1, and both end
    beams are part of a row. The default field is that of a published UT2004 configuration (31 rows
    of 51 beams, every 0.4 s); its text is longer than the 4096 characters that Player's driver can
    take.
    """

    wire_type: ClassVar[str] = "RangeScanner3D"
    aliases: ClassVar[tuple[str, ...]] = ("rangescanner3d", "3drangescanner")
    time_digits: ClassVar[Mapping[Dialect, int]] = {Dialect.UT2004: 2, Dialect.UDK: 4}
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.4, Dialect.UDK: 0.4}
    scans = True
    max_range = 20.0
    fov: float = field(default=1.0472, above=0.0, high=7.0, unit="rad")
    resolution: float = field(default=0.0209, low=MIN_RESOLUTION, unit="rad", help="of a row")
    vertical_fov: float = field(default=0.4363, above=0.0, high=np.pi, unit="rad")
    vertical_resolution: float = field(
        default=0.0145, low=MIN_RESOLUTION, unit="rad", help="between rows"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        check_resolution(self.parameters, self.resolution, self.fov)
        check_resolution(
            self.parameters, self.vertical_resolution, self.vertical_fov, "vertical_resolution"
        )
        self.columns = beam_count(self.fov, self.resolution)
        self.rows = beam_count(self.vertical_fov, self.vertical_resolution)
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
