"""Searches for ways: the same Python for both forms, compiled where numba is installed.

Cells are flat indices; those of a way to one goal into a padded grid. Keys of the heap are costs
and cells in one number, so that equal costs come in the order of cells, and both forms expand the
same cells.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.steps import COLUMNS, DIAGONAL, FAR, ROWS, STRAIGHT

F = TypeVar("F", bound=Callable[..., Any])
_CELL_BITS = 24
"""Of a key: room for maps of 16 million cells."""
_CELL_MASK = (1 << _CELL_BITS) - 1
_LEVEL, _SLANTED = 70, 99
"""What a move of `cheapest` costs, times the price of the cell that it leads to."""


def _compiled(function: F) -> F:
    if os.environ.get("USARSIM_EXPLORATION_PLAIN"):
        return function
    try:
        import numba
    except ImportError:
        return function
    made: Any = numba.njit(cache=True, nogil=True)(function)
    return cast(F, made)


@_compiled
def _least(cell: int, goal: int, stride: int) -> int:
    """What a way to the goal costs at least."""
    right, down = abs(cell % stride - goal % stride), abs(cell // stride - goal // stride)
    return STRAIGHT * max(right, down) + (DIAGONAL - STRAIGHT) * min(right, down)


@_compiled
def a_star(
    free: NDArray[np.uint8], stride: int, start: int, goal: int, limit: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """The cheapest way over eight neighbours that cuts no corner (Hart, Nilsson, Raphael 1968).

    Args:
        free: flat, with a margin of 0; not 0: may be entered. stride: of its rows.
        limit: how many cells are expanded at most.

    Returns:
        Costs (`FAR`: not reached), from where each cell was reached, and how many were expanded.
    """
    costs = np.full(len(free), FAR, np.int32)
    came = np.full(len(free), -1, np.int32)
    done = np.zeros(len(free), np.uint8)
    costs[start] = 0
    heap = [(_least(start, goal, stride) << _CELL_BITS) + start]
    expanded = 0
    while len(heap) > 0 and expanded < limit:
        cell = int(heapq.heappop(heap)) & _CELL_MASK
        if done[cell]:
            continue
        if cell == goal:
            break
        done[cell] = 1
        expanded += 1
        cost = int(costs[cell])
        for down in range(-1, 2):
            for right in range(-1, 2):
                there = cell + down * stride + right
                if free[there] == 0 or done[there]:
                    continue
                price = STRAIGHT
                if down != 0 and right != 0:
                    if free[cell + right] == 0 or free[cell + down * stride] == 0:
                        continue
                    price = DIAGONAL
                if cost + price < costs[there]:
                    costs[there], came[there] = cost + price, cell
                    least = cost + price + _least(there, goal, stride)
                    heapq.heappush(heap, (least << _CELL_BITS) + there)
    return costs, came, expanded


@_compiled
def _leap(free: NDArray[np.uint8], cell: int, along: int, aside: int, goal: int) -> int:
    """Straight on until the goal, or a cell beside which space opens; -1: a wall came before.

    Args:
        along, aside: what a move ahead adds to a cell, and one to the side.
    """
    while True:
        cell += along
        if free[cell] == 0:
            return -1
        if cell == goal:
            return cell
        if free[cell + aside] != 0 and free[cell + aside - along] == 0:
            return cell
        if free[cell - aside] != 0 and free[cell - aside - along] == 0:
            return cell


@_compiled
def _jump(free: NDArray[np.uint8], stride: int, cell: int, right: int, down: int, goal: int) -> int:
    """The next cell in a direction at which a way may turn; -1: none."""
    if right == 0:
        return _leap(free, cell, down * stride, 1, goal)
    if down == 0:
        return _leap(free, cell, right, stride, goal)
    while True:
        if free[cell + right] == 0 or free[cell + down * stride] == 0:
            return -1
        cell += right + down * stride
        if free[cell] == 0:
            return -1
        if cell == goal:
            return cell
        if _leap(free, cell, right, stride, goal) >= 0:
            return cell
        if _leap(free, cell, down * stride, 1, goal) >= 0:
            return cell


@_compiled
def jump_points(
    free: NDArray[np.uint8], stride: int, start: int, goal: int, limit: int
) -> tuple[NDArray[np.int32], NDArray[np.int32], int]:
    """`a_star`, which looks only at cells where a way may turn; ways are as short.

    Harabor and Grastien, "Online graph pruning for pathfinding on grid maps" (AAAI 2011), in the
    form without cut corners: straight moves turn where a wall beside them has just ended.
    """
    costs = np.full(len(free), FAR, np.int32)
    came = np.full(len(free), -1, np.int32)
    done = np.zeros(len(free), np.uint8)
    costs[start] = 0
    heap = [(_least(start, goal, stride) << _CELL_BITS) + start]
    expanded = 0
    while len(heap) > 0 and expanded < limit:
        cell = int(heapq.heappop(heap)) & _CELL_MASK
        if done[cell]:
            continue
        if cell == goal:
            break
        done[cell] = 1
        expanded += 1
        ahead = below = 0  # the direction from which the cell was reached
        if came[cell] >= 0:
            ahead = cell % stride - came[cell] % stride
            below = cell // stride - came[cell] // stride
            ahead, below = min(max(ahead, -1), 1), min(max(below, -1), 1)
        for down in range(-1, 2):
            for right in range(-1, 2):
                if right == 0 and down == 0:
                    continue
                if ahead != 0 and below != 0:  # a diagonal goes on, or splits into its two parts
                    if right == -ahead or down == -below:
                        continue
                elif right * ahead + down * below < 0:  # a straight move never turns back
                    continue
                there = _jump(free, stride, cell, right, down, goal)
                if there < 0 or done[there]:
                    continue
                offered = int(costs[cell]) + _least(cell, there, stride)
                if offered < costs[there]:
                    costs[there], came[there] = offered, cell
                    least = offered + _least(there, goal, stride)
                    heapq.heappush(heap, (least << _CELL_BITS) + there)
    return costs, came, expanded


@_compiled
def descend(
    costs: NDArray[np.int32], passable: NDArray[np.uint8], column: int, row: int
) -> NDArray[np.int64]:
    """The way down the costs of a flood to where they are 0, by the first move that leads there.

    Args:
        costs: of `flood`. passable: what it went through.
        column, row: cell to begin with; it has been reached.

    Returns:
        (n, 2) cells, the one to begin with first, without the one where it ends; none if the way
        breaks off, as that of a flood that was cut may do.
    """
    height, width = costs.shape
    found = np.empty((costs[row, column] // STRAIGHT + 1, 2), np.int64)
    count, cost = 0, int(costs[row, column])
    while cost > 0:
        found[count, 0], found[count, 1] = column, row
        count += 1
        move = 0
        while move < 8:
            c, r = column - COLUMNS[move], row - ROWS[move]
            price = STRAIGHT if move < 4 else DIAGONAL
            if 0 <= c < width and 0 <= r < height and costs[r, c] == cost - price:
                beside = passable[row, c] != 0 or costs[row, c] == 0
                if move < 4 or (beside and (passable[r, column] != 0 or costs[r, column] == 0)):
                    break
            move += 1
        if move == 8:
            return found[:0]
        column, row = c, r
        cost = int(costs[row, column])
    return found[:count]


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
            length = _LEVEL
            if move >= 4:
                if (
                    flat[at_row * columns + to_column] == 0
                    or flat[to_row * columns + at_column] == 0
                ):
                    continue
                length = _SLANTED
            total = cost + length * flat[other]
            if total < costs[other]:
                costs[other] = total
                came[other] = cell
                heapq.heappush(heap, (total << _CELL_BITS) + other)
    return costs.reshape(rows, columns), came.reshape(rows, columns)
