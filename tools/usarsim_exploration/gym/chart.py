"""A map that scans are drawn into: between the beams is free space, where they end are walls.

Bits are those of maps of `usarsim explore`; rows count down from the top.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.known_map import FREE, WALL

_SHIFT = 8
"""Bits of the places of corners below a pixel."""
_BEHIND = 0.25
"""Cells behind an echo, where the wall is that it came from."""
_SAME = 4.0
"""Cells between the ends of two neighbouring beams that are of one wall."""

Bits = NDArray[np.uint8]


class Chart:
    """A map, m and rad as in physics from outside, cells inside.

    Attributes:
        bits: (rows, columns) what is known; a wall stays one.
    """

    def __init__(self, shape: tuple[int, int], cell: float) -> None:
        """Nothing is known. shape: rows and columns. cell: width of one, m."""
        self.bits: Bits = np.zeros(shape, np.uint8)
        self._cell = cell
        self._seen: Bits = np.zeros(shape, np.uint8)

    def cell_of(self, x: float, y: float) -> Cell:
        """The cell of a place; the nearest for one outside."""
        rows, columns = self.bits.shape
        column, row = int(x / self._cell), rows - 1 - int(y / self._cell)
        return min(max(column, 0), columns - 1), min(max(row, 0), rows - 1)

    def take_in(
        self,
        place: tuple[float, float, float],
        ranges: NDArray[np.float64],
        angles: NDArray[np.float64],
        met: NDArray[np.bool_],
    ) -> Bits:
        """Draw a scan.

        Args:
            place: x, y and heading of the range finder. ranges: (n,) m.
            angles: (n,) of the beams, counterclockwise from the heading.
            met: (n,) which beams ended at a wall.

        Returns:
            (rows, columns) 1 where the scan looked; valid until the next call.
        """
        x, y, heading = place
        turned = angles + heading
        ways = ranges / self._cell + _BEHIND * met
        # cells, the middle of a cell at whole numbers, rows downwards
        corners = np.empty((len(ranges) + 1, 2))
        corners[0] = x / self._cell - 0.5, len(self.bits) - 0.5 - y / self._cell
        corners[1:, 0] = corners[0, 0] + ways * np.cos(turned)
        corners[1:, 1] = corners[0, 1] - ways * np.sin(turned)
        fixed = np.round(corners * (1 << _SHIFT)).astype(np.int32)
        self._seen[:] = 0
        cv2.fillPoly(self._seen, [fixed], 1, cv2.LINE_8, _SHIFT)
        cv2.polylines(self._seen, [fixed], True, 0, 1, cv2.LINE_8, _SHIFT)
        column, row = self.cell_of(x, y)
        self._seen[row, column] = 1
        self.bits |= self._seen * np.uint8(FREE)
        near = np.hypot(*np.diff(corners[1:], axis=0).T) < _SAME
        ends = fixed[1:]
        # an echo without neighbours is a line of no length
        joined = np.where((met[:-1] & met[1:] & near)[:, None], ends[1:], ends[:-1])
        lines = np.stack([ends[:-1], joined], 1)[met[:-1]]
        cv2.polylines(self.bits, list(lines), False, WALL, 1, cv2.LINE_8, _SHIFT)
        return self._seen


def moved(
    place: tuple[float, float, float], way: tuple[float, float, float]
) -> tuple[float, float, float]:
    """A place after a way that begins there: ahead and to the left, m, and turned, rad."""
    x, y, heading = place
    ahead, left, turn = way
    cosine, sine = math.cos(heading), math.sin(heading)
    return x + ahead * cosine - left * sine, y + ahead * sine + left * cosine, heading + turn
