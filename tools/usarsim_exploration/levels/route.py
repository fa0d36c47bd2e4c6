"""The way that a robot of some width really drives: near a strategy's path, away from walls."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels.steps import FAR
from usarsim_exploration.kernels.ways import cheapest
from usarsim_exploration.known_map import FELT, KNOWN, SAFE, WALL
from usarsim_exploration.planning import Path

AHEAD = 60
"""Cells of the path that are looked at."""
MARGIN = 20
"""Cells around these."""
SNAP = 6
"""Cells from the end of the path within which a robot that gets no nearer has arrived."""
_COMFORT = 7.0
"""Cells to a wall beyond which more is no better."""
_LEAVE = 6
"""Cells around a robot that stands too near to a wall, within which it may drive out."""


def route(
    bits: NDArray[np.uint8],
    start: Cell,
    path: Sequence[Cell],
    width: float,
    seen: NDArray[np.int64],
    base: Cell,
) -> tuple[Path, bool]:
    """Cells to drive over, as far along a path as the robot fits.

    Args:
        bits: of its map. start: where it is. path: of its strategy, not empty.
        width: cells to the middle of a wall's cell that it needs at least.
        seen: (n, 2) further cells where something is. base: nobody takes that for a wall.

    Returns:
        The cells, without the start; and whether they lead to the end of the path, or as near as
        robots get. Empty: it is there, or no way leads on.
    """
    ahead = np.array([start, *path[:AHEAD]])
    rows, columns = bits.shape
    left, top = np.maximum(ahead.min(axis=0) - MARGIN, 0).tolist()
    right, bottom = np.minimum(ahead.max(axis=0) + MARGIN + 1, (columns, rows)).tolist()
    part = bits[top:bottom, left:right]
    on_path = np.zeros(part.shape, np.uint8)
    local = ahead - (left, top)
    on_path[local[:, 1], local[:, 0]] = 1
    beside = cv2.dilate(on_path, np.ones((5, 5), np.uint8)) != 0
    certain = part & (WALL | SAFE) == WALL | SAFE
    felt = part & FELT != 0
    solid = (certain & ~felt) | ((part & WALL != 0) & ~certain & ~beside)
    inside = seen - (left, top)
    fits = ((inside >= 0) & (inside < part.shape[::-1])).all(axis=1)
    solid[inside[fits, 1], inside[fits, 0]] = True
    away = cv2.distanceTransform((~np.pad(solid, 1)).astype(np.uint8), cv2.DIST_L2, 5)[1:-1, 1:-1]
    column, row = start[0] - left, start[1] - top
    prices = 4 + np.rint(12 * np.clip(_COMFORT - away, 0.0, None)).astype(np.int64)
    prices += 8 * (part & KNOWN == 0)
    prices += 200 * felt
    narrow = away < width
    near = np.zeros_like(narrow)
    near[max(row - _LEAVE, 0) : row + _LEAVE + 1, max(column - _LEAVE, 0) : column + _LEAVE + 1] = (
        True
    )
    prices[narrow & near] += 300
    prices[(narrow & ~near) | (solid & (away < 0.5))] = 0
    prices[row, column] = max(prices[row, column], 1)
    costs, came = cheapest(prices, column, row)
    target, ends = _target(costs, narrow, local[1:], whole=len(path) <= AHEAD)
    if target is None:
        return [], ends
    found = []
    flat, here = came.reshape(-1), target[1] * part.shape[1] + target[0]
    while flat[here] >= 0:
        found.append((here % part.shape[1] + left, here // part.shape[1] + top))
        here = int(flat[here])
    return found[::-1], ends


def _target(
    costs: NDArray[np.int64], narrow: NDArray[np.bool_], path: NDArray[np.int64], *, whole: bool
) -> tuple[Cell | None, bool]:
    """The farthest cell of the path that can be reached, or one near it; and whether at its end."""
    open_ = (costs < FAR) & ~narrow
    rows, columns = np.nonzero(open_)
    for index in range(len(path) - 1, -1, -1):
        column, row = path[index]
        if open_[row, column]:
            return (int(column), int(row)), whole and index == len(path) - 1
        if index in (len(path) - 1, 0) or index % SNAP == 0:
            away = (rows - row) ** 2 + (columns - column) ** 2
            if len(away) and away.min() <= SNAP**2:
                best = int(np.argmin(away))
                at_end = whole and index >= len(path) - 1
                return (int(columns[best]), int(rows[best])), at_end
    return None, False
