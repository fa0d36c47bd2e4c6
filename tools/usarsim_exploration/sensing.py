"""The range finder: rays through the true world, 181 of them over 180 degrees as a rule.

Cell m of a ray is the scanner's own plus m cosine and m sine, both cut towards zero; a reading is
the distance between whole cells (exploration reference 6.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.kernels import sense

NEAR = 0.1
"""Part of the range within which what is seen is certain."""
_OUTSIDE = 2
"""Of a cell beyond the edge of the world."""
_MARGIN = 2.0
"""A reading this much shorter than the range is that of a wall, cells."""


@dataclass(frozen=True, slots=True, eq=False)
class Scans:
    """Scans of one robot in one step.

    Attributes:
        cells: (scans, 2) where the scanner was.
        readings: (scans, rays) cells.
        ends: (scans, rays, 2) cells where rays end; the wall's, where one was hit.
        free_ends: (scans, rays, 2) the last free cells.
        near_ends: (scans, rays, 2) the last free cells at most `NEAR` of the range away.
        hits: (scans, rays) whether a wall was hit.
        directions: (scans, 2, rays) cosines and sines.
    """

    cells: NDArray[np.int64]
    readings: NDArray[np.float64]
    ends: NDArray[np.int64]
    free_ends: NDArray[np.int64]
    near_ends: NDArray[np.int64]
    hits: NDArray[np.bool_]
    directions: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Fan:
    """The rays of a heading: cells (rays, range) relative to the scanner, and their distances."""

    columns: NDArray[np.int64]
    rows: NDArray[np.int64]
    lengths: NDArray[np.float64]
    directions: NDArray[np.float64]


@lru_cache(maxsize=256)
def _fan(heading: float, reach: int, rays: int, view: float) -> _Fan:
    """Args: heading, rad. reach: cells. view: angle over which the rays are spread, rad."""
    steps = np.arange(rays) / (rays - 1) if rays > 1 else np.array([0.5])
    angles = heading + view * (steps - 0.5)
    directions = np.stack([np.cos(angles), np.sin(angles)])
    # 1e-9: a ray along an axis stays on it
    along = np.trunc(
        directions[:, :, None] * np.arange(1, reach + 1) + 1e-9 * np.sign(directions)[:, :, None]
    )
    columns, rows = along.astype(np.int64)
    return _Fan(columns, rows, np.hypot(columns, rows), directions)


class Scanner:
    """Scans one world."""

    def __init__(
        self, environment: Environment, reach: int, rays: int = 181, view: float = math.pi
    ) -> None:
        """Args: reach, cells; rays, spread over an angle of `view`, rad."""
        self.reach = reach
        self._rays, self._view = rays, view
        self.look_again(environment)

    def look_again(self, environment: Environment) -> None:
        """Take the walls of a world, which may have changed."""
        reach = self.reach
        rows, columns = environment.shape
        padded = np.full((rows + 2 * reach, columns + 2 * reach), _OUTSIDE, np.uint8)
        padded[reach : reach + rows, reach : reach + columns] = environment.walls != 0
        self._stride = columns + 2 * reach
        self._blocked = padded.reshape(-1)

    def scan(self, cells: Sequence[Cell], headings: Sequence[float]) -> Scans:
        """Scan from several cells, one after another.

        Args:
            cells: of the scanner. headings: rad, for each.
        """
        where = np.array(cells, np.int64).reshape(len(cells), 2)
        reach = self.reach
        flat = (where[:, 1] + reach) * self._stride + where[:, 0] + reach
        close = max(round(NEAR * reach) - 1, 0)
        parts, turns, order = [], [], []
        for heading in dict.fromkeys(headings):
            which = [number for number, one in enumerate(headings) if one == heading]
            fan = _fan(heading, reach, self._rays, self._view)
            parts.append(
                sense(
                    self._blocked, self._stride, flat[which], where[which],
                    fan.columns, fan.rows, fan.lengths, close,
                )
            )  # fmt: skip
            turns += [fan.directions] * len(which)
            order += which
        if len(parts) == 1:
            lengths, ends, clear, near, walls = parts[0]
        else:
            back = np.argsort(order)
            lengths, ends, clear, near, walls = (
                np.concatenate(each)[back] for each in zip(*parts, strict=True)
            )
            turns = [turns[index] for index in back]
        hits = walls & (lengths < reach - _MARGIN)
        return Scans(where, lengths, ends, clear, near, hits, np.stack(turns))
