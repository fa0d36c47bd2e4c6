"""Lists of points as text, fast enough for a thousand of them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import ranges
from usarsim_server.simulation.frames import flip_point

__all__ = ["point_texts", "wire_points"]

Array = NDArray[np.float64]

_FLIP = np.array(flip_point((1.0, 1.0, 1.0)))


def wire_points(points: Array) -> Array:
    """Points (n, 3) of a simulation frame in the wire frame that belongs to it."""
    turned: Array = points * _FLIP
    return turned


def point_texts(points: Array, digits: int) -> list[str]:
    """Every point (n, 3) as `x,y,z`."""
    texts = ranges(points, digits).split(",")
    return [",".join(texts[i : i + 3]) for i in range(0, 3 * len(points), 3)]
