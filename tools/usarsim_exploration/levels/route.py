"""The way that a robot of some width really drives: near a strategy's path, away from walls."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels.searching import cheapest
from usarsim_exploration.kernels.steps import FAR
from usarsim_exploration.known_map import FELT, KNOWN, SAFE, WALL
from usarsim_exploration.planning import Path

AHEAD = 60
"""Cells of 0.1 m, as all lengths here, of the path that are looked at."""
MARGIN = 20
"""Cells around these."""
SNAP = 8
"""Cells from a path within which a robot that gets no nearer may stay: another one fits between."""
_COMFORT = 7.0
"""Cells to a wall beyond which more is no better."""
_OPEN = 1e6
"""Cells to a wall where there is none."""
_TURNS = 1.2
"""Cells more than a robot needs at least with which it turns on the spot and touches nothing."""
_TIGHT = 40
"""Price of a cell with less."""
_ROOMY = 4
"""Cells from the end of a path within which it rather ends where it can turn."""
_AROUND = 5
"""Cells around the end of a way within which a robot looks at what is unknown."""
_LEAVE = 6
"""Cells around a robot that stands too near to a wall, within which it may drive out."""


def route(
    bits: NDArray[np.uint8],
    start: Cell,
    path: Sequence[Cell],
    width: float,
    seen: NDArray[np.int64],
    snap: float = SNAP,
    scale: float = 1.0,
) -> tuple[Path, bool]:
    """Cells to drive over, as far along a path as the robot fits.

    Args:
        bits: of its map. start: where it is. path: of its strategy, not empty.
        width: cells to the middle of a wall's cell that it needs at least.
        seen: (n, 2) further cells where something is.
        snap: cells of 0.1 m from the end within which a robot that gets no nearer has arrived.
        scale: cells that are as long as 0.1 m.

    Returns:
        The cells, without the start; and whether they lead to the end of the path, or as near as
        robots get. Empty: it is there, or no way leads on.
    """
    far, margin, leave = (max(1, round(one * scale)) for one in (AHEAD, MARGIN, _LEAVE))
    ahead = np.array([start, *path[:far]])
    rows, columns = bits.shape
    left, top = np.maximum(ahead.min(axis=0) - margin, 0).tolist()
    right, bottom = np.minimum(ahead.max(axis=0) + margin + 1, (columns, rows)).tolist()
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
    prices = 4 + np.rint(
        12 * np.clip(_COMFORT - np.minimum(away, _OPEN) / scale, 0.0, None)
    ).astype(np.int64)
    prices += 8 * (part & KNOWN == 0)
    prices += 200 * felt
    narrow, tight = away < width, away < width + _TURNS * scale
    prices += _TIGHT * tight
    near = np.zeros_like(narrow)
    near[max(row - leave, 0) : row + leave + 1, max(column - leave, 0) : column + leave + 1] = True
    prices[narrow & near] += 300
    prices[(narrow & ~near) | (solid & (away < 0.5))] = 0
    prices[row, column] = max(prices[row, column], 1)
    costs, came = cheapest(prices, column, row)
    tight = narrow if math.dist(start, path[-1]) <= _ROOMY * scale else tight
    near_end = snap * scale if len(path) <= far else 0.0
    target, ends = _target(costs, narrow, tight, local[1:], near_end, scale)
    if target is None:
        return [], False
    found = []
    flat, here = came.reshape(-1), target[1] * part.shape[1] + target[0]
    while flat[here] >= 0:
        found.append((here % part.shape[1] + left, here // part.shape[1] + top))
        here = int(flat[here])
    return found[::-1], ends


def gathering(robots: int) -> int:
    """Cells of 0.1 m from the base to where a robot is home: all of a team stand there."""
    return round(10.0 + 1.5 * robots)


def unknown_at(bits: NDArray[np.uint8], cell: Cell, scale: float, otherwise: float) -> float:
    """Where most is unknown around the end of a way, rad: a robot looks there when it arrives.

    Args:
        bits: of its map. cell: the end. scale: cells that are as long as 0.1 m.
        otherwise: rad, if all is known there.
    """
    reach = max(1, round(_AROUND * scale))
    left, top = max(cell[0] - reach, 0), max(cell[1] - reach, 0)
    around = bits[top : cell[1] + reach + 1, left : cell[0] + reach + 1]
    rows, columns = np.nonzero(around & KNOWN == 0)
    if not len(rows):
        return otherwise
    return math.atan2(rows.mean() + top - cell[1], columns.mean() + left - cell[0])


def rest_of(path: Path, here: Cell) -> Path:
    """What is left of a path for a robot that may be beside it: from the nearest cell on."""
    nearest = min(range(min(len(path), 40)), key=lambda n: (math.dist(path[n], here), -n))
    return path[nearest + (path[nearest] == here) :]


def _target(
    costs: NDArray[np.int64],
    narrow: NDArray[np.bool_],
    tight: NDArray[np.bool_],
    path: NDArray[np.int64],
    snap: float,
    scale: float,
) -> tuple[Cell | None, bool]:
    """The farthest cell of a path that can be reached, or one near it; and whether at its end.

    Args:
        snap: cells, see `route`; 0: the path goes on after these. scale: see there.
    """
    open_ = (costs < FAR) & ~narrow
    rows, columns = np.nonzero(open_)
    if not len(rows):
        return None, False
    last, every = len(path) - 1, max(1, round(SNAP * scale))
    if snap:
        open_at = np.argwhere((costs < FAR) & ~tight)
        away = ((open_at[:, ::-1] - path[last]) ** 2).sum(axis=1)
        if len(away) and away.min() <= (_ROOMY * scale) ** 2:
            row, column = open_at[np.argmin(away)].tolist()
            return (column, row), True
    for index in range(last, -1, -1):
        column, row = path[index].tolist()
        if open_[row, column]:
            return (column, row), bool(snap) and index == last
        if index in (last, 0) or index % every == 0:
            away = (rows - row) ** 2 + (columns - column) ** 2
            best = int(np.argmin(away))
            reach = snap if index == last and snap else SNAP * scale
            if away[best] <= reach**2:
                return (int(columns[best]), int(rows[best])), bool(snap) and index == last
    return None, False
