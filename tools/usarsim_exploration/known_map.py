"""What a robot knows of the world: bits per cell, and a journal of what changed when.

Two robots in contact trade the cells of their journals since they last met, so an exchange costs
what is new and no more. The rules are those of the exploration reference, 6.2 to 6.4.
"""

from __future__ import annotations

import bisect
from collections.abc import Iterable
from operator import itemgetter

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels import mark_walls
from usarsim_exploration.kernels.steps import AT_BASE, FELT, FREE, MARKS, RELAYED, SAFE, WALL
from usarsim_exploration.sensing import Scans

__all__ = [
    "AT_BASE", "FELT", "FREE", "KNOWN", "MERGED", "RELAYED", "SAFE", "WALL", "Cells", "KnownMap",
]  # fmt: skip

KNOWN = FREE | SAFE | WALL

Cells = NDArray[np.int64]
"""(n,) flat indices, row * columns + column."""


def _merged(own: int, other: int) -> int:
    """Bits of a cell after a partner's were heard (reference 6.4); a wall that was felt stays.

    Else whoever finds a door closed would hear from others at once that it is certainly open.
    """
    shape = own & KNOWN
    if (own | other) & FELT:
        shape = WALL | SAFE | FELT
    elif other & SAFE and other & FREE:
        shape = FREE | SAFE
    elif other & SAFE and other & WALL:
        if not (own & SAFE and not own & WALL):
            shape = WALL | SAFE
    elif other & FREE:
        if not own & (SAFE | WALL):
            shape = FREE
    elif other & WALL and not own & (SAFE | FREE):
        shape = WALL
    marks = (own | other) & AT_BASE | own & RELAYED
    if not own & KNOWN:
        marks |= other & RELAYED
    return shape | (marks if shape else 0)


MERGED = np.array([[_merged(own, other) for other in range(64)] for own in range(64)], np.uint8)
"""Indexed by own bits and a partner's."""
_ALL = np.arange(2 * FELT)
_COUNTED = np.array(
    [
        _ALL & FREE != 0,
        _ALL & (FREE | AT_BASE) == FREE | AT_BASE,
        _ALL & (FREE | AT_BASE | RELAYED) == FREE | RELAYED,
    ],
    np.int64,
)
"""Which bits are counted as free, as at base, as relayed."""
_AROUND = np.ones((3, 3), np.uint8)


class KnownMap:
    """One robot's map.

    Attributes:
        bits: (rows, columns) of each cell; read it, and change it by the methods only.
        free: how many cells are known to be free.
        at_base: how many of these the base knows, as far as this robot has heard.
        relayed: how many of these others carry to the base, which does not know them yet.
        version: grows with each change.
    """

    def __init__(self, shape: tuple[int, int]) -> None:
        """Nothing is known."""
        self.bits: NDArray[np.uint8] = np.zeros(shape, np.uint8)
        self.free = self.at_base = self.relayed = self.version = 0
        self._flat = self.bits.reshape(-1)
        self._journal: list[tuple[int, NDArray[np.int32]]] = []
        self._entries = 0

    @property
    def undelivered(self) -> int:
        """Free cells that neither the base knows nor anybody else carries there."""
        return self.free - self.at_base - self.relayed

    # -- what the robot itself finds out ------------------------------------------------------

    def integrate(self, step: int, scans: Scans, driven: Iterable[Cell]) -> Cells:
        """Take in the scans of a step, all at once (reference 6.3).

        Args:
            step: now. scans: at least one. driven: cells that were driven over.

        Returns:
            Cells that were unknown before.
        """
        rows, columns = self.bits.shape
        left, top = np.maximum(scans.ends.min(axis=(0, 1)) - 3, 0)
        left, top = min(left, *scans.cells[:, 0]), min(top, *scans.cells[:, 1])
        right, bottom = np.maximum(scans.ends.max(axis=(0, 1)), scans.cells.max(axis=0)) + 4
        right, bottom = min(right, columns), min(bottom, rows)
        corner = np.array([left, top])
        part = self.bits[top:bottom, left:right]
        before = part.copy()
        seen, near = np.zeros_like(part), np.zeros_like(part)
        for cell, ends, short in zip(scans.cells, scans.free_ends, scans.near_ends, strict=True):
            _fill(seen, cell - corner, ends - corner)
            _fill(near, cell - corner, short - corner)
        mark_walls(part, scans.ends, scans.hits, scans.directions, int(left), int(top))
        part |= (part & KNOWN == 0).view(np.uint8) & seen  # 1 is FREE
        self._make_safe(near, corner)
        for column, row in driven:
            cell_bits = self.bits[row, column]
            self.bits[row, column] = cell_bits & MARKS | FREE | SAFE
        changed = np.flatnonzero(part != before)
        old = before.reshape(-1)[changed]
        high, wide = np.divmod(changed, right - left)
        cells = (high + top) * columns + wide + left
        self._note(step, cells, old)
        found: Cells = cells[old & KNOWN == 0]
        return found

    def bump(self, step: int, cell: Cell) -> None:
        """Something is where free space was thought to be: a certain wall."""
        index = np.array([cell[1] * self.bits.shape[1] + cell[0]])
        old = self._flat[index]
        self._flat[index] = WALL | SAFE | FELT
        self._note(step, index, old)

    def _make_safe(self, near: NDArray[np.uint8], corner: NDArray[np.int64]) -> None:
        """What is very near, and around which all is known, is certainly free.

        Points of walls that were measured stay; what was only supposed to be behind them goes.
        """
        left, top, width, height = cv2.boundingRect(near)
        inner = near[top : top + height, left : left + width]
        column, row = int(corner[0]) + left, int(corner[1]) + top
        above, before = max(row - 1, 0), max(column - 1, 0)
        around = self.bits[above : row + height + 1, before : column + width + 1]
        whole = cv2.erode((around & KNOWN != 0).view(np.uint8), _AROUND)
        whole = whole[row - above :, column - before :][:height, :width]
        part = self.bits[row : row + height, column : column + width]
        safe = (inner != 0) & (whole != 0) & (part & (WALL | SAFE) != WALL | SAFE)
        part[safe] = part[safe] & MARKS | FREE | SAFE

    # -- what it hears ------------------------------------------------------------------------

    def changed_since(self, step: int) -> Cells:
        """Cells that changed after a step, sorted, each once."""
        first = bisect.bisect_right(self._journal, step, key=itemgetter(0))
        found = [cells for _, cells in self._journal[first:]]
        return (np.unique(np.concatenate(found)) if found else np.empty(0)).astype(np.int64)

    def news(self, cells: Cells) -> NDArray[np.uint8]:
        """Bits of cells, as a message carries them."""
        return self._flat[cells]

    def merge(self, step: int, cells: Cells, bits: NDArray[np.uint8]) -> Cells:
        """Hear a partner's bits of some cells.

        Returns:
            Cells that were unknown before.
        """
        old = self._flat[cells]
        new = MERGED[old, bits]
        differ = new != old
        cells, old = cells[differ], old[differ]
        self._flat[cells] = new[differ]
        self._note(step, cells, old)
        found: Cells = cells[old & KNOWN == 0]
        return found

    def write(self, step: int, cells: Cells, bits: NDArray[np.uint8]) -> None:
        """Take over bits of cells that were agreed upon with others."""
        old = self._flat[cells]
        differ = bits != old
        self._flat[cells] = bits
        self._note(step, cells[differ], old[differ])

    def mark(self, step: int, cells: Cells, bit: int) -> None:
        """Note that the base knows cells (`AT_BASE`), or that others carry them (`RELAYED`)."""
        old = self._flat[cells]
        cells, old = cells[old & bit == 0], old[old & bit == 0]
        self._flat[cells] |= bit
        self._note(step, cells, old)

    def unmark(self, step: int, cells: Cells, bit: int) -> None:
        """Take a mark back: this robot carries the cells again itself."""
        old = self._flat[cells]
        cells, old = cells[old & bit != 0], old[old & bit != 0]
        self._flat[cells] &= ~np.uint8(bit)
        self._note(step, cells, old)

    def _note(self, step: int, cells: Cells, old: NDArray[np.uint8]) -> None:
        """Count again, and write the journal; shortened when it is far longer than the map."""
        if not len(cells):
            return
        self.version += 1
        new = self._flat[cells]
        values = len(_ALL)
        more = np.bincount(new, minlength=values) - np.bincount(old, minlength=values)
        free, at_base, relayed = (_COUNTED @ more).tolist()
        self.free, self.at_base = self.free + free, self.at_base + at_base
        self.relayed += relayed
        self._journal.append((step, cells.astype(np.int32)))
        self._entries += len(cells)
        if self._entries > 2 * self.bits.size:  # at least a map's since the last time
            self._shorten()

    def _shorten(self) -> None:
        """Keep for each cell only when it changed last."""
        last = np.full(self.bits.size, -1, np.int64)
        for when, group in self._journal:
            last[group] = when
        cells = np.flatnonzero(last >= 0)
        cells = cells[np.argsort(last[cells], kind="stable")]
        steps, firsts = np.unique(last[cells], return_index=True)
        groups = np.split(cells.astype(np.int32), firsts[1:])
        self._journal = [(int(when), group) for when, group in zip(steps, groups, strict=True)]
        self._entries = len(cells)


def _fill(mask: NDArray[np.uint8], cell: NDArray[np.int64], ends: NDArray[np.int64]) -> None:
    """Fill the polygon of a scanner's cell and the ends of its rays."""
    corners = np.concatenate([cell[None], ends]).astype(np.int32)
    cv2.fillPoly(mask, [corners], 1)
