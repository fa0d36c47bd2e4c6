"""A map of what the scans of all robots have seen: unknown, free, wall."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usarsim_operator import packets

CELL = 0.1
"""Side of a cell, m."""
_SIDE = 256  # cells of the first map
_LARGEST = 2048  # cells of a side
_BEAMS = 181  # of a scan, at most
_HIT, _PASS, _SURE = 6, -1, 40


class OccupancyMap:
    """Counts how often each cell was hit and passed. It grows up to 205 m a side.

    Attributes:
        version: counts what was added.
    """

    def __init__(self) -> None:
        self.version = 0
        self._belief = np.zeros((_SIDE, _SIDE), np.int8)
        self._seen = np.zeros((_SIDE, _SIDE), np.bool_)
        self._corner = (-_SIDE * CELL / 2.0, -_SIDE * CELL / 2.0)

    def add(
        self,
        pose: tuple[float, float, float],
        bearings: NDArray[np.float64],
        ranges: NDArray[np.float64],
        most: float,
    ) -> None:
        """Add a flat scan.

        Args:
            pose: x, y (m), yaw (rad) of the scanner.
            bearings: (n,) rad, right positive. ranges: (n,) m.
            most: m from which on a range is no echo.
        """
        stride = max(1, -(-len(ranges) // _BEAMS))
        bearings, ranges = bearings[::stride], ranges[::stride]
        good = np.isfinite(ranges) & (ranges > 0.05)
        bearings, ranges = bearings[good] + pose[2], ranges[good]
        if not len(ranges) or not all(math.isfinite(one) for one in pose):
            return
        reach = np.minimum(ranges, 30.0)
        dx, dy = np.cos(bearings), np.sin(bearings)
        steps = np.arange(0.0, float(reach.max()), CELL * 0.9)
        on_way = steps[None, :] < reach[:, None] - CELL
        free_x = (pose[0] + steps[None, :] * dx[:, None])[on_way]
        free_y = (pose[1] + steps[None, :] * dy[:, None])[on_way]
        echo = ranges < min(most - 0.05, 30.0)
        hit_x = pose[0] + ranges[echo] * dx[echo]
        hit_y = pose[1] + ranges[echo] * dy[echo]
        self._include(np.concatenate((free_x, hit_x)), np.concatenate((free_y, hit_y)))
        touched = np.zeros(self._belief.size, np.uint8)  # a mask is cheaper than sorting
        touched[self._cells(free_x, free_y)] = 1
        touched[self._cells(hit_x, hit_y)] = 2
        self._vote(np.flatnonzero(touched == 1), _PASS)
        self._vote(np.flatnonzero(touched == 2), _HIT)
        self.version += 1

    def _cells(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.int64]:
        """Numbers of the cells of places; those outside are left out."""
        rows, columns = self._belief.shape
        column = np.floor((x - self._corner[0]) / CELL).astype(np.int64)
        row = np.floor((y - self._corner[1]) / CELL).astype(np.int64)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows)
        found: NDArray[np.int64] = row[inside] * columns + column[inside]
        return found

    def _vote(self, cells: NDArray[np.int64], weight: int) -> None:
        flat = self._belief.reshape(-1)
        flat[cells] = np.clip(flat[cells].astype(np.int16) + weight, -_SURE, _SURE)
        self._seen.reshape(-1)[cells] = True

    def _include(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> None:
        """Double the map towards what lies outside, while it may grow."""
        for axis, values in ((1, x), (0, y)):
            if not len(values):
                continue
            while True:
                size = self._belief.shape[axis]
                low = self._corner[0 if axis == 1 else 1]
                before = float(values.min()) < low
                after = float(values.max()) >= low + size * CELL
                if size * 2 > _LARGEST or not (before or after):
                    break
                pads = [(0, 0), (0, 0)]
                pads[axis] = (size, 0) if before else (0, size)
                self._belief, self._seen = np.pad(self._belief, pads), np.pad(self._seen, pads)
                if before:
                    corner = list(self._corner)
                    corner[0 if axis == 1 else 1] -= size * CELL
                    self._corner = corner[0], corner[1]

    @property
    def corner(self) -> tuple[float, float]:
        """x, y of the corner of the first cell, m."""
        return self._corner

    def cells(self) -> NDArray[np.uint8]:
        """(rows, columns): 0 unknown, 1 free, 2 wall; rows along y, columns along x."""
        found = (self._belief > 0).view(np.uint8)
        found += 1
        found *= self._seen.view(np.uint8)
        return found

    def part(self) -> tuple[tuple[float, float], NDArray[np.uint8]] | None:
        """The part that was seen: x, y of its corner, m, and its cells; None if there is none."""
        found = self.cells()
        rows, columns = np.flatnonzero(found.any(1)), np.flatnonzero(found.any(0))
        if not len(rows):
            return None
        corner = (
            self._corner[0] + float(columns[0]) * CELL,
            self._corner[1] + float(rows[0]) * CELL,
        )
        return corner, found[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]

    def packed(self) -> bytes:
        """Contents of a map message; only the part that was seen."""
        corner, cells = self.part() or (self._corner, np.zeros((1, 1), np.uint8))
        return packets.grid(CELL, corner, cells)
