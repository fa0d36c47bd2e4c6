"""What a robot expects of its radio by its own map, and how far a radio reaches around a place."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.kernels import crossings
from usarsim_exploration.known_map import FREE, KNOWN, WALL, KnownMap
from usarsim_exploration.radio.models import Radio

UNKNOWN_PER_WALL = 14
"""Unknown cells on a line that a robot takes for one more wall (reference 10.3)."""
DIRECTIONS = 128
"""Of an outline (reference 14)."""
_CHUNK = 16
"""Cells by which an outline grows at once."""

Pairs = NDArray[np.int64]


class RadioEstimate:
    """What a robot expects of its radio by its own map, rather less (reference 10.3)."""

    def __init__(self, radio: Radio, known: KnownMap, reach: float, cell: float) -> None:
        """reach: range of the robot's radio, cells. cell: width of one, m."""
        self._known, self._cell = known, cell
        self._radio, self._reach = radio.expected(reach)

    def reaches(
        self, pairs: Pairs, *, slack: float = 0.0, unknown: int | None = None
    ) -> NDArray[np.bool_]:
        """Whether links between pairs of cells, (n, 4), are to be expected.

        Args:
            pairs: columns and rows of one end, and of the other.
            slack: cells by which each pair may still move apart.
            unknown: most unknown cells on a line, if it matters what stands there.
        """
        away = np.hypot(*(pairs[:, :2] - pairs[:, 2:]).T) + slack
        walls, clear = np.zeros(len(pairs), np.int64), np.ones(len(pairs), np.bool_)
        if self._radio.counts_walls:
            bits = self._known.bits
            values = np.where(bits & WALL != 0, 2, bits & KNOWN == 0).astype(np.uint8)
            values[(bits & FREE != 0) & (bits & WALL == 0)] = 0
            found = crossings(values, np.ascontiguousarray(pairs, np.int64))
            walls = found[:, 2] + found[:, 3] // UNKNOWN_PER_WALL
            if unknown is not None:
                clear = found[:, 3] <= unknown
        reach = np.full(len(pairs), self._reach)
        return self._radio.linked(away, reach, walls, self._cell) & clear


def outline(
    radio: Radio,
    environment: Environment,
    cell: Cell,
    reach: float,
    directions: int = DIRECTIONS,
) -> NDArray[np.int64]:
    """How far a radio reaches around a cell, against one with the same range.

    Each direction is followed cell by cell until the first one without a link, as links of a team
    are found; or to the edge of the world.

    Returns:
        (directions, 2) the last cells with a link, clockwise from the right.
    """
    rows, columns = environment.shape
    angles = 2 * np.pi * np.arange(directions) / directions
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = np.tile(np.array(cell, np.int64), (directions, 1))
    open_ = np.arange(directions)
    values, start = environment.walls * np.uint8(2), 1
    far = float(radio.reach(np.array([reach]), np.array([reach]))[0])

    @cache
    def farthest(walls: int) -> float:
        """The greatest distance with a link, cells; less than 1: there is none."""
        low, high = 0.5, float(np.hypot(rows, columns))
        while (middle := (low + high) / 2) not in (low, high):
            if radio.hears(middle, far, walls, environment.cell):
                low = middle
            else:
                high = middle
        return low

    while len(open_):
        along = np.arange(start, start + _CHUNK)
        cells = np.floor(np.array(cell) + ways[open_, None] * along[:, None] + 0.5).astype(np.int64)
        inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=2)
        heard = np.zeros(inside.shape, np.bool_)
        pairs = np.concatenate([np.broadcast_to(cell, (inside.sum(), 2)), cells[inside]], axis=1)
        away = np.hypot(*(pairs[:, :2] - pairs[:, 2:]).T)
        walls = np.zeros(len(pairs), np.int64)
        if radio.counts_walls:
            walls = crossings(values, np.ascontiguousarray(pairs))[:, int(radio.wall_cells)]
        kinds = range(int(walls.max(initial=0)) + 1)
        heard[inside] = away <= np.array([farthest(count) for count in kinds])[walls]
        lost = ~heard
        count = np.where(lost.any(axis=1), lost.argmax(axis=1), _CHUNK)
        some = count > 0
        ends[open_[some]] = cells[some, count[some] - 1]
        open_ = open_[count == _CHUNK]
        start += _CHUNK
    return ends
