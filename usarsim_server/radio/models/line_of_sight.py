"""Light-like radio: any obstacle ends it."""

from __future__ import annotations

from usarsim_server.radio.parameters import RadioParameters
from usarsim_server.radio.propagation import NOTHING, LogDistance, Propagation, register

__all__ = ["LineOfSight"]


@register("line-of-sight")
class LineOfSight(Propagation):
    """The log-distance law where nothing stands between, nothing elsewhere.

    `range` (m, 0 for none) also ends a link in free sight, as in the exploration reference 10.2.
    """

    counts_obstacles = True

    def __init__(self, parameters: RadioParameters) -> None:
        super().__init__(parameters)
        self._law = LogDistance.read(parameters)
        self._range = parameters.number("range", 0.0, low=0.0, high=1e6)

    def strength(self, distance: float, obstacles: int) -> float:
        """dBm of the log-distance law in sight and within the range, else next to nothing."""
        if obstacles or (self._range and distance > self._range):
            return NOTHING
        return self._law.at(distance)
