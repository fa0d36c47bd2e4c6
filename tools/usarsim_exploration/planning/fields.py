"""A robot's planner, which knows only that robot's map.

Costs to all cells come from one flood from the robot, kept until the map or the robot changes, so
asking for ten distances costs as much as for one. Robots of a team share floods (`Floods`).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels import flood
from usarsim_exploration.kernels.searching import descend
from usarsim_exploration.kernels.steps import EVERYWHERE, FAR, SHIFT, STRAIGHT
from usarsim_exploration.known_map import FREE, WALL, KnownMap
from usarsim_exploration.planning.search import LIMIT, Path, Search, jump_points
from usarsim_exploration.planning.topology import TopologicalMap

UNIT = float(STRAIGHT)
_ROOM = 32 * 2**20
"""Bytes of costs that are kept."""


class Floods:
    """Costs from single cells through the map that was asked for last, for robots with equal maps.

    Robots that are in contact know the same, so when all of them plan in a step, each floods from
    the same places through the same space. The first one does it, the others take that over; a
    robot whose map differs by a cell makes its own.
    """

    def __init__(self) -> None:
        """None are known."""
        self._passable: NDArray[np.uint8] | None = None
        self._kept: dict[Cell, tuple[NDArray[np.int32], int]] = {}

    def costs(
        self, passable: NDArray[np.uint8], start: Cell, limit: int, targets: NDArray[np.int64]
    ) -> tuple[NDArray[np.int32], bool]:
        """Costs as `flood` finds them, those of the targets for certain; and whether it was cut.

        Args:
            passable, limit, targets: as `flood` has them. start: one cell.
        """
        if limit <= passable.size:  # it may be cut, which depends on the targets
            costs, expanded = flood(passable, np.array([start]), limit, targets)
            return costs, expanded >= limit
        kept = self._of(passable).get(start)
        if kept is not None and kept[1] >= _farthest(kept[0], targets):
            return kept[0], False
        costs, _ = flood(passable, np.array([start]), limit, targets)
        self._kept.pop(start, None)
        self._kept[start] = costs, _farthest(costs, targets)
        if len(self._kept) * costs.nbytes > _ROOM:
            del self._kept[next(iter(self._kept))]
        return costs, False

    def _of(self, passable: NDArray[np.uint8]) -> dict[Cell, tuple[NDArray[np.int32], int]]:
        """Costs and the last bucket that is final, by start, of a map."""
        if self._passable is not passable:
            if self._passable is None or not np.array_equal(self._passable, passable):
                self._kept = {}
            self._passable = passable
        return self._kept


def _farthest(costs: NDArray[np.int32], targets: NDArray[np.int64]) -> int:
    """The bucket of a flood that has to be final for targets; the last of all without any."""
    if not len(targets):
        return FAR >> SHIFT
    return int(costs[targets[:, 1], targets[:, 0]].max()) >> SHIFT


class Field:
    """Costs of all cells from some starts, through known free space."""

    def __init__(
        self,
        passable: NDArray[np.uint8],
        starts: Sequence[Cell],
        limit: int,
        floods: Floods | None = None,
    ) -> None:
        """Flood.

        Args:
            limit: expansions; when it is hit, `cut` is set and farther cells are out.
            floods: that may be known already.
        """
        self._passable = passable
        if floods is not None and len(starts) == 1:
            self.costs, self.cut = floods.costs(passable, starts[0], limit, EVERYWHERE)
        else:
            self.costs, expanded = flood(passable, np.array(starts, np.int64), limit, EVERYWHERE)
            self.cut = expanded >= limit

    def distance(self, cell: Cell) -> float:
        """Length of the way to a cell, cells; infinite if there is none."""
        cost = int(self.costs[cell[1], cell[0]])
        return cost / UNIT if cost != FAR else float("inf")

    def reaches(self, cell: Cell) -> bool:
        """Whether a way leads to a cell."""
        return bool(self.costs[cell[1], cell[0]] != FAR)

    def distances(self, cells: NDArray[np.int64]) -> NDArray[np.float64]:
        """Lengths of the ways to cells, (n, 2); infinite where there is none."""
        return _lengths(self.costs, cells)

    def path(self, goal: Cell) -> Path | None:
        """From the nearest start to a cell, down the costs; None if there is none."""
        column, row = goal
        if self.costs[row, column] in (0, FAR):
            return None if self.costs[row, column] else []
        found = descend(self.costs, self._passable, column, row)[::-1].tolist()
        return [(c, r) for c, r in found] or None  # none: the flood was cut


class Planner:
    """Plans for one robot.

    Attributes:
        cuts: how many searches and floods have hit the limit.
    """

    REBUILD, STALE, NEWS = 15, 150, 100
    """Steps before which a topological map is not made anew, after which it is in any case, and
    newly known free cells that are needed between (exploration reference 2)."""

    def __init__(self, known: KnownMap, limit: int = LIMIT, floods: Floods | None = None) -> None:
        """Args: limit, cells that one flood or search expands at most; floods, of the team."""
        self._known, self._limit = known, limit
        self._floods = Floods() if floods is None else floods
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
        found = Field(self.passable, cells, self._limit, self._floods)
        self.cuts += found.cut
        self._fields = {key: one for key, one in self._fields.items() if one[0] == version} | {
            cells: (version, found)
        }
        return found

    def forget(self) -> None:
        """Keep nothing of a map that has changed since: a field takes as much as five maps."""
        version = self._known.version
        if self._passable is not None and self._passable[0] != version:
            self._passable = None
            self._fields = {key: one for key, one in self._fields.items() if one[0] == version}

    def distances(
        self, start: Cell, goals: NDArray[np.int64], end: int | None = None
    ) -> NDArray[np.float64]:
        """As `field(start).distances(goals)`, for a start that little else is asked of.

        The flood ends when it has reached all goals, (n, 2), and nothing is kept of it. end: index
        of one at which it ends already; of those that are as far, only that distance is told.
        """
        kept = self._fields.get((start,))
        if kept is not None and kept[0] == self._known.version:
            found = kept[1].distances(goals)
        else:
            targets = goals if end is None else goals[end : end + 1]
            costs, cut = self._floods.costs(self.passable, start, self._limit, targets)
            self.cuts += cut
            found = _lengths(costs, goals)
        return found if end is None else np.minimum(found, found[end])

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


def _lengths(costs: NDArray[np.int32], cells: NDArray[np.int64]) -> NDArray[np.float64]:
    """Of the ways to cells, (n, 2), by the costs of a flood; infinite where there is none."""
    there = costs[cells[:, 1], cells[:, 0]]
    return np.where(there != FAR, there / UNIT, np.inf)


def length(start: Cell, path: Path) -> float:
    """Length of a path of neighbours from a cell, cells."""
    cells = np.array([start, *path])
    return float(np.hypot(*np.diff(cells, axis=0).T).sum())
