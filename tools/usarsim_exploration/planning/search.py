"""One way from a cell to another: A* and jump points, both limited by expansions.

Both find a shortest way. A* is there for space of any kind; jump points expand far fewer cells in
open space and are the faster ones there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels import searching
from usarsim_exploration.kernels.steps import FAR, STRAIGHT

LIMIT = 2_000_000
"""Cells that a search expands at most."""
Path = list[Cell]
"""Cells after the first one, neighbours, the goal last."""

_Kernel = Callable[
    [NDArray[np.uint8], int, int, int, int],
    tuple[NDArray[np.int32], NDArray[np.int32], int],
]


@dataclass(frozen=True, slots=True)
class Search:
    """What a search found.

    Attributes:
        path: None: no way was found.
        length: of it, cells; infinite without one.
        expanded: how many cells were looked at.
        cut: the limit was hit before the goal, so a way may exist nevertheless.
    """

    path: Path | None
    length: float
    expanded: int
    cut: bool


def a_star(passable: NDArray[np.uint8], start: Cell, goal: Cell, limit: int = LIMIT) -> Search:
    """Over all neighbours.

    Args:
        passable: (rows, columns) not 0: may be entered; the start may in any case.
        start, goal: columns and rows.
        limit: how many cells are expanded at most.
    """
    return _search(searching.a_star, passable, start, goal, limit)


def jump_points(passable: NDArray[np.uint8], start: Cell, goal: Cell, limit: int = LIMIT) -> Search:
    """Over cells where a way may turn; see `a_star`."""
    return _search(searching.jump_points, passable, start, goal, limit)


def _search(
    kernel: _Kernel, passable: NDArray[np.uint8], start: Cell, goal: Cell, limit: int
) -> Search:
    padded = np.pad(passable, 1)
    stride = padded.shape[1]
    free = padded.reshape(-1)
    first, last = (cell[0] + 1 + (cell[1] + 1) * stride for cell in (start, goal))
    free[first] = 1
    costs, came, expanded = kernel(free, stride, first, last, limit)
    if costs[last] == FAR:
        return Search(None, float("inf"), expanded, expanded >= limit)
    path: Path = []
    cell = last
    while cell != first:
        before = int(came[cell])
        row, column = divmod(cell, stride)
        above, beside = divmod(before, stride)
        steps = max(abs(column - beside), abs(row - above))
        right, down = (column - beside) // steps, (row - above) // steps
        path.extend((column - 1 - n * right, row - 1 - n * down) for n in range(steps))
        cell = before
    # a goal that was reached when the limit was hit need not have been reached on the best way
    return Search(path[::-1], int(costs[last]) / STRAIGHT, expanded, expanded >= limit)
