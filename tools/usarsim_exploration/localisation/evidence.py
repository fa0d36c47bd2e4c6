"""Which walls of a map beams look through: a robot that errs draws walls where there are none.

An occupancy grid of whole numbers: a beam that goes on through a cell speaks for its being free,
one that ends there against it, and both only up to a limit, so that what was seen from a wrong
place is forgotten (A. Hornung et al., OctoMap, Autonomous Robots 34 (2013), clamping).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.steps import MARKS
from usarsim_exploration.known_map import FELT, FREE, SAFE, WALL, KnownMap
from usarsim_exploration.sensing import Scans

Ints = NDArray[np.int64]

_HIT, _SURE = 4, 5
"""A beam that ends counts as much as so many that go on, of which so many more make a cell free."""
_MOST, _CERTAIN = 12, 8
"""What beams that end in a cell can come to, and from when on it is a wall for certain."""


class Evidence:
    """What one robot's scans say of each cell."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Nothing yet. shape: rows and columns."""
        self._score = np.zeros(shape, np.int8)
        self._hit = np.zeros(shape, np.bool_)

    def correct(self, known: KnownMap, step: int, scans: Scans) -> None:
        """Judge walls of the map that has just taken in one scan.

        A wall of one beam is not certain: what others saw there counts as much. A wall that was
        measured and that beams go through is free. Walls that were felt stay.
        """
        ended, through = self._add(scans.cells[0], scans.ends[0, scans.hits[0]],
                                   scans.ends[0], scans.free_ends[0])  # fmt: skip
        bits, score = known.news(ended), self._score.reshape(-1)[ended]
        doubtful = ended[(bits & (WALL | SAFE | FELT) == WALL | SAFE) & (score > -_CERTAIN)]
        known.write(step, doubtful, known.news(doubtful) & np.uint8(MARKS) | np.uint8(WALL))
        bits = known.news(through)
        measured = (bits & SAFE != 0) | self._hit.reshape(-1)[through]
        free = through[(bits & (WALL | FELT) == WALL) & measured]
        known.write(step, free, known.news(free) & np.uint8(MARKS) | np.uint8(FREE))

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
        np.minimum(part, _SURE, out=part)
        part[hit] = np.maximum(part[hit] - _HIT, -_MOST)

        def flat(chosen: NDArray[np.bool_]) -> Ints:
            rows, columns = np.nonzero(chosen)
            return np.asarray((rows + top) * self._score.shape[1] + columns + left)

        return flat(hit), flat((through != 0) & (part == _SURE))
