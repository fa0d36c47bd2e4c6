"""Ultrasonic ranging with a cone of rays and a limit of the angle of incidence.

Robots reference 2.2. A wall reflects sound like a mirror, so an oblique surface gives no echo: a
ray of the cone counts only if it meets its surface within `max_incidence` of the normal. UDK
compared the normal with the ray's own direction, by which nearly all facing hits fail and only the
centre ray remains; `literal = true` reproduces that.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.angles import announced_angle
from usarsim_server.sensors.base import SensorContext
from usarsim_server.sensors.fans import cone_directions, fan_at
from usarsim_server.sensors.ranging import SingleRange
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Sonar"]

MAX_CONES = 10
MAX_RAYS_PER_CONE = 16
"""The original's sampling; finer is pointless and would only cost time."""


@register("Sonar", "SonarSensor")
class Sonar(SingleRange):
    """Nearest echo within a cone, clamped to the range limits.

    Parameters: those of `Ranging`, and `beam_angle` (rad, full cone), `max_incidence` (rad),
    `cones` and `rays_per_cone` (sampling: 2 x 8 by default, the original's is 10 x 16), `literal`.
    """

    wire_type: ClassVar[str] = "Sonar"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    default_max_range: ClassVar[float] = 5.0

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.beam_angle = read.number("beam_angle", 0.349, above=0.0, maximum=math.pi)
        self.max_incidence = read.number("max_incidence", 0.17453, above=0.0, maximum=math.pi / 2)
        self.cones = read.count("cones", 2, minimum=0, maximum=MAX_CONES)
        self.rays_per_cone = read.count("rays_per_cone", 8, minimum=1, maximum=MAX_RAYS_PER_CONE)
        self.literal = read.flag("literal", False)
        cones = 0 if self.literal else self.cones
        self._directions = cone_directions(self.beam_angle / 2, cones, self.rays_per_cone)
        self._facing = math.cos(self.max_incidence)
        self._sent = self._directions

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """Axis and cones, with surface normals."""
        fan = fan_at(self.world_pose(robot), self._directions, self.max_range, normals=True)
        self._sent = fan.directions
        return (fan,)

    def distance(self, hits: Sequence[RayHits]) -> float:
        """The centre ray, or a nearer ray of the cone that meets its surface squarely."""
        answer = hits[0]
        nearest = answer.distances[:1]
        if answer.normals is not None:
            against = np.einsum("ij,ij->i", answer.normals, self._sent)
            square = answer.distances[against < -self._facing]
            if square.size:
                nearest = np.minimum(nearest, square.min())
        return max(float(self.echoes(nearest)[0]), self.min_range)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """The limits and the cone (protocol reference 4.8)."""
        beam = fixed(announced_angle(self.beam_angle, dialect), 4)
        if dialect is Dialect.UT2004:
            return (*self.limits(), ("BeamAngle", beam))
        return (
            *self.limits(),
            ("ScanInterval", fixed(self.interval(dialect), 4)),
            ("beamAngle", beam),
            ("maxAngleOfIncidence", fixed(self.max_incidence, 4)),
            ("tracesPerCone", str(self.rays_per_cone)),
            ("numberOfCones", str(self.cones)),
        )
