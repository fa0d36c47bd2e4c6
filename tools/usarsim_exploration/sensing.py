"""The range finder: rays through the true world, 181 of them over 180 degrees as a rule.

Cell m of a ray is the scanner's own plus m cosine and m sine, both cut towards zero; a reading is
the distance between whole cells (exploration reference 6.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.kernels import look
from usarsim_exploration.kernels.plain_looking import Scans, cast

__all__ = ["NEAR", "Scanner", "Scans"]

NEAR = 0.1
"""Part of the range within which what is seen is certain."""
SUPPOSED, EVERYWHERE = 5, 255
"""Cells from true walls up to which scans suppose walls: between ends that are nearer than 5 cells
to each other, and two behind; and more than any cell has."""


class Scanner:
    """Scans one world.

    Attributes:
        reach: cells. shape: rows and columns of the world.
    """

    def __init__(
        self,
        environment: Environment,
        reach: int,
        rays: int = 181,
        view: float = math.pi,
        *,
        tight: bool = True,
        wary: bool = False,
    ) -> None:
        """Look around in a world.

        Args:
            reach: cells. rays: spread over an angle of `view`, rad.
            tight: they end between two walls that touch at a corner, and what they pass is free.
            wary: maps may have walls anywhere that are none, not only beside true ones.
        """
        self._tight, self._margin = tight, EVERYWHERE if wary else SUPPOSED
        self.reach, self.shape = reach, environment.shape
        steps = np.arange(rays) / (rays - 1) if rays > 1 else np.array([0.5])
        self._angles = view * (steps - 0.5)
        self._close = max(round(NEAR * reach) - 1, 0)
        self._turns: dict[float, int] = {}
        self._fans = np.empty((0, rays, reach, 2), np.int16)
        self._offsets = np.empty((0, rays, reach), np.int32)
        self._directions = np.empty((0, 2, rays))
        self._survey(environment)

    def look_again(self, environment: Environment) -> None:
        """Take the walls of a world, which have changed: maps may have old ones anywhere."""
        self._margin = EVERYWHERE
        self._survey(environment)

    def _survey(self, environment: Environment) -> None:
        rows, columns = self.shape
        free = np.zeros((rows + 2 * self.reach, columns + 2 * self.reach), np.uint8)
        free[self.reach :, self.reach :][:rows, :columns] = environment.walls == 0
        away = cv2.distanceTransform(free, cv2.DIST_C, 3)
        self._clear = np.minimum(away, 255).astype(np.uint8).reshape(-1)

    def scan(self, cells: Sequence[Cell], headings: Sequence[float]) -> Scans:
        """Scan from several cells, one after another. headings: rad, for each."""
        scans = self._scans(cells, headings)
        return cast(
            self._clear, self.shape, self.reach, self._fans, self._offsets, self._directions,
            scans, self._close, self._tight,
        )  # fmt: skip

    def look(
        self,
        bits: NDArray[np.uint8],
        cells: Sequence[Cell],
        headings: Sequence[float],
        driven: bool,
    ) -> tuple[NDArray[np.int32], NDArray[np.int32], NDArray[np.int64]]:
        """Take into a map what scans from several cells tell; see `kernels.looking.look`."""
        scans = self._scans(cells, headings)
        return look(
            bits, self._clear, self.reach, self._fans, self._offsets, self._directions, scans,
            self._close, self._tight, self._margin, driven,
        )  # fmt: skip

    def _scans(self, cells: Sequence[Cell], headings: Sequence[float]) -> NDArray[np.int64]:
        """(n, 3) column, row and number of the heading of each."""
        turns = self._turns
        for heading in headings:
            if heading not in turns:
                self._add(heading)
        return np.array(
            [(*cell, turns[heading]) for cell, heading in zip(cells, headings, strict=True)],
            np.int64,
        )

    def _add(self, heading: float) -> None:
        """Prepare the rays of a heading, rad."""
        angles = heading + self._angles
        directions = np.stack([np.cos(angles), np.sin(angles)])
        # 1e-9: a ray along an axis stays on it
        along = np.trunc(
            directions[:, :, None] * np.arange(1, self.reach + 1)
            + 1e-9 * np.sign(directions)[:, :, None]
        )
        fan = np.moveaxis(along, 0, -1).astype(np.int16)
        self._turns[heading] = len(self._turns)
        self._fans = np.concatenate([self._fans, fan[None]])
        offsets = along[1] * (self.shape[1] + 2 * self.reach) + along[0]
        self._offsets = np.concatenate([self._offsets, offsets.astype(np.int32)[None]])
        self._directions = np.concatenate([self._directions, directions[None]])
