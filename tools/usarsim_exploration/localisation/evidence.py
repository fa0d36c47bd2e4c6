"""Which walls of a map beams look through: a robot that errs draws walls where there are none.

An occupancy grid of whole numbers: a beam that goes on through a cell speaks for its being free,
one that ends there against it, and both only up to a limit, so that what was seen from a wrong
place is forgotten (A. Hornung et al., OctoMap, Autonomous Robots 34 (2013), clamping).
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.steps import MARKS
from usarsim_exploration.known_map import FELT, FREE, SAFE, WALL, KnownMap
from usarsim_exploration.sensing import Scans

Ints = NDArray[np.int64]

_HIT, _SURE = 4, 5
"""A beam that ends counts as much as so many that go on, of which so many more make a cell free."""
_MOST, _CERTAIN = 3, 2
"""Beams that end in a cell, to which these can come, and from when on it is a wall for certain."""
_CLEAR = 15
"""So many more beams that go on make a cell free for certain, where it is known how readings err:
then others learn of it who hold it for a wall."""


class Evidence:
    """What one robot's scans say of each cell."""

    def __init__(self, shape: tuple[int, int], deviation: float | None = None) -> None:
        """Nothing yet.

        Args:
            shape: rows and columns.
            deviation: of readings that err by chance alone, cells; None: poses err, too.
        """
        self._hits = _HIT if deviation is None else _weight(deviation)
        self._top = _SURE if deviation is None else _CLEAR
        self._score = np.zeros(shape, np.int8)
        self._hit = np.zeros(shape, np.bool_)

    def correct(self, known: KnownMap, step: int, scans: Scans, number: int = 0) -> None:
        """Judge walls of the map that has just taken in a scan, of the number of some.

        A wall of one beam is not certain: what others saw there counts as much. A wall that was
        measured and that beams go through is free. Walls that were felt stay.
        """
        ends = scans.ends[number]
        ended, through = self._add(scans.cells[number], ends[scans.hits[number]],
                                   ends, scans.free_ends[number])  # fmt: skip
        bits, score = known.news(ended), self._score.reshape(-1)[ended]
        sure = score <= -_CERTAIN * self._hits
        doubtful = ended[(bits & (WALL | SAFE | FELT) == WALL | SAFE) & ~sure]
        known.write(step, doubtful, known.news(doubtful) & np.uint8(MARKS) | np.uint8(WALL))
        bits = known.news(through)
        measured = (bits & SAFE != 0) | self._hit.reshape(-1)[through]
        free = through[(bits & (WALL | FELT) == WALL) & measured]
        clear = self._score.reshape(-1)[free] == _CLEAR
        shape = np.where(clear, FREE | SAFE, FREE).astype(np.uint8)
        known.write(step, free, known.news(free) & np.uint8(MARKS) | shape)

    def _add(self, cell: Ints, ended: Ints, ends: Ints, free: Ints) -> tuple[Ints, Ints]:
        """Flat indices of cells where beams end, and of those that many go through."""
        corners = np.vstack([ends, free, cell[None]])
        (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0) + 1
        part = self._score[top:bottom, left:right]
        through = np.zeros(part.shape, np.uint8)
        cv2.fillPoly(through, [np.vstack([cell[None], free]).astype(np.int32) - (left, top)], 1)
        hit = np.zeros(part.shape, np.bool_)
        hit[ended[:, 1] - top, ended[:, 0] - left] = True
        through[hit] = 0
        self._hit[top:bottom, left:right] |= hit
        part += through.view(np.int8)
        np.minimum(part, self._top, out=part)
        part[hit] = np.maximum(part[hit] - self._hits, -_MOST * self._hits)

        def flat(chosen: NDArray[np.bool_]) -> Ints:
            rows, columns = np.nonzero(chosen)
            return np.asarray((rows + top) * self._score.shape[1] + columns + left)

        return flat(hit), flat((through != 0) & (part >= _SURE))


def _weight(deviation: float) -> int:
    """For how many beams that go on one counts that ends, so that walls and cells before differ.

    The geometric mean of what a wall and the cell before it show: beams that go on there, by those
    that end there. Where readings err by more than 2 cells both look alike, and 4 has to do.
    """
    beyond = [0.5 * math.erfc((n - 0.5) / (deviation * math.sqrt(2.0))) for n in range(-1, 2)]
    before, wall = (beyond[n + 1] / max(beyond[n] - beyond[n + 1], 1e-9) for n in range(2))
    return min(max(round(math.sqrt(before * wall)), 1), 4)
