"""Floods that robots with equal maps share: who asks for the same costs gets the same.

Robots that are in contact know the same, so when all of them plan in a step, each floods from the
same places through the same space. The first one does it, the others take that over; a robot whose
map differs by a cell makes its own.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels import flood
from usarsim_exploration.kernels.steps import FAR, SHIFT

_ROOM = 32 * 2**20
"""Bytes of costs that are kept."""


class Floods:
    """Costs from single cells through the map that was asked for last."""

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
