"""What a robot expects of its radio by its own map, and how far a radio reaches around a place."""

from __future__ import annotations

from functools import lru_cache

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
_FARTHEST = 1e5
"""Cells; no map is as wide."""
_CHUNK = 16
"""Cells by which an outline grows at once."""

Pairs = NDArray[np.int64]


class RadioEstimate:
    """What a robot expects of its radio by its own map, rather less (reference 10.3)."""

    def __init__(self, radio: Radio, known: KnownMap, reach: float, cell: float) -> None:
        """reach: range of the robot's radio, cells. cell: width of one, m."""
        self._known, self._cell = known, cell
        self._radio, self._reach = radio.expected(reach)
        self._ranges = _Ranges(self._radio, self._reach, cell)
        self._values: tuple[int, NDArray[np.uint8]] = -1, np.empty((0, 0), np.uint8)

    @property
    def certain(self) -> bool:
        """Whether links are as it expects them, whatever stands where nobody has looked."""
        return not self._radio.counts_walls

    def reaches(
        self, pairs: Pairs, *, slack: float = 0.0, unknown: int | None = None
    ) -> NDArray[np.bool_]:
        """Whether links between pairs of cells, (n, 4), are to be expected.

        Args:
            pairs: columns and rows of one end, and of the other.
            slack: cells by which each pair may still move apart.
            unknown: with more unknown cells on a line, each of them may be a wall; fewer, and
                None: 14 of them are one.
        """
        away = np.hypot(*(pairs[:, :2] - pairs[:, 2:]).T) + slack
        walls = np.zeros(len(pairs), np.int64)
        if self._radio.counts_walls:
            found = crossings(self._shades(), np.ascontiguousarray(pairs, np.int64))
            seen, doubtful = found[:, 1 if self._radio.wall_cells else 2], found[:, 3]
            walls = seen + doubtful // UNKNOWN_PER_WALL
            if unknown is not None:
                walls = np.where(doubtful > unknown, seen + doubtful, walls)
        linked: NDArray[np.bool_] = away <= self._ranges.of(walls)
        return linked

    def _shades(self) -> NDArray[np.uint8]:
        """The map as `crossings` takes it."""
        if self._values[0] != self._known.version:
            bits = self._known.bits
            values = np.where(bits & WALL != 0, 2, bits & KNOWN == 0).astype(np.uint8)
            values[(bits & FREE != 0) & (bits & WALL == 0)] = 0
            self._values = self._known.version, values
        return self._values[1]


class _Ranges:
    """How far a radio reaches through so many walls, cells."""

    def __init__(self, radio: Radio, reach: float, cell: float) -> None:
        self._radio, self._reach, self._cell = radio, reach, cell
        self._found = np.empty(0)

    def of(self, walls: NDArray[np.int64]) -> NDArray[np.float64]:
        """The greatest distances with a link; less than 1: there is none."""
        more = range(len(self._found), int(walls.max(initial=-1)) + 1)
        if more:
            self._found = np.append(self._found, [self._farthest(count) for count in more])
        found: NDArray[np.float64] = self._found[walls]
        return found

    def _farthest(self, walls: int) -> float:
        low, high = 0.5, _FARTHEST
        while (middle := (low + high) / 2) not in (low, high):
            if self._radio.hears(middle, self._reach, walls, self._cell):
                low = middle
            else:
                high = middle
        return low


@lru_cache(maxsize=16)
def _ranges(radio: Radio, reach: float, cell: float) -> _Ranges:
    """Those of all robots with equal radios: outlines ask the same again and again."""
    return _Ranges(radio, reach, cell)


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
    ranges = _ranges(radio, far, environment.cell)
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
        heard[inside] = away <= ranges.of(walls)
        lost = ~heard
        count = np.where(lost.any(axis=1), lost.argmax(axis=1), _CHUNK)
        some = count > 0
        ends[open_[some]] = cells[some, count[some] - 1]
        open_ = open_[count == _CHUNK]
        start += _CHUNK
    return ends
