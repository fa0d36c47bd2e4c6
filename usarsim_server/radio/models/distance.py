"""Free space: the signal falls with the logarithm of the distance."""

from __future__ import annotations

from usarsim_server.radio.parameters import RadioParameters
from usarsim_server.radio.propagation import LogDistance, Propagation, register

__all__ = ["DistanceOnly"]


@register("distance", "DistanceOnly")
class DistanceOnly(Propagation):
    """S = P - 10 N log10(d / d0), walls or not (side channels reference 4.5)."""

    trusting = True

    def __init__(self, parameters: RadioParameters) -> None:
        super().__init__(parameters)
        self._law = LogDistance.read(parameters)

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law."""
        return self._law.at(distance)
