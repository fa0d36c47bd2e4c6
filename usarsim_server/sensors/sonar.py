"""Sonars: the nearest echo within a cone of sound.

A wall reflects ultrasound like a mirror, so an oblique surface gives no echo, and a ray of the cone
counts only if it meets its surface within `max_incidence` of the normal. UDK compared the normal
with the ray's own direction, by which nearly all facing hits fail and only the centre ray remains;
`literal = true` reproduces that.

Robots carry many of them, which report together: a ring of sonars is one fan of rays.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.dialects import FACETS, announced_angle
from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Begun, Sensor, SensorContext, register
from usarsim_server.sensors.ranges import SingleRange, cone_directions, shared
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

Array = NDArray[np.float64]

MAX_CONES = 10
MAX_RAYS_PER_CONE = 16
"""The original's sampling; finer is pointless and would only cost time."""


@register("Sonar", "SonarSensor")
class Sonar(SingleRange):
    """Nearest echo within a cone, clamped to the range limits."""

    wire_type: ClassVar[str] = "Sonar"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    max_range = 5.0

    beam_angle: float = field(default=0.349, above=0.0, high=math.pi, unit="rad", help="full cone")
    max_incidence: float = field(
        default=0.17453, above=0.0, high=math.pi / 2, unit="rad", help="at which there is an echo"
    )
    cones: int = field(default=2, low=0, high=MAX_CONES, help="the original has 10")
    rays_per_cone: int = field(default=8, low=1, high=MAX_RAYS_PER_CONE, help="the original has 16")
    literal: bool = field(default=False, help="only the centre ray, as in UDK")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        cones = 0 if self.literal else self.cones
        rays = cone_directions(self.beam_angle / 2, cones, self.rays_per_cone)
        self.directions: Array = rays @ self.mount.matrix().T
        """Of its rays (n, 3), the axis first, in the frame of what carries it."""
        self.facing = math.cos(self.max_incidence)
        self._ring: _Ring | None = None

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """Axis and cones, with surface normals."""
        return (self._ring_of((self,)).fan(robot),)

    def distance(self, hits: Sequence[RayHits]) -> float:
        """The centre ray, or a nearer ray of the cone that meets its surface squarely."""
        return self.heard(float(self._ring_of((self,)).nearest(hits[0])[0]))

    def heard(self, nearest: float) -> float:
        """The reading (m), given how far away the nearest echo is."""
        echo = self.echo(nearest)
        return echo if echo > self.min_range else self.min_range

    @classmethod
    def begin(cls, sensors: tuple[Self, ...], robot: RobotState) -> Begun:
        """At once, if they have as many rays of the same length and sit on one part of the robot;
        one after the other in classes of others, which may do it otherwise."""
        first = sensors[0]
        ring = first._ring
        if ring is None or ring.sonars is not sensors:
            if cls is not Sonar or any(one.likeness != first.likeness for one in sensors):
                return super().begin(sensors, robot)
            ring = first._ring_of(sensors)

        def measure(hits: Sequence[RayHits]) -> Sequence[Sensor]:
            for sonar, nearest in zip(sensors, ring.nearest(hits[0]).tolist(), strict=True):
                sonar.range = sonar.heard(nearest)
            return sensors

        return (ring.fan(robot),), measure

    @property
    def likeness(self) -> tuple[str | None, int, float]:
        """Equal for those that can be in one ring."""
        return self.link, len(self.directions), self.max_range

    def _ring_of(self, sonars: tuple[Sonar, ...]) -> _Ring:
        """The ring of this one and others; kept, for they are the same again and again."""
        if self._ring is None or self._ring.sonars != sonars:
            self._ring = _Ring(sonars)
        return self._ring

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """The limits and the cone (protocol reference 4.8)."""
        beam = fixed(announced_angle(self.beam_angle, dialect), 4)
        if not FACETS[dialect].sonar_cone:
            return (*self.limits(), ("BeamAngle", beam))
        return (
            *self.limits(),
            ("ScanInterval", fixed(self.interval(dialect), 4)),
            ("beamAngle", beam),
            ("maxAngleOfIncidence", fixed(self.max_incidence, 4)),
            ("tracesPerCone", str(self.rays_per_cone)),
            ("numberOfCones", str(self.cones)),
        )


class _Ring:
    """Sonars on one part of a robot that are read at once, as one fan of rays."""

    def __init__(self, sonars: tuple[Sonar, ...]) -> None:
        """Put sonars together whose `likeness` is equal."""
        self.sonars = sonars
        self._directions = shared(np.concatenate([one.directions for one in sonars]))
        self._places = np.array([one.mount.position for one in sonars])
        self._against = np.array([[-one.facing] for one in sonars])
        self._sent = self._directions

    def fan(self, robot: RobotState) -> RayFan:
        """The rays of all, one sonar after the other."""
        first = self.sonars[0]
        carrier = first.carrier_pose(robot)
        turn = carrier.matrix().T
        self._sent = self._directions.dot(turn)  # `@` takes half as long again
        starts = self._places.dot(turn) + np.array(carrier.position)
        one = len(starts) == 1
        origin = starts[0] if one else starts.repeat(len(first.directions), axis=0)
        return RayFan(origin, self._sent, first.max_range, normals=True)

    def nearest(self, hits: RayHits) -> Array:
        """Of each the nearest echo (m), infinity if there is none."""
        distances = hits.distances.reshape(len(self.sonars), -1)
        if hits.normals is None:
            return distances[:, 0]
        against = np.einsum("ij,ij->i", hits.normals, self._sent).reshape(distances.shape)
        heard = against < self._against
        heard[:, 0] = True  # the centre ray counts whatever it meets
        # Called as it is: the method of arrays takes twice as long.
        echoes: Array = np.minimum.reduce(np.where(heard, distances, np.inf), axis=1)
        return echoes
