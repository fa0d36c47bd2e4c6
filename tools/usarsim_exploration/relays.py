"""Where relays have to stand so that a team gets to a frontier and keeps its link to the base.

The search is over a lattice of known free cells. From an anchor, a robot can go to all cells that
have a link to it and that it gets to over such cells; any of these may be the next anchor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.planning import Field, Path
from usarsim_exploration.strategy import View
from usarsim_exploration.tether import UNKNOWN, held, leading

PITCH = 3
"""Cells between two of the lattice: the narrowest gap that is found for certain."""
COARSE = 7
"""So many lattice cells wide is what one place for a relay stands for."""
LOOK = 12
"""Cells of the way to a frontier that need not be held, since it sees over them."""
_TRIES = 4
"""Ways that are looked for over cells that may be held, until one is."""
MOST = 64
"""Places that are judged for each relay, those near goals first."""
_AROUND = np.ones((5, 5), np.uint8)
"""Cells of the lattice from which a goal is seen."""

Mask = NDArray[np.bool_]
"""(n,) of the cells of a lattice."""


class Lattice:
    """Known free cells, one in nine, and between which of them a straight way leads.

    Where most are in passages narrower than `PITCH`, it is all of them.

    Attributes:
        cells: (n, 2). pitch: cells between two of them.
    """

    def __init__(self, view: View) -> None:
        """Of the map of now."""
        self._view = view
        free = view.planner.passable != 0
        self.pitch = pitch = 1 if view.rules.narrow and _is_narrow(view) else PITCH
        nodes = free[::pitch, ::pitch]
        rows, columns = nodes.shape
        self._grid = np.full(nodes.shape, -1)
        where = np.argwhere(nodes)
        self._grid[where[:, 0], where[:, 1]] = np.arange(len(where))
        self.cells: NDArray[np.int64] = where[:, ::-1] * pitch
        self._where = where
        # nodes at even places of a picture, and between them what joins two
        self._joined = np.zeros((2 * rows, 2 * columns), np.bool_)
        self._joined[::2, ::2] = nodes
        across, down, between = free[::pitch], free[:, ::pitch], range(pitch)
        right = np.logical_and.reduce([across[:, k::pitch][:, : columns - 1] for k in between])
        below = np.logical_and.reduce([down[k::pitch][: rows - 1] for k in between])
        self._joined[::2, 1:-1:2] = right & nodes[:, 1:]
        self._joined[1:-1:2, ::2] = below & nodes[1:]

    def linked(
        self, places: NDArray[np.int64], slack: float, cells: NDArray[np.int64] | None = None
    ) -> NDArray[np.bool_]:
        """Which cells, its own or (n, 2), have a link to places that counts, (places, n)."""
        cells = self.cells if cells is None else cells
        return self._view.radio.reaches(cells, places, slack=slack, unknown=UNKNOWN).T

    def around(self, cell: Cell, mask: Mask) -> Mask:
        """Those of a mask that a robot gets to from a cell, over no others."""
        start = self._near(cell, mask)
        if start < 0:
            return np.zeros_like(mask)
        rows, columns = self._where.T
        picture = np.zeros(self._joined.shape, np.uint8)
        picture[2 * rows[mask], 2 * columns[mask]] = 1
        picture[:, 1:-1:2] = picture[:, :-2:2] & picture[:, 2::2]
        picture[1:-1:2] = picture[:-2:2] & picture[2::2]
        picture &= self._joined
        labels = cv2.connectedComponents(picture, connectivity=4)[1][2 * rows, 2 * columns]
        found: Mask = mask & (labels == labels[start])
        return found

    def _near(self, cell: Cell, mask: Mask) -> int:
        """The nearest of a mask, of those around a cell; -1: there is none."""
        row, column = round(cell[1] / self.pitch), round(cell[0] / self.pitch)
        around = self._grid[max(row - 1, 0) : row + 2, max(column - 1, 0) : column + 2]
        found = around[around >= 0]
        found = found[mask[found]]
        if not len(found):
            return -1
        away = ((self.cells[found] - cell) ** 2).sum(axis=1)
        return int(found[away.argmin()])

    def places(self, mask: Mask) -> NDArray[np.int64]:
        """One of a mask for each coarse cell of the lattice, near the middle of that."""
        found = np.flatnonzero(mask)
        rows, columns = self._where[found].T
        blocks = rows // COARSE * self._grid.shape[1] + columns // COARSE
        off = np.abs(rows % COARSE - COARSE // 2) + np.abs(columns % COARSE - COARSE // 2)
        order = np.lexsort((found, off, blocks))
        firsts = np.r_[True, np.diff(blocks[order]) != 0] if len(order) else order
        kept: NDArray[np.int64] = found[order[firsts]]
        return kept

    def wide(self, mask: Mask) -> NDArray[np.uint8]:
        """(rows, columns) of the lattice, 1 around cells of a mask."""
        picture = np.zeros(self._grid.shape, np.uint8)
        picture[self._where[mask, 0], self._where[mask, 1]] = 1
        return np.asarray(cv2.dilate(picture, _AROUND), np.uint8)

    def beside(self, goals: Sequence[Cell]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Cells of it from which goals are seen, (n, 2), and which of them, (n, goals), 0 or 1."""
        off = np.abs(self.cells[:, None] - np.array(goals)).max(axis=2)
        near = off <= self.pitch * (len(_AROUND) // 2) + self.pitch // 2
        some = near.any(axis=1)
        return self.cells[some], near[some].astype(np.int64)

    def covers(self, mask: Mask, goals: Sequence[Cell]) -> NDArray[np.bool_]:
        """Which goals lie beside a cell of a mask, (goals,)."""
        wide = self.wide(mask)
        there = np.round(np.array(goals) / self.pitch).astype(np.int64)
        there = np.minimum(there, np.array(wide.shape[::-1]) - 1)
        found: NDArray[np.bool_] = wide[there[:, 1], there[:, 0]] != 0
        return found


def _is_narrow(view: View) -> bool:
    """Whether most of what is known is in passages narrower than `PITCH`."""
    free, square = view.planner.passable, np.ones((PITCH, PITCH), np.uint8)
    wide = cv2.morphologyEx(free, cv2.MORPH_OPEN, square)
    return 2 * int(np.count_nonzero(wide)) < view.known.free


def within(view: View, anchors: Sequence[Cell]) -> NDArray[np.uint8]:
    """(rows, columns) 1 where a robot can drive and has a link to any of some anchors, or nearly.

    Judged by a lattice, so whoever drives there has to ask for each cell of its way.
    """
    lattice = Lattice(view)
    links = held(view, lattice.cells, anchors)
    pitch = lattice.pitch
    wide = np.repeat(np.repeat(lattice.wide(links), pitch, axis=0), pitch, axis=1)
    rows, columns = view.planner.passable.shape
    shifted = np.pad(wide, pitch // 2, mode="edge")[pitch - 1 :, pitch - 1 :]  # nodes in the middle
    found: NDArray[np.uint8] = view.planner.passable & shifted[:rows, :columns]
    return found


def ways_within(
    view: View,
    goals: Sequence[Cell],
    anchors: Sequence[Cell],
    nearly: NDArray[np.uint8] | None = None,
) -> dict[Cell, Path]:
    """Ways over held cells to goals, or to where these are seen from.

    Args:
        view: of a robot for whom the shortest ways are barred. goals: where to.
        anchors: who holds the link. nearly: `within`, if known.
    """
    mask, found = (within(view, anchors) if nearly is None else nearly.copy()), dict[Cell, Path]()
    for _ in range(_TRIES):
        field = Field(mask, [view.cell], mask.size)
        ways = {goal: field.path(goal) for goal in goals}
        for goal, path in ways.items():
            if path:
                good = held(view, path, anchors)
                if good[: max(len(path) - LOOK, 0)].all() and good[0]:
                    found[goal] = leading(path, good)
                for column, row in np.array(path)[~good]:
                    mask[row, column] = 0
        if found or not any(ways.values()):
            break
    return found


@dataclass(frozen=True, slots=True, eq=False)
class _Place:
    """A chain of relays. cell: of the last one. chain: all. reach: where robots get to then."""

    chain: tuple[Cell, ...]
    reach: Mask


def chain(
    view: View, anchors: Sequence[Cell], goals: Sequence[Cell], worth: Sequence[float], most: int,
    slack: float = 0.0,
) -> list[Cell] | None:  # fmt: skip
    """Where relays have to stand, the first one first, so that goals come within reach.

    With the fewest relays; of equal chains that from whose end goals of most worth are heard, and
    then that which is nearest to one.

    Args:
        view: of a robot. anchors: base and relays that stand; the base first. goals: not in reach
            as it is. worth: of each. most: relays. slack: see `RadioEstimate.reaches`.

    Returns:
        None: no goal comes within reach.
    """
    lattice = Lattice(view)
    if not goals or not len(lattice.cells):
        return None
    start = np.asarray(lattice.linked(np.array(anchors), slack).any(axis=0), np.bool_)
    reach = np.zeros_like(start)
    for cell in anchors:
        reach |= lattice.around(cell, start)
    ends, value = np.array(goals, np.int64), np.array(worth)
    beside, whose = lattice.beside(goals)
    level, seen = [_Place((), reach)], np.zeros_like(start)
    for depth in range(most):
        places: list[tuple[float, float, Cell, _Place]] = []
        for before in level:
            cells = lattice.cells[lattice.places(before.reach & ~seen)]
            seen |= before.reach
            if len(cells):
                heard = lattice.linked(cells, slack, beside) @ whose
                near = np.hypot(*(cells[:, None] - ends[None]).transpose(2, 0, 1)).min(axis=1)
                gains = ((heard > 0) @ value).tolist()
                rows = zip(gains, near.tolist(), cells.tolist(), strict=True)
                places += [(-gain, away, (c, r), before) for gain, away, (c, r) in rows]
        places = sorted(places, key=lambda one: one[:3])[:MOST]
        level = []
        for minus, _, cell, before in places:
            if minus == 0.0 and depth + 1 == most:
                break
            mask, new = before.reach.copy(), np.flatnonzero(~before.reach)
            links = lattice.linked(np.array([cell]), slack, lattice.cells[new])
            mask[new[links[0]]] = True
            level.append(_Place((*before.chain, cell), lattice.around(cell, mask)))
            if minus and lattice.covers(level[-1].reach, goals).any():
                return list(level[-1].chain)
    return None
