"""Gas sensors: the breath of people (robots reference 2.9)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Co2Sensor"]

NEAREST = 0.2
"""m: nearer than this to a mouth the air is mixed."""


@register("CO2Sensor", "CO2")
class Co2Sensor(Sensor):
    """Carbon dioxide above the ambient air, percent by volume.

    The contributions of all who breathe, victims and avatars, add up, each falling with the
    square of the distance; walls do not matter. Parameters: `noise` (standard deviation),
    `ambient`.
    """

    wire_type: ClassVar[str] = "CO2Sensor"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.noise = self.parameters.number("noise", 0.0, minimum=0.0)
        self.ambient = self.parameters.number("ambient", 0.0, minimum=0.0, maximum=100.0)
        self._rng = context.rng
        self._life = context.life
        self._victims = [victim for victim in self._life.victims if victim.traits.co2 > 0.0]
        self.density = 0.0

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the density at the sensor."""
        here = self.world_pose(robot).position
        mouths = [(one.traits.co2, one.head(robot.time)) for one in self._victims]
        mouths += [(one.co2, one.head) for one in self._life.passers(robot.snapshot)]
        density = self.ambient + sum(
            co2 / max(math.dist(head, here), NEAREST) ** 2 for co2, head in mouths
        )
        if self.noise > 0.0:
            density += self.noise * self._rng.standard_normal()
        self.density = min(max(density, 0.0), 100.0)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Gas and Density, four digits: with two a person would be nothing beyond 2.75 m."""
        return (("Gas", "CO2"), ("Density", fixed(self.density, 4)))
