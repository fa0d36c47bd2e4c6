"""Which walls of a map beams look through: a robot that errs draws walls where there are none.

An occupancy grid of whole numbers: a beam that goes on through a cell speaks for its being free,
one that ends there against it, and both only up to a limit, so that what was seen from a wrong
place is forgotten (A. Hornung et al., OctoMap, Autonomous Robots 34 (2013), clamping).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.sensing import Scans

_HIT, _SURE = 4, 5
"""A beam that ends counts as much as so many that go on, of which so many more are needed."""
_MOST = 12
"""That beams which end in a cell can speak against it."""


class Evidence:
    """What one robot's scans say of each cell."""

    def __init__(self, shape: tuple[int, int]) -> None:
        """Nothing yet. shape: rows and columns."""
        self._score = np.zeros(shape, np.int8)

    def add(self, scans: Scans) -> NDArray[np.int64]:
        """Take in scans from one place after another.

        Returns:
            Flat indices of cells that beams have gone through again just now, and often enough.
        """
        found = [self._add(*one) for one in zip(scans.cells, scans.ends, scans.free_ends,
                                                scans.hits, strict=True)]  # fmt: skip
        return np.unique(np.concatenate(found))

    def _add(
        self, cell: NDArray[np.int64], ends: NDArray[np.int64], free: NDArray[np.int64],
        hits: NDArray[np.bool_],
    ) -> NDArray[np.int64]:  # fmt: skip
        corners = np.vstack([ends, free, cell[None]])
        (left, top), (right, bottom) = corners.min(axis=0), corners.max(axis=0) + 1
        part = self._score[top:bottom, left:right]
        through = np.zeros(part.shape, np.uint8)
        cv2.fillPoly(through, [np.vstack([cell[None], free]).astype(np.int32) - (left, top)], 1)
        column, row = (ends[hits] - (left, top)).T
        through[row, column] = 0
        ended = np.zeros(part.shape, np.bool_)
        ended[row, column] = True
        part += through.view(np.int8)
        np.minimum(part, _SURE, out=part)
        part[ended] = np.maximum(part[ended] - _HIT, -_MOST)
        rows, columns = np.nonzero((through != 0) & (part == _SURE))
        return np.asarray((rows + top) * self._score.shape[1] + columns + left)
