"""Line lasers: a fan of beams whose points are reported in the world (robots reference 2.3)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.angles import announced_angle
from usarsim_server.sensors.base import NOWHERE, SensorContext
from usarsim_server.sensors.fans import fan_at, wire_directions
from usarsim_server.sensors.point_lists import point_texts, wire_points
from usarsim_server.sensors.ranging import Ranging
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.frames import IDENTITY, wire_from_pose
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["LineLaser"]

Array = NDArray[np.float64]


@register("LineLaser")
class LineLaser(Ranging):
    """True pose of the sensor and the point of every beam, in the world frame.

    Beams run from -FOV/2, the left, to +FOV/2, both included. A beam without hit gives the point
    at the maximum range, so that the number of points is constant. The original measured once and
    repeated that text for ever: `literal` = true. The pieces of line into which it grouped the
    points were drawn on its screen and never sent (LineLaser.uc of robocup-usarsim).

    Parameters: those of `Ranging`, and `fov` (rad), `beams`, `literal`.
    """

    wire_type: ClassVar[str] = "LineLaser"
    timed: ClassVar[frozenset[Dialect]] = NOWHERE
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.1}
    default_max_range: ClassVar[float] = 5.0

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.fov = read.number("fov", 1.570796, above=0.0, maximum=7.0)
        self.beams = read.count("beams", 120, minimum=2, maximum=10_000)
        self.literal = read.flag("literal", False)
        self._directions = wire_directions(np.linspace(-self.fov / 2, self.fov / 2, self.beams))
        self._pose = IDENTITY
        self._points: Array | None = None

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per beam; none once the literal sensor has measured."""
        if self.literal and self._points is not None:
            return ()
        return (fan_at(self.world_pose(robot), self._directions, self.max_range),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the pose and the points."""
        if hits:
            self._pose = self.world_pose(robot)
            along = self._directions * self.echoes(hits[0].distances)[:, None]
            self._points = along @ self._pose.matrix().T + np.array(self._pose.position)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Location and Orientation, four digits, and Points, three digits."""
        location, orientation = wire_from_pose(self._pose)
        points = np.zeros((0, 3)) if self._points is None else wire_points(self._points)
        return (
            ("Location", vector(location, 4)),
            ("Orientation", vector(orientation, 4)),
            ("Points", "".join(f"[{text}]" for text in point_texts(points, 3))),
        )

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Limits, FOV and the number of beams (protocol reference 4.8)."""
        fov = fixed(announced_angle(self.fov, dialect), 4)
        return (*self.limits(), ("FOV", fov), ("Resolution", str(self.beams)))
