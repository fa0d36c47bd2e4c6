"""Ways over the true floor, as somebody knows them who has a plan of the building.

Nodes are cells of the reachable floor; an edge costs its length, more beside walls, so that ways
keep to the middle of corridors and doors.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from usarsim_mission.grid import FREE, Grid

SIDE = 0.2
"""m of a cell, about."""
NEAR = 6.0
"""m within which most goals are; ways beyond are looked for only where there is none."""
_KEPT = 2000
"""Starts whose ways are remembered."""
_BESIDE, _BESIDE_WALL = 2, 1.5
"""Cells beside a wall, and what way costs more for each that it is nearer."""
_STEPS = ((0, 1), (1, 0), (1, 1), (1, -1))

Place = tuple[float, float]
"""x, y in MuJoCo's frame, m."""
Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Ways:
    """From one node to all others.

    Attributes:
        far: cost by node, about m; infinite where there is no way, or none so near.
        before: the node before each, on the way to it.
    """

    far: Numbers
    before: NDArray[np.int32]

    def to(self, goal: int) -> list[int]:
        """Nodes to a goal, the start first."""
        found = [goal]
        while (last := int(self.before[found[-1]])) >= 0:
            found.append(last)
        return found[::-1]


class Floor:
    """The reachable floor of a world.

    Attributes:
        places: (n, 2) x, y of the nodes, m.
    """

    def __init__(self, grid: Grid) -> None:
        """Make nodes of cells that a robot can reach."""
        merge = max(1, round(SIDE / grid.cell))
        free = grid.cells[merge // 2 :: merge, merge // 2 :: merge] == FREE
        self._cell = merge * grid.cell
        self._corner = grid.x, grid.y
        self._number = np.full(free.shape, -1)
        rows, columns = np.nonzero(free)
        self._number[rows, columns] = np.arange(len(rows))
        offset = (merge // 2 + 0.5) * grid.cell
        x = grid.x + columns * self._cell + offset
        y = grid.y + rows * self._cell + offset
        self.places: Numbers = np.column_stack((x, y))
        self._graph = self._edges(free)
        self._known: OrderedDict[tuple[int, float], Ways] = OrderedDict()

    def _edges(self, free: NDArray[np.bool_]) -> csr_array:
        rows, columns = free.shape
        cost = np.ones(free.shape)
        for reach in range(1, _BESIDE + 1):
            cost[~_inner(free, reach)] += _BESIDE_WALL
        begins, ends, costs = [], [], []
        for down, right in _STEPS:
            here = slice(0, rows - down), slice(max(0, -right), columns - max(0, right))
            there = slice(down, rows), slice(max(0, right), columns + min(0, right))
            both = free[here] & free[there]
            if down and right:  # no way between two corners
                beside = slice(down, rows), slice(max(0, -right), columns - max(0, right))
                across = slice(0, rows - down), slice(max(0, right), columns + min(0, right))
                both &= free[beside] & free[across]
            length = self._cell * math.hypot(down, right)
            begins.append(self._number[here][both])
            ends.append(self._number[there][both])
            costs.append(length * (cost[here][both] + cost[there][both]) / 2.0)
        one, other, weights = map(np.concatenate, (begins, ends, costs))
        count = len(self.places)
        return csr_array((weights, (one, other)), shape=(count, count))

    def __len__(self) -> int:
        return len(self.places)

    def node(self, x: float, y: float) -> int:
        """The nearest node."""
        row = int((y - self._corner[1]) // self._cell)
        column = int((x - self._corner[0]) // self._cell)
        rows, columns = self._number.shape
        if 0 <= row < rows and 0 <= column < columns and self._number[row, column] >= 0:
            return int(self._number[row, column])
        away = (self.places[:, 0] - x) ** 2 + (self.places[:, 1] - y) ** 2
        return int(np.argmin(away))

    def ways(self, start: int, limit: float = math.inf) -> Ways:
        """Ways from a node.

        Args:
            start: the node.
            limit: cost beyond which nobody asks.
        """
        key = start, limit
        if key in self._known:
            self._known.move_to_end(key)
            return self._known[key]
        far, before = dijkstra(
            self._graph, directed=False, indices=start, return_predecessors=True, limit=limit
        )
        if len(self._known) >= _KEPT:
            self._known.popitem(last=False)
        found = self._known[key] = Ways(far, before)
        return found

    def within(self, places: list[Place], radius: float) -> NDArray[np.bool_]:
        """Nodes that are nearer than a radius (m) to one of some places, as the crow flies."""
        found = np.zeros(len(self), np.bool_)
        for x, y in places:
            found |= (self.places[:, 0] - x) ** 2 + (self.places[:, 1] - y) ** 2 < radius**2
        return found


def _inner(free: NDArray[np.bool_], reach: int) -> NDArray[np.bool_]:
    """Cells with nothing but free ones in the square around them."""
    padded, (rows, columns) = np.pad(free, reach), free.shape
    found = np.ones_like(free)
    for down in range(2 * reach + 1):
        for right in range(2 * reach + 1):
            found &= padded[down : down + rows, right : right + columns]
    return found
