"""What a robot has seen of walls: one line for each cell and side of a wall.

Each cell of a fine grid holds, for each of four directions that a wall can face, the mean of the
points that were seen there and of their normals. So both sides of a thin wall are kept apart, and
the nearest wall of a side is looked up in a table that OpenCV makes (a distance transform that
names the nearest cell).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.localisation.poses import Pose
from usarsim_exploration.localisation.surfaces import Floats

Ints = NDArray[np.int64]
FINE = 0.1
"""Width of a cell, m."""
_MARGIN = 1.0
"""Around the world, as poses are not certain, m."""
_ENOUGH = 10
"""Points by which a cell is settled."""
_THROUGH = 0.3
"""A wall that is nearer than a beam went by more than this is not there, m."""
_SIDES = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
_FACES = 0.5
"""Cosine up to which a wall counts for a side: slanting ones count for two."""


class PointMap:
    """Walls as one robot saw them."""

    def __init__(self, size: tuple[float, float]) -> None:
        """Nothing is known. size: of the world, x and y, m."""
        columns, rows = (int((length + 2 * _MARGIN) / FINE) + 1 for length in size)
        self._rows = np.full((4, rows, columns), -1, np.int32)
        """Row of `_sums` of a side and cell; -1: nothing was seen."""
        self._sums = np.zeros((1024, 5))
        """Of points, of normals, and how many."""
        self._used = 0
        self._corner = 0, 0
        self._nearest = np.full((4, 1, 1), -1, np.int32)

    def add(self, points: Floats, normals: Floats) -> None:
        """Take in points (n, 2) of walls with normals (n, 2), all finite."""
        column, row, inside = self._cells(points)
        for side, direction in enumerate(_SIDES):
            chosen = inside & (normals @ direction > _FACES)
            where = side, row[chosen], column[chosen]
            self._settle(where)
            known = self._rows[where]
            fresh = self._sums[known, 4] < _ENOUGH
            values = np.column_stack([points[chosen], normals[chosen], np.ones(len(known))])
            np.add.at(self._sums, known[fresh], values[fresh])

    def _settle(self, where: tuple[int, Ints, Ints]) -> None:
        """Make room for cells that were not seen before."""
        side, row, column = where
        flat = np.unique((row * self._rows.shape[2] + column)[self._rows[where] < 0])
        if self._used + len(flat) > len(self._sums):
            more = max(len(self._sums), len(flat))
            self._sums = np.concatenate([self._sums, np.zeros((more, 5))])
        self._rows[side].reshape(-1)[flat] = np.arange(self._used, self._used + len(flat))
        self._used += len(flat)

    def forget(self, pose: Pose, ranges: Floats, angles: Floats) -> None:
        """Forget walls that a scan has looked through: they were robots, or a door is open now.

        Args:
            pose: of the scanner. ranges: (n,) m that are certainly free; 0: nothing is known.
            angles: (n,) rad, rising.
        """
        x, y, heading = pose
        turns = heading + angles
        tips = np.column_stack([x + ranges * np.cos(turns), y + ranges * np.sin(turns)])
        columns, rows, _ = self._cells(np.vstack([tips, (x, y)]))
        height, width = self._rows.shape[1:]
        left, top = max(int(columns.min()), 0), max(int(rows.min()), 0)
        right, bottom = min(int(columns.max()) + 1, width), min(int(rows.max()) + 1, height)
        part = self._rows[:, top : max(bottom, top), left : max(right, left)].copy()
        found = np.flatnonzero(part >= 0)  # np.nonzero takes five times as long
        sums = self._sums[part.reshape(-1)[found]]
        away = sums[:, :2] / sums[:, 4:] - (x, y)
        far = np.hypot(away[:, 0], away[:, 1])
        turn = np.arctan2(away[:, 1], away[:, 0]) - heading - angles[0]
        place = np.searchsorted(angles - angles[0], turn % (2 * np.pi))
        seen = (place > 0) & (place < len(angles))
        place = np.clip(place, 1, len(angles) - 1)
        free = np.minimum(ranges[place - 1], ranges[place])
        part.reshape(-1)[found[seen & (far < free - _THROUGH)]] = -1
        self._rows[:, top : max(bottom, top), left : max(right, left)] = part

    def prepare(self, low: Floats, high: Floats) -> None:
        """Make the table for a part of the world, from one corner (x, y), m, to another."""
        height, width = self._rows.shape[1:]
        left, top = np.clip(((low + _MARGIN) / FINE).astype(int), 0, [width - 1, height - 1])
        right, bottom = np.clip(((high + _MARGIN) / FINE).astype(int) + 1, 1, [width, height])
        part = self._rows[:, top : max(bottom, top + 1), left : max(right, left + 1)]
        self._corner = int(left), int(top)
        self._nearest = np.full(part.shape, -1, np.int32)
        for side, known in enumerate(part):
            free = (known < 0).view(np.uint8)
            if free.all():
                continue
            _, labels = cv2.distanceTransformWithLabels(
                free, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
            )
            rows = np.empty(int(labels.max()) + 1, np.int32)
            rows[labels[free == 0]] = known[free == 0]
            self._nearest[side] = rows[labels]

    def nearest(self, points: Floats, normals: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
        """The walls next to points that face the same way.

        Args:
            points, normals: (n, 2).

        Returns:
            Points and normals of the map, (n, 2), and which of them there are.
        """
        side = np.argmax(normals @ _SIDES.T, axis=1)
        column, row, _ = self._cells(points)
        column, row = column - self._corner[0], row - self._corner[1]
        height, width = self._nearest.shape[1:]
        inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
        column, row = np.clip(column, 0, width - 1), np.clip(row, 0, height - 1)
        known = self._nearest[side, row, column]
        sums = self._sums[known]
        found = inside & (known >= 0)
        means = sums[:, :2] / np.maximum(sums[:, 4:], 1)
        lengths = np.hypot(sums[:, 2], sums[:, 3])
        return means, sums[:, 2:4] / np.maximum(lengths, 1e-9)[:, None], found

    def _cells(self, points: Floats) -> tuple[Ints, Ints, NDArray[np.bool_]]:
        """Columns and rows of points, and which of them are inside."""
        cells = np.floor((points + _MARGIN) / FINE).astype(np.int64)
        height, width = self._rows.shape[1:]
        column, row = cells.T
        return column, row, (column >= 0) & (column < width) & (row >= 0) & (row < height)
