"""A robot's planner, which knows only that robot's map.

Costs to all cells come from one flood from the robot, kept until the map or the robot changes, so
asking for ten distances costs as much as for one.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels import flood
from usarsim_exploration.kernels.steps import COLUMNS, DIAGONAL, FAR, ROWS, STRAIGHT
from usarsim_exploration.known_map import FREE, WALL, KnownMap
from usarsim_exploration.planning.search import LIMIT, Path, Search, jump_points
from usarsim_exploration.planning.topology import TopologicalMap

_PRICES = (STRAIGHT,) * 4 + (DIAGONAL,) * 4
UNIT = float(STRAIGHT)


class Field:
    """Costs of all cells from some starts, through known free space."""

    def __init__(self, passable: NDArray[np.uint8], starts: list[Cell], limit: int) -> None:
        """Flood. limit: expansions; when it is hit, `cut` is set and farther cells are out."""
        self._passable = passable
        self._starts = set(starts)
        self.costs, self.expanded = flood(passable, np.array(starts, np.int64), limit)
        self.cut = self.expanded >= limit

    def distance(self, cell: Cell) -> float:
        """Length of the way to a cell, cells; infinite if there is none."""
        cost = int(self.costs[cell[1], cell[0]])
        return cost / UNIT if cost != FAR else float("inf")

    def reaches(self, cell: Cell) -> bool:
        """Whether a way leads to a cell."""
        return bool(self.costs[cell[1], cell[0]] != FAR)

    def distances(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Lengths of the ways to cells, (n, 2); infinite where there is none."""
        costs = self.costs[cells[:, 1], cells[:, 0]]
        return np.where(costs != FAR, costs / UNIT, np.inf)

    def path(self, goal: Cell) -> Path | None:
        """From the nearest start to a cell, down the costs; None if there is none."""
        height, width = self.costs.shape
        column, row = goal
        cost = int(self.costs[row, column])
        if cost == FAR:
            return None
        found = []
        while cost:
            found.append((column, row))
            for move in range(8):
                c, r = column - int(COLUMNS[move]), row - int(ROWS[move])
                if not (0 <= c < width and 0 <= r < height):
                    continue
                if int(self.costs[r, c]) != cost - _PRICES[move]:
                    continue
                if move >= 4 and not (self._open(c, row) and self._open(column, r)):
                    continue
                column, row, cost = c, r, int(self.costs[r, c])
                break
            else:  # a flood that was cut
                return None
        return found[::-1]

    def _open(self, column: int, row: int) -> bool:
        return bool(self._passable[row, column]) or (column, row) in self._starts


class Planner:
    """Plans for one robot.

    Attributes:
        cuts: how many searches and floods have hit the limit.
    """

    REBUILD, STALE, NEWS = 15, 150, 100
    """Steps before which a topological map is not made anew, after which it is in any case, and
    newly known free cells that are needed between (exploration reference 2)."""

    def __init__(self, known: KnownMap, limit: int = LIMIT) -> None:
        """limit: cells that one flood or search expands at most."""
        self._known, self._limit = known, limit
        self._fields: dict[tuple[Cell, ...], tuple[int, Field]] = {}
        self._passable: tuple[int, NDArray[np.uint8]] | None = None
        self._topology: tuple[int, int, TopologicalMap] | None = None
        self.cuts = 0

    @property
    def passable(self) -> NDArray[np.uint8]:
        """(rows, columns) 1 where free space is known; read only."""
        version = self._known.version
        if self._passable is None or self._passable[0] != version:
            free = (self._known.bits & (FREE | WALL) == FREE).astype(np.uint8)
            self._passable = version, free
        return self._passable[1]

    def field(self, *cells: Cell) -> Field:
        """Costs from a cell, or the nearest of some, through the known free space of now."""
        version = self._known.version
        kept = self._fields.get(cells)
        if kept is not None and kept[0] == version:
            return kept[1]
        found = Field(self.passable, list(cells), self._limit)
        self.cuts += found.cut
        self._fields = {key: one for key, one in self._fields.items() if one[0] == version} | {
            cells: (version, found)
        }
        return found

    def path(self, start: Cell, goal: Cell) -> Path | None:
        """The shortest way through known free space, or None."""
        return self.field(start).path(goal)

    def search(self, start: Cell, goal: Cell) -> Search:
        """As `path`, but by jump points: cheaper from a start that nothing else is asked of."""
        found = jump_points(self.passable, start, goal, self._limit)
        self.cuts += found.cut
        return found

    def topology(self, step: int) -> TopologicalMap:
        """The topological map of now, or of some steps ago if little is new."""
        kept = self._topology
        if kept is not None:
            age, news = step - kept[0], self._known.free - kept[1]
            if age < self.REBUILD or (age < self.STALE and news <= self.NEWS):
                return kept[2]
        walls = self._known.bits & WALL != 0
        made = TopologicalMap.build(self.passable, walls)
        self._topology = step, self._known.free, made
        return made


def length(start: Cell, path: Path) -> float:
    """Length of a path of neighbours from a cell, cells."""
    cells = np.array([start, *path])
    return float(np.hypot(*np.diff(cells, axis=0).T).sum())
