"""Touch pads: a small disc probed by short rays (robots reference 2.8)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import boolean, fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.fans import AHEAD
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.rays import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Touch"]

Array = NDArray[np.float64]

PROBE_LENGTH = 0.003
"""m; what is nearer than this counts as touched."""

PROBE_DEPTH = 0.01
"""m that probes start behind the pad: contacts give way a little, and a ray that starts inside an
object does not see its surface."""

RING_SPACING = 0.005
POINTS_PER_RING = 6


@register("Touch")
class Touch(Sensor):
    """True while something is within a few millimetres of the pad.

    The pad faces along the mount's x axis. Parameters: `diameter`, `probe_length` (m).
    """

    wire_type: ClassVar[str] = "Touch"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    batched: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UT2004})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.1}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.diameter = read.number("diameter", 0.01, above=0.0, maximum=1.0)
        self.probe_length = read.number("probe_length", PROBE_LENGTH, above=0.0, maximum=1.0)
        self._points = _disc(self.diameter / 2)
        self.touched = False

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One short ray per point of the disc, all parallel."""
        pose = self.world_pose(robot)
        turn = pose.matrix()
        starts = self._points @ turn.T + np.array(pose.position)
        ahead = AHEAD @ turn.T
        length = PROBE_DEPTH + self.probe_length
        return [RayFan(start, ahead, length) for start in starts]

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep whether any probe hit."""
        self.touched = any(bool(np.isfinite(answer.distances[0])) for answer in hits)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Touch, True or False."""
        return (("Touch", boolean(self.touched)),)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Diameter."""
        return (("Diameter", fixed(self.diameter, 4)),)


def _disc(radius: float) -> Array:
    """Probe starts (n, 3) in the sensor's frame: the centre and rings of six points."""
    rings = max(1, math.ceil(radius / RING_SPACING - 1e-9))
    radii = np.repeat(radius * np.arange(1, rings + 1) / rings, POINTS_PER_RING)
    angles = np.tile(math.tau * np.arange(POINTS_PER_RING) / POINTS_PER_RING, rings)
    behind = np.full(len(radii), -PROBE_DEPTH)
    around = np.column_stack((behind, radii * np.cos(angles), radii * np.sin(angles)))
    return np.vstack(([[-PROBE_DEPTH, 0.0, 0.0]], around))
