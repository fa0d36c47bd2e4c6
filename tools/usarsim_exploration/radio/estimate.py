"""What a robot expects of its radio by its own map, and how far a radio reaches around a place."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.kernels import expected, outlined
from usarsim_exploration.known_map import KnownMap
from usarsim_exploration.radio.models import Radio

UNKNOWN_PER_WALL = 14
"""Unknown cells on a line that a robot takes for one more wall (exploration 10.3)."""
DIRECTIONS = 128
"""Of an outline (exploration 14)."""
_FARTHEST = 1e5
"""Cells; no map is as wide."""
_ENDLESS = 10**9
"""Walls."""
Cells = NDArray[np.int64]
"""(n, 2) columns and rows."""


class RadioEstimate:
    """What a robot expects of its radio by its own map, rather less (exploration 10.3)."""

    def __init__(self, radio: Radio, known: KnownMap, reach: float, cell: float) -> None:
        """reach: range of the robot's radio, cells. cell: width of one, m."""
        self._known = known
        self._radio, reach = radio.expected(reach)
        self._ranges = _ranges(self._radio, reach, cell)

    @property
    def certain(self) -> bool:
        """Whether links are as it expects them, whatever stands where nobody has looked."""
        return not self._radio.counts_walls

    def reaches(
        self, cells: Cells, others: Cells, *, slack: float = 0.0, unknown: int | None = None
    ) -> NDArray[np.bool_]:
        """Whether links between cells and others are to be expected, (cells, others).

        Args:
            cells, others: (n, 2) columns and rows.
            slack: cells by which each pair may still move apart.
            unknown: with more unknown cells on a line, each of them may be a wall; fewer, and
                None: 14 of them are one.
        """
        return self._expected(cells, others, slack, unknown, enough=False)

    def held(self, cells: Cells, others: Cells, unknown: int | None = None) -> NDArray[np.bool_]:
        """Which cells have such a link to any of the others, (cells,); likely ones first."""
        found = self._expected(cells, others, 0.0, unknown, enough=True)
        return np.asarray(found.any(axis=1), np.bool_)

    def _expected(
        self, cells: Cells, others: Cells, slack: float, unknown: int | None, *, enough: bool
    ) -> NDArray[np.bool_]:
        return expected(
            self._known.bits, np.ascontiguousarray(cells), np.ascontiguousarray(others), slack,
            self._ranges, self._radio.wall_cells, UNKNOWN_PER_WALL,
            self._known.bits.size if unknown is None else unknown, enough,
        )  # fmt: skip


@lru_cache(maxsize=64)
def _ranges(radio: Radio, reach: float, cell: float) -> NDArray[np.float64]:
    """The farthest distances with a link through 0 walls, 1, 2 ..., cells.

    The last one holds for all that are more. Less than 0: there is none, not even in one cell.
    """
    if reach <= 0.0:  # the radio is silent, whatever the model
        return np.array([-1.0])
    most = _farthest(radio, reach, _ENDLESS, cell)
    found = [_farthest(radio, reach, 0, cell)]
    while radio.counts_walls and found[-1] > most:
        found.append(_farthest(radio, reach, len(found), cell))
    return np.array(found)


def _farthest(radio: Radio, reach: float, walls: int, cell: float) -> float:
    if not radio.hears(0.0, reach, walls, cell):
        return -1.0
    low, high = 0.0, _FARTHEST
    while (middle := (low + high) / 2) not in (low, high):
        if radio.hears(middle, reach, walls, cell):
            low = middle
        else:
            high = middle
    return low


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
    angles = 2 * np.pi * np.arange(directions) / directions
    ways = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    far = float(radio.reach(np.array([reach]), np.array([reach]))[0])
    ranges = _ranges(radio, far, environment.cell)
    return outlined(environment.walls, *cell, ways, ranges, radio.wall_cells)
