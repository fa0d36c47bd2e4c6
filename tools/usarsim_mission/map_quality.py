"""How good a map is: error of its walls after the best rigid alignment, and share of walls mapped.

The frame of a map may be shifted and turned, so the map is laid onto the true world where it fits
best. Candidates come from correlating its walls with the true ones (blurred, coarse) for every
turn, by Fourier transforms; the best few are refined by Gauss-Newton on the distance to the true
walls. Distances are to the nearest wall cell's side, so that a finer or coarser raster costs
nothing.

M = clamp((worthless - error) / (worthless - perfect)) x share (operator 7.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_mission.grid import FREE, WALL, Grid
from usarsim_mission.scoring import MapRule

Points = NDArray[np.float64]
Pose = tuple[float, float, float]
"""Shift x, y in m, after a turn by an angle in rad about the middle of the map's walls."""

COVERED = 0.2
"""m from a true wall to the next mapped one, up to which it counts as mapped; at least a cell."""
_COARSE = 0.25
"""m, cells of the first search."""
_TURNS = 120
_KEPT = 4
"""Candidates that are refined."""
_FAR = 3.0
"""m beside the true floor in which a misplaced map still has a slope towards it."""
_BESIDE = 1.0
"""m from reached floor within which a wall can be mapped."""
_RASTER = 16e6
"""Cells for the share of walls, at most."""
_MOST = 4000
"""Mapped walls that are looked at while searching."""


@dataclass(frozen=True, slots=True)
class MapQuality:
    """The verdict on a map.

    Attributes:
        error: mean distance of mapped walls to true ones, m; infinite for a map without walls.
        share: of the true walls that are mapped, 0..1.
        shift: m and rad by which the map had to be moved.
    """

    error: float
    share: float
    shift: Pose = (0.0, 0.0, 0.0)

    def points(self, rule: MapRule) -> float:
        """M, 0..1."""
        if not math.isfinite(self.error):
            return 0.0
        good = (rule.worthless - self.error) / (rule.worthless - rule.perfect)
        return min(max(good, 0.0), 1.0) * self.share


def judge(mapped: Grid, true: Grid) -> MapQuality:
    """Compare the walls of a map with the true ones.

    Args:
        mapped: as handed in, in whatever frame.
        true: the floor of the world.
    """
    walls, sides = _walls(mapped), _sides(true)
    if not len(walls) or not len(sides):
        return MapQuality(math.inf, 0.0)
    field = _Field(true)
    middle = walls.mean(0)
    some = walls[:: max(1, len(walls) // _MOST)] - middle
    still = (float(middle[0]), float(middle[1]), 0.0)
    found = [still, *_candidates(some, sides)]
    best = min((_refined(field, some, pose) for pose in found), key=lambda one: one[0])[1]
    placed = _placed(walls - middle, best)
    error = float(field.at(placed).mean())
    share = _share(placed, sides, max(COVERED, mapped.cell, true.cell))
    return MapQuality(error, share, (best[0] - still[0], best[1] - still[1], best[2]))


class _Field:
    """Distance to the nearest true wall, m, at any place: bilinear between cells."""

    def __init__(self, true: Grid) -> None:
        pad = math.ceil(_FAR / true.cell)
        free = np.pad((true.cells != WALL).astype(np.uint8), pad, constant_values=1)
        far = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        self._far = np.maximum(far.astype(np.float64) - 0.5, 0.0) * true.cell
        self._x, self._y = true.x - pad * true.cell, true.y - pad * true.cell
        self._cell = true.cell

    def at(self, places: Points) -> NDArray[np.float64]:
        """(n,) m for places (n, 2)."""
        return self.slope(places)[0]

    def slope(self, places: Points) -> tuple[NDArray[np.float64], Points]:
        """(n,) m and its gradient (n, 2); outside of the field the way to it is added."""
        rows, columns = self._far.shape
        limits = np.array((columns - 1.001, rows - 1.001))
        free = (places - (self._x, self._y)) / self._cell - 0.5
        held = np.clip(free, 0.0, limits)
        beyond = np.hypot(*(free - held).T) * self._cell
        cell = held.astype(np.int64)
        u, v = (held - cell).T
        column, row = cell.T
        a, b = self._far[row, column], self._far[row, column + 1]
        c, d = self._far[row + 1, column], self._far[row + 1, column + 1]
        value = (a * (1 - u) + b * u) * (1 - v) + (c * (1 - u) + d * u) * v
        gradient = np.stack(
            ((b - a) * (1 - v) + (d - c) * v, (c - a) * (1 - u) + (d - b) * u), axis=-1
        )
        return value + beyond, gradient / self._cell


def _candidates(walls: Points, sides: Points) -> list[Pose]:
    """Where walls (n, 2) about their middle fall best onto true sides (m, 2), roughly."""
    low: Points = sides.min(0)
    reach = float(np.hypot(*walls.T).max()) + _COARSE
    size = [
        cv2.getOptimalDFTSize(math.ceil((length + 2.0 * reach) / _COARSE) + 2)
        for length in (sides.max(0) - low)[::-1]
    ]
    true = cv2.GaussianBlur(_raster(sides - low + reach, size), (0, 0), 1.0)
    there = np.fft.rfft2(np.minimum(true, float(np.quantile(true[true > 0.0], 0.9))))
    found: list[tuple[float, Pose]] = []
    for turn in np.arange(_TURNS) * (math.tau / _TURNS):
        turned = _placed(walls, (reach, reach, float(turn)))
        fits = np.fft.irfft2(there * np.conj(np.fft.rfft2(_raster(turned, size))), size)
        row, column = np.unravel_index(int(fits.argmax()), fits.shape)
        shift = [
            (cells if (length - cells) * _COARSE > reach else cells - length) * _COARSE
            for cells, length in ((int(column), size[1]), (int(row), size[0]))
        ]
        pose = shift[0] + float(low[0]), shift[1] + float(low[1]), float(turn)
        found.append((-float(fits.max()), pose))
    return [pose for _, pose in sorted(found)[:_KEPT]]


def _raster(places: Points, size: list[int]) -> NDArray[np.float64]:
    """How many places (n, 2), m from the corner, fall into each coarse cell."""
    column, row = np.floor(places / _COARSE).astype(np.int64).T
    inside = (row >= 0) & (row < size[0]) & (column >= 0) & (column < size[1])
    flat = np.bincount(row[inside] * size[1] + column[inside], minlength=size[0] * size[1])
    return np.minimum(flat, 4).reshape(size[0], size[1]).astype(np.float64)


def _refined(field: _Field, walls: Points, pose: Pose) -> tuple[float, Pose]:
    """Mean distance and pose at the bottom of the slope from a pose."""
    best = float(field.at(_placed(walls, pose)).mean()), pose
    damping = 1e-3
    for _ in range(60):
        x, y, turn = best[1]
        value, slope = field.slope(_placed(walls, best[1]))
        about = _placed(walls, (0.0, 0.0, turn))
        lever = slope[:, 1] * about[:, 0] - slope[:, 0] * about[:, 1]
        jacobian = np.column_stack((slope, lever))
        # Far walls pull with the strength of near ones: it is their mean distance that counts.
        weight = 1.0 / np.maximum(value, 0.05)
        normal = (jacobian * weight[:, None]).T @ jacobian
        step = np.linalg.solve(
            normal + damping * (np.diag(np.diag(normal)) + 1e-9 * np.eye(3)),
            -(jacobian * weight[:, None]).T @ value,
        )
        moved = (x + float(step[0]), y + float(step[1]), turn + float(step[2]))
        mean = float(field.at(_placed(walls, moved)).mean())
        if mean < best[0] - 1e-9:
            best, damping = (mean, moved), max(damping / 4.0, 1e-6)
        else:
            damping *= 8.0
            if damping > 1e6:
                break
    return best


def _placed(places: Points, pose: Pose) -> Points:
    """Places (n, 2) turned about the origin and shifted."""
    x, y, turn = pose
    c, s = math.cos(turn), math.sin(turn)
    placed: Points = places @ np.array(((c, s), (-s, c))) + (x, y)
    return placed


def _share(placed: Points, sides: Points, near: float) -> float:
    """Share of true sides (m, 2) that have a mapped wall (n, 2) near them."""
    low: Points = np.minimum(placed.min(0), sides.min(0)) - near
    extent = np.maximum(placed.max(0), sides.max(0)) - low + near
    cell = max(near / 8.0, math.sqrt(float(extent.prod()) / _RASTER))
    size = np.ceil(extent / cell).astype(int) + 1
    free = np.ones((size[1], size[0]), np.uint8)
    column, row = np.floor((placed - low) / cell).astype(np.int64).T
    free[row, column] = 0
    far = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    column, row = np.floor((sides - low) / cell).astype(np.int64).T
    return float(np.mean(far[row, column] * cell <= near))


def _walls(grid: Grid) -> Points:
    """Middles (n, 2) of wall cells, m."""
    return _middles(grid, grid.cells == WALL)


def _sides(true: Grid) -> Points:
    """Middles (n, 2) of true wall cells that can be mapped: on the outside of a wall, and near
    floor that robots get to (their middles, which keep away from walls); m."""
    wall = true.cells == WALL
    inner = cv2.erode(wall.astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=1)
    unreached = (true.cells != FREE).astype(np.uint8)
    away = cv2.distanceTransform(unreached, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) * true.cell
    # Without a single cell that is reached, all distances are as large as can be.
    return _middles(true, wall & (inner == 0) & (away <= max(_BESIDE, 1.5 * true.cell)))


def _middles(grid: Grid, chosen: NDArray[np.bool_]) -> Points:
    row, column = np.nonzero(chosen)
    places = np.column_stack((column, row)).astype(np.float64) + 0.5
    found: Points = places * grid.cell + (grid.x, grid.y)
    return found
