"""The model of the original for buildings: every obstacle takes its share, without end."""

from __future__ import annotations

from usarsim_server.radio.parameters import RadioParameters
from usarsim_server.radio.propagation import LogDistance, Propagation, register

__all__ = ["Obstacle"]


@register("obstacle")
class Obstacle(Propagation):
    """S = P - 10 N log10(d / d0) - k A with k obstacles (side channels reference 4.5).

    The original shows a greatest number of obstacles and does not use it; neither does this model.
    `path-loss` does.
    """

    counts_obstacles = True

    def __init__(self, parameters: RadioParameters) -> None:
        super().__init__(parameters)
        self._law = LogDistance.read(parameters)
        self._attenuation = parameters.number("wall_attenuation", 6.325, low=0.0, high=300.0)

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law less that of the obstacles."""
        return self._law.at(distance) - obstacles * self._attenuation
