"""How far a map is from the true walls, once it is turned and shifted as well as it can be.

Where robots find out themselves where they are, a map may be right in itself and yet lie askew; so
its error is told after the best rigid alignment, as is usual for maps (B. Balaguer, S. Balakirsky,
S. Carpin, A. Visser, Evaluating maps produced by urban search and rescue robots, Autonomous Robots
27 (2009) 449-464).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.known_map import FREE, SAFE, WALL

Floats = NDArray[np.float64]
Distances = Callable[[Floats], Floats]
Motion = tuple[float, float, float]
_STEPS = 8.0, 4.0, 2.0, 1.0, 0.5, 0.25
"""Cells by which the map is shifted, and by which a turn moves its corners."""
_POINTS = 2000
"""About so many cells are aligned, spread over all."""
_GAIN = 1e-6
"""Cells; less is no improvement."""
_AROUND = np.ones((3, 3), np.uint8)


@dataclass(frozen=True, slots=True)
class MapError:
    """What is wrong with a map.

    Attributes:
        error: mean distance of its wall cells to the nearest surface of a true wall, m; None: it
            has no wall.
        mapped: part of the wall cells beside reachable space that it has, within one cell.
        overlap: cells rightly free, by cells that are free and reachable or that it takes for free.
        shift, turn: of the whole map, m at its middle and rad.
    """

    error: float | None
    mapped: float
    overlap: float
    shift: float = 0.0
    turn: float = 0.0


def map_error(bits: NDArray[np.uint8], world: Environment, base: Cell) -> MapError:
    """Compare a map with the truth.

    Args:
        bits: of a `KnownMap`; walls count that were measured. world: true. base: a reachable cell.
    """
    reachable = world.reachable(base)
    beside = cv2.dilate(reachable.astype(np.uint8), _AROUND) != 0
    surface = beside & (world.walls != 0)
    free = (bits & FREE != 0).astype(np.uint8)
    rows, columns = np.nonzero(bits & (WALL | SAFE) == WALL | SAFE)
    walls = np.stack([columns, rows], axis=1).astype(float)
    if not len(walls) or not surface.any():
        return MapError(None, 0.0, _overlap(free, reachable))
    middle = walls.mean(axis=0)
    away = _distances(surface, middle)
    motion = _align(walls - middle, away)
    placed = _moved(walls - middle, motion)
    error = float(away(placed).mean())
    return MapError(
        error * world.cell,
        _mapped(placed + middle, surface),
        _overlap(_warped(free, middle, motion), reachable),
        math.hypot(motion[0], motion[1]) * world.cell,
        motion[2],
    )


def _moved(points: Floats, motion: Motion) -> Floats:
    """Points turned about the origin, then shifted."""
    cosine, sine = math.cos(motion[2]), math.sin(motion[2])
    found: Floats = points @ np.array([[cosine, sine], [-sine, cosine]]) + motion[:2]
    return found


def _align(points: Floats, away: Distances) -> Motion:
    """The shift, cells, and turn, rad, with which points are nearest to walls.

    By steps along and about all axes, from wide to narrow ones; from where they are.
    """
    some = points[:: max(1, len(points) // _POINTS)]
    extent = float(np.hypot(*some.T).max()) + 1.0
    best: Motion = (0.0, 0.0, 0.0)
    least = away(some).mean()
    for step in _STEPS:
        moved = True
        while moved:
            tried = [
                (best[0] + step * x, best[1] + step * y, best[2] + step / extent * turn)
                for x, y, turn in itertools.product((-1, 0, 1), repeat=3)
            ]
            means = away(np.stack([_moved(some, one) for one in tried])).mean(axis=1)
            place = int(np.argmin(means))
            moved = bool(means[place] < least - _GAIN)
            if moved:
                best, least = tried[place], means[place]
    return best


def _inside(points: Floats, shape: tuple[int, ...]) -> NDArray[np.int64]:
    """(2, ...) columns and rows of the cells of points; the nearest ones for what is outside."""
    cells = np.floor(points + 0.5).astype(np.int64)
    return np.moveaxis(np.clip(cells, 0, [shape[1] - 1, shape[0] - 1]), -1, 0)


def _distances(surface: NDArray[np.bool_], middle: Floats) -> Distances:
    """Tells how far cells of points, seen from a middle, are from the nearest wall, cells."""
    field = cv2.distanceTransform((~surface).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)

    def away(points: Floats) -> Floats:
        placed = points + middle
        column, row = _inside(placed, surface.shape)
        beyond = np.hypot(placed[..., 0] - column, placed[..., 1] - row)
        found: Floats = field[row, column] + np.where(beyond > 1.0, beyond, 0.0)
        return found

    return away


def _mapped(points: Floats, surface: NDArray[np.bool_]) -> float:
    """Part of the walls with a point within one cell."""
    column, row = _inside(points, surface.shape)
    near = np.zeros(surface.shape, np.uint8)
    near[row, column] = 1
    found = cv2.dilate(near, _AROUND) != 0
    return int(np.count_nonzero(found & surface)) / int(np.count_nonzero(surface))


def _warped(free: NDArray[np.uint8], middle: Floats, motion: Motion) -> NDArray[np.uint8]:
    """A picture moved as the points of the map were."""
    cosine, sine = math.cos(motion[2]), math.sin(motion[2])
    turn = np.array([[cosine, -sine], [sine, cosine]])
    shift = middle + motion[:2] - turn @ middle
    matrix = np.column_stack([turn, shift])
    found = cv2.warpAffine(free, matrix, free.shape[::-1], flags=cv2.INTER_NEAREST)
    return np.asarray(found, np.uint8)


def _overlap(free: NDArray[np.uint8], reachable: NDArray[np.bool_]) -> float:
    either = int(np.count_nonzero((free != 0) | reachable))
    return int(np.count_nonzero((free != 0) & reachable)) / either if either else 0.0
