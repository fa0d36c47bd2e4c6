"""The true world of a run: which cells are walls. Strategies never see it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_maps.grids.inside import inside

Cell = tuple[int, int]
"""Column and row from the top left."""


@dataclass(frozen=True, eq=False)
class Environment:
    """One world.

    Attributes:
        name: of its file or generator.
        walls: (rows, columns) 1 where a wall is, else 0.
        cell: width of a cell, m.
        doubtful: (rows, columns) free cells that may lie outside of the building; None: none.
    """

    name: str
    walls: NDArray[np.uint8]
    cell: float = 0.1
    doubtful: NDArray[np.bool_] | None = None

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.walls.shape[0], self.walls.shape[1]

    @cached_property
    def free(self) -> int:
        """How many cells are no wall."""
        return int(self.walls.size - np.count_nonzero(self.walls))

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """Free cells where a base and robots may be put: inside, if there is an inside."""
        free = self.walls == 0
        return inside(free if self.doubtful is None else free & ~self.doubtful)

    def is_free(self, cell: Cell) -> bool:
        """Whether a cell is inside and no wall."""
        rows, columns = self.shape
        column, row = cell
        return 0 <= column < columns and 0 <= row < rows and not self.walls[row, column]

    def may_move(self, start: Cell, goal: Cell) -> bool:
        """Whether a robot can drive to a neighbour; a diagonal needs both cells beside it."""
        (column, row), (right, below), walls = start, goal, self.walls
        if max(abs(right - column), abs(below - row)) != 1:
            return False
        rows, columns = walls.shape
        if not (0 <= right < columns and 0 <= below < rows) or walls[below, right]:
            return False
        return not (walls[row, right] or walls[below, column])

    def reachable(self, cell: Cell) -> NDArray[np.bool_]:
        """Where a robot can drive from a free cell, the same shape as `walls`.

        A diagonal move needs both cells beside it, so a robot gets as far by straight ones.
        """
        _, labels = cv2.connectedComponents((self.walls == 0).astype(np.uint8), connectivity=4)
        found: NDArray[np.bool_] = (labels == labels[cell[1], cell[0]]) & (self.walls == 0)
        return found
