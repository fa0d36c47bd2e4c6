"""A topological map: free space parted into areas around nodes of its skeleton.

One flood from all nodes at once gives everything: a cell belongs to the node from where it was
reached, areas that touch are neighbours, and where they touch tells the length of the way from
node to node. Ways over many areas are searched in that small graph, and then only through the areas
found (exploration reference 9; kept pieces of ways, as MRESim has them, would make ways longer, and
go on through walls that were found since).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.errors import scipy
from usarsim_exploration.kernels import flood
from usarsim_exploration.kernels.steps import COLUMNS, DIAGONAL, EVERYWHERE, FAR, ROWS, STRAIGHT
from usarsim_exploration.planning.search import LIMIT, Search, a_star, jump_points
from usarsim_exploration.planning.skeleton import key_cells, skeleton

NOWHERE = -1
"""Area of a cell that belongs to no node."""


@dataclass(frozen=True, slots=True, eq=False)
class TopologicalMap:
    """Areas, and which ones are neighbours.

    Attributes:
        bones: (rows, columns) the skeleton, 1 and 0.
        nodes: (n, 2) column and row of each.
        areas: (rows, columns) number of the node that each cell belongs to, or `NOWHERE`.
        edges: (m, 2) neighbours, the smaller number first, sorted.
        lengths: (m,) of the ways between their nodes, cells.
        doors: (m, 2, 2) the two cells, one of each area, over which that way leads.
    """

    bones: NDArray[np.uint8]
    nodes: NDArray[np.int64]
    areas: NDArray[np.int32]
    edges: NDArray[np.int64]
    lengths: NDArray[np.float64]
    doors: NDArray[np.int64]

    @classmethod
    def build(cls, free: NDArray[np.uint8], walls: NDArray[np.bool_]) -> TopologicalMap:
        """Of known free space.

        Args:
            free: (rows, columns) 1 where a robot can drive, else 0. walls: what its nodes keep
                away from.
        """
        bones = skeleton(free)
        nodes = key_cells(bones, walls)
        if not len(nodes):
            none = np.full(free.shape, NOWHERE, np.int32)
            empty = np.empty((0, 2), np.int64)
            return cls(bones, nodes, none, empty, np.empty(0), np.empty((0, 2, 2), np.int64))
        costs, _ = flood(free, nodes, free.size, EVERYWHERE)
        areas = _areas(costs, free, nodes)
        return cls(bones, nodes, areas, *_edges(costs, areas))

    def path(self, free: NDArray[np.uint8], start: Cell, goal: Cell, limit: int = LIMIT) -> Search:
        """A way through the areas of the shortest chain from start to goal, and those beside it.

        It is at most somewhat longer than the shortest one. Whoever is in the same or a
        neighbouring area, or in none, gets that one.

        Args:
            free: as now; may have changed since the map was made.
            start, goal: columns and rows. limit: of a search, expansions.
        """
        chain = self._chain(start, goal)
        if len(chain) < 3:
            return jump_points(free, start, goal, limit)
        within = np.zeros(len(self.nodes) + 1, np.uint8)  # the last one is NOWHERE
        within[chain] = 1
        within[self.edges[(within[self.edges] != 0).any(axis=1)]] = 1
        found = jump_points(free & within[self.areas], start, goal, limit)
        return found if found.path is not None else a_star(free, start, goal, limit)

    def _chain(self, start: Cell, goal: Cell) -> list[int]:
        """Areas from that of the start to that of the goal; empty if there is no such chain."""
        first, last = (int(self.areas[row, column]) for column, row in (start, goal))
        if NOWHERE in (first, last):
            return []
        count = len(self.nodes)
        graph = scipy("sparse").csr_array((self.lengths, self.edges.T), shape=(count, count))
        _, before = scipy("sparse.csgraph").dijkstra(
            graph, directed=False, indices=last, return_predecessors=True
        )
        chain = [first]
        while chain[-1] != last:
            chain.append(int(before[chain[-1]]))
            if chain[-1] < 0:
                return []
        return chain


def _areas(
    costs: NDArray[np.int32], free: NDArray[np.uint8], nodes: NDArray[np.int64]
) -> NDArray[np.int32]:
    """Which node each cell was reached from: up the costs, in leaps that double."""
    rows, columns = costs.shape
    padded, open_ = np.pad(costs, 1, constant_values=FAR), np.pad(free, 1)
    indices = np.arange(costs.size).reshape(costs.shape)
    before = indices.copy()
    for move in reversed(range(8)):
        right, down = -int(COLUMNS[move]), -int(ROWS[move])
        price = STRAIGHT if move < 4 else DIAGONAL

        def beside(
            of: NDArray[np.int32] | NDArray[np.uint8], c: int, r: int
        ) -> NDArray[np.int32] | NDArray[np.uint8]:
            return of[1 + r : 1 + r + rows, 1 + c : 1 + c + columns]

        from_here = (costs != FAR) & (beside(padded, right, down) == costs - price)
        if move >= 4:
            from_here &= (beside(open_, right, 0) != 0) & (beside(open_, 0, down) != 0)
        before[from_here] = indices[from_here] + down * columns + right
    flat = before.reshape(-1)
    while True:
        further = flat[flat]
        if (further == flat).all():
            break
        flat = further
    numbers = np.full(costs.size, NOWHERE, np.int32)
    numbers[nodes[:, 1] * columns + nodes[:, 0]] = np.arange(len(nodes))
    found: NDArray[np.int32] = np.where(costs.reshape(-1) != FAR, numbers[flat], NOWHERE)
    return found.astype(np.int32).reshape(costs.shape)


def _edges(
    costs: NDArray[np.int32], areas: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.int64]]:
    """Neighbouring areas, the least cost from node to node, and where that way passes over."""
    columns = costs.shape[1]
    indices = np.arange(costs.size).reshape(costs.shape)
    pairs = []
    for one, other in (
        ((slice(None), slice(None, -1)), (slice(None), slice(1, None))),
        ((slice(None, -1), slice(None)), (slice(1, None), slice(None))),
    ):
        touch = (areas[one] != areas[other]) & (areas[one] >= 0) & (areas[other] >= 0)
        pairs.append(np.stack([indices[one][touch], indices[other][touch]], axis=1))
    cells = np.concatenate(pairs)
    flat, prices = areas.reshape(-1), costs.reshape(-1).astype(np.int64)
    swapped = flat[cells[:, 0]] > flat[cells[:, 1]]
    cells[swapped] = cells[swapped][:, ::-1]
    ends = flat[cells].astype(np.int64)
    whole = prices[cells].sum(axis=1) + STRAIGHT
    order = np.lexsort((whole, ends[:, 1], ends[:, 0]))
    cells, ends, whole = cells[order], ends[order], whole[order]
    first = np.ones(len(ends), np.bool_)
    first[1:] = (ends[1:] != ends[:-1]).any(axis=1)
    down, right = np.divmod(cells[first], columns)
    return ends[first], whole[first] / STRAIGHT, np.stack([right, down], axis=2)
