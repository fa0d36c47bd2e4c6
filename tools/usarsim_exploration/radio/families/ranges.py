"""Radios that end at a distance: a circle, and a circle that walls cut (exploration 10.1, 10.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.radio.models import Floats, Ranged, register


@register("circle")
@dataclass(frozen=True)
class Circle(Ranged):
    """Linked nearer than the range, whatever stands between."""

    def hears(self, distance: float, reach: float, walls: int, cell: float) -> bool:
        """Whether the distance is below the range."""
        return distance < reach

    def linked(
        self, away: Floats, reach: Floats, walls: NDArray[np.int64], cell: float
    ) -> NDArray[np.bool_]:
        """`hears` of many pairs."""
        return np.asarray(away < reach)


@register("sight")
@dataclass(frozen=True)
class Sight(Ranged):
    """Linked nearer than the range, if no cell of a wall lies on the line between."""

    counts_walls = True

    def hears(self, distance: float, reach: float, walls: int, cell: float) -> bool:
        """Whether the distance is below the range, and nothing between."""
        return distance < reach and not walls
