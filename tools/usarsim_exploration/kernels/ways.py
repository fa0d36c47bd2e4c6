"""Cheapest ways over cells that cost differently; the same Python compiled or not."""

from __future__ import annotations

import heapq

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.searching import _compiled
from usarsim_exploration.kernels.steps import COLUMNS, FAR, ROWS

_CELL_BITS = 24
_CELL_MASK = (1 << _CELL_BITS) - 1
_STRAIGHT, _DIAGONAL = 70, 99
"""Of a move, times the price of the cell that it leads to."""


@_compiled
def cheapest(
    prices: NDArray[np.int64], column: int, row: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Costs of all cells from one, over eight neighbours that cut no corner (Dijkstra 1959).

    Args:
        prices: (rows, columns) of entering a cell, from 1 up; 0: it cannot be entered.

    Returns:
        Costs, `FAR` where no way leads; and for each cell the flat index of the one before, or -1.
    """
    rows, columns = prices.shape
    flat = prices.copy().reshape(-1)
    costs = np.full(rows * columns, FAR, np.int64)
    came = np.full(rows * columns, -1, np.int64)
    first = row * columns + column
    costs[first] = 0
    heap = [first]
    while len(heap) > 0:
        key = heapq.heappop(heap)
        cell = key & _CELL_MASK
        cost = key >> _CELL_BITS
        if cost > costs[cell]:
            continue
        at_column, at_row = cell % columns, cell // columns
        for move in range(8):
            to_column, to_row = at_column + COLUMNS[move], at_row + ROWS[move]
            if to_column < 0 or to_row < 0 or to_column >= columns or to_row >= rows:
                continue
            other = to_row * columns + to_column
            if flat[other] == 0:
                continue
            length = _STRAIGHT
            if move >= 4:
                if (
                    flat[at_row * columns + to_column] == 0
                    or flat[to_row * columns + at_column] == 0
                ):
                    continue
                length = _DIAGONAL
            total = cost + length * flat[other]
            if total < costs[other]:
                costs[other] = total
                came[other] = cell
                heapq.heappush(heap, (total << _CELL_BITS) + other)
    return costs.reshape(rows, columns), came.reshape(rows, columns)
