"""What all sensors that measure distances share: limits, misses and noise."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Ranging", "SingleRange"]

Array = NDArray[np.float64]


class Ranging(Sensor):
    """A sensor of distances.

    Parameters of the robot file: `min_range`, `max_range` (m); `noise` (m) and `noise_ratio`
    (fraction of the distance): the larger of both is the standard deviation of a Gaussian error of
    every echo. The original had no noise (robots reference 2.3), so both are 0 by default.
    """

    default_min_range: ClassVar[float] = 0.1
    default_max_range: ClassVar[float]

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.min_range = read.number("min_range", self.default_min_range, minimum=0.0)
        self.max_range = read.number("max_range", self.default_max_range, above=self.min_range)
        self._sigma = read.number("noise", 0.0, minimum=0.0)
        self._sigma_ratio = read.number("noise_ratio", 0.0, minimum=0.0)
        self._rng = context.rng

    def echoes(self, distances: Array) -> Array:
        """Distances with noise, misses and everything too far set to the maximum range."""
        ranges = np.minimum(distances, self.max_range)
        if self._sigma > 0.0 or self._sigma_ratio > 0.0:
            deviation = np.maximum(self._sigma, self._sigma_ratio * ranges)
            noisy = ranges + deviation * self._rng.standard_normal(ranges.shape)
            hit = distances < self.max_range
            ranges = np.where(hit, np.clip(noisy, 0.0, self.max_range), self.max_range)
        return ranges

    def limits(self) -> tuple[Segment, ...]:
        """The MaxRange and MinRange segments of CONF."""
        return (("MaxRange", fixed(self.max_range, 4)), ("MinRange", fixed(self.min_range, 4)))


class SingleRange(Ranging):
    """A sensor with one distance per reading: sonar, infrared, range finder."""

    batched: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UT2004})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.1}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.range = self.max_range

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the distance of the nearest accepted echo (m)."""
        self.range = self.distance(hits)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Range, four digits in both dialects (protocol reference 2.2)."""
        return (("Range", fixed(self.range, 4)),)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """MaxRange and MinRange."""
        return self.limits()

    @abstractmethod
    def distance(self, hits: Sequence[RayHits]) -> float:
        """The reading (m) that the ray answers amount to."""
