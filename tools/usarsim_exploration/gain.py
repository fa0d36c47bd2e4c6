"""What a robot expects to see from a place: unknown cells in sight, by its map, walls known so far.

Unknown cells hide nothing unless a map is predicted; then walls go on straight across gaps that
nobody has seen, which is what walls of buildings do.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels import march
from usarsim_exploration.known_map import FREE, KNOWN, WALL, KnownMap

RAYS = 72
"""Of a view all around."""

Cells = NDArray[np.int64]
"""(n, 2) columns and rows."""


@lru_cache(maxsize=16)
def _fan(reach: int) -> tuple[Cells, Cells, NDArray[np.float64]]:
    """Columns and rows of the cells of all rays, (rays, reach); and what one stands for, cells."""
    angles = 2 * np.pi * np.arange(RAYS) / RAYS
    along = np.arange(1, reach + 1)
    columns = np.round(np.cos(angles)[:, None] * along).astype(np.int64)
    rows = np.round(np.sin(angles)[:, None] * along).astype(np.int64)
    return columns, rows, along.astype(np.float64) * (2 * np.pi / RAYS)


def predicted_walls(known: KnownMap, gap: int) -> NDArray[np.bool_]:
    """Unknown cells in gaps of walls along rows or columns, of at most `gap` cells, even."""
    bits = known.bits
    walls = (bits & WALL != 0).astype(np.uint8)
    line = np.ones((1, gap // 2 * 2 + 1), np.uint8)
    row = cv2.morphologyEx(walls, cv2.MORPH_CLOSE, line) != 0
    column = cv2.morphologyEx(walls, cv2.MORPH_CLOSE, line.T) != 0
    found: NDArray[np.bool_] = (row | column) & (bits & KNOWN == 0)
    return found


class Outlook:
    """The unknown cells that can be seen from places; those promised to somebody count no more."""

    def __init__(self, known: KnownMap, reach: int, gap: int = 0) -> None:
        """reach: of the scanner, cells. gap: see `predicted_walls`; 0: predict nothing."""
        bits, self._reach = known.bits, reach
        rows, columns = bits.shape
        walls = (bits & WALL != 0) & (bits & FREE == 0)
        unknown = bits & KNOWN == 0
        if gap:
            predicted = predicted_walls(known, gap)
            walls, unknown = walls | predicted, unknown & ~predicted
        self._blocked = np.ones((rows + 2 * reach, columns + 2 * reach), np.uint8)
        self._blocked[reach:-reach, reach:-reach] = walls
        self._unknown = np.zeros(self._blocked.shape, np.uint8)
        self._unknown[reach:-reach, reach:-reach] = unknown

    def gains(self, cells: Cells) -> NDArray[np.float64]:
        """Area of the unknown in sight of each cell, cells."""
        columns, rows, area = _fan(self._reach)
        starts, lengths = self._march(cells)
        found = np.empty(len(cells))
        unknown, stride = self._unknown.reshape(-1), self._blocked.shape[1]
        along = np.arange(self._reach)
        offsets = rows * stride + columns
        for index, (start, length) in enumerate(zip(starts, lengths, strict=True)):
            seen = unknown[start + offsets] * (along < length[:, None])
            found[index] = float((seen * area).sum())
        return found

    def promise(self, cells: Cells) -> None:
        """Somebody looks from these cells: what is seen from there is new to nobody else."""
        columns, rows, _ = _fan(self._reach)
        _, lengths = self._march(cells)
        ray = np.arange(RAYS)
        for cell, length in zip(cells, lengths, strict=True):
            last = np.maximum(length - 1, 0)
            corners = np.stack([columns[ray, last], rows[ray, last]], axis=1) + cell + self._reach
            cv2.fillPoly(self._unknown, [corners.astype(np.int32)], 0)

    def _march(self, cells: Cells) -> tuple[Cells, Cells]:
        columns, rows, _ = _fan(self._reach)
        stride = self._blocked.shape[1]
        starts = (cells[:, 1] + self._reach) * stride + cells[:, 0] + self._reach
        return starts, march(self._blocked.reshape(-1), stride, starts, columns, rows)
