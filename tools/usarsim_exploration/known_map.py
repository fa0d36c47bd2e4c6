"""What a robot knows of the world: bits per cell, and a journal of what changed when.

Two robots in contact trade the cells of their journals since they last met, so an exchange costs
what is new and no more. The rules are those of the exploration reference, 6.2 to 6.4.
"""

from __future__ import annotations

import bisect
from collections.abc import Sequence
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.kernels import once, settle, take_in
from usarsim_exploration.kernels.steps import AT_BASE, FELT, FREE, KNOWN, RELAYED, SAFE, WALL
from usarsim_exploration.sensing import Scanner, Scans

__all__ = [
    "AT_BASE", "FELT", "FREE", "KNOWN", "MERGED", "RELAYED", "SAFE", "WALL", "Cells", "KnownMap",
]  # fmt: skip

Cells = NDArray[np.int64]
"""(n,) flat indices, row * columns + column."""
Bits = NDArray[np.uint8]
_NONE = np.empty(0, np.int32)


def _merged(own: int, other: int) -> int:
    """Bits of a cell after a partner's were heard (exploration 6.4); a wall that was felt stays.

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


class KnownMap:
    """One robot's map.

    Attributes:
        bits: (rows, columns) of each cell; read it, and change it by the methods only.
        free: how many cells are known to be free.
        at_base: how many of these the base knows, as far as this robot has heard.
        relayed: how many of these others carry to the base, which does not know them yet.
        version: grows with each change.
    """

    def __init__(self, shape: tuple[int, int], bits: Bits | None = None) -> None:
        """Nothing is known. bits: zeros of that shape to write to, such as a part of a team's."""
        self.bits: Bits = np.zeros(shape, np.uint8) if bits is None else bits
        self.free = self.at_base = self.relayed = self.version = 0
        self._flat = self.bits.reshape(-1)
        self._journal: list[tuple[int, NDArray[np.int32]]] = []
        self._entries = self._kept = 0  # of the journal; after it was shortened

    @property
    def undelivered(self) -> int:
        """Free cells that neither the base knows nor anybody else carries there."""
        return self.free - self.at_base - self.relayed

    # -- what the robot itself finds out ------------------------------------------------------

    def look(
        self, step: int, scanner: Scanner, cells: Sequence[Cell], headings: Sequence[float],
        driven: bool,
    ) -> NDArray[np.int32]:  # fmt: skip
        """Scan from some cells and take it all in at once (exploration 6.3).

        Args:
            step: now. cells: at least one. headings: rad, for each. driven: over these cells.

        Returns:
            Cells that were unknown before.
        """
        changed, found, more = scanner.look(self.bits, cells, headings, driven)
        self.note(step, changed, more.tolist())
        return found

    def take_in(self, step: int, scans: Scans, driven: bool) -> NDArray[np.int32]:
        """The same for scans that were made before."""
        changed, found, more = take_in(
            self.bits, scans.cells, scans.ends, scans.free_ends, scans.near_ends, scans.hits,
            scans.directions, driven, _NONE,
        )  # fmt: skip
        self.note(step, changed, more.tolist())
        return found

    def bump(self, step: int, cell: Cell) -> None:
        """Something is where free space was thought to be: a certain wall."""
        index = np.array([cell[1] * self.bits.shape[1] + cell[0]])
        _, _, more = settle(self._flat, index, np.array([WALL | SAFE | FELT], np.uint8))
        self.note(step, index.astype(np.int32), more.tolist())  # a change even if it was known

    # -- what it hears ------------------------------------------------------------------------

    def changed_since(self, step: int) -> NDArray[np.int32]:
        """Cells that changed after a step, sorted, each once."""
        journal = self._journal
        if not journal or journal[-1][0] <= step:
            return _NONE
        if len(journal) == 1 or journal[-2][0] <= step:  # as a rule
            return journal[-1][1]
        first = bisect.bisect_right(journal, step, key=itemgetter(0))
        groups = [cells for _, cells in journal[first:]]
        return once(self.bits.size, np.concatenate(groups)).astype(np.int32)

    def news(self, cells: Cells) -> Bits:
        """Bits of cells, as a message carries them."""
        return self._flat[cells]

    def merge(self, step: int, cells: Cells, bits: Bits) -> NDArray[np.int32]:
        """Hear a partner's bits of some cells.

        Returns:
            Cells that were unknown before.
        """
        return self.write(step, cells, MERGED[self._flat[cells], bits])

    def write(self, step: int, cells: Cells, bits: Bits) -> NDArray[np.int32]:
        """Set cells, each named once.

        Returns:
            Those that were unknown before.
        """
        changed, found, more = settle(self._flat, cells, bits)
        self.note(step, changed, more.tolist())
        return found

    def mark(self, step: int, cells: Cells, bit: int) -> None:
        """Note that the base knows cells (`AT_BASE`), or that others carry them (`RELAYED`)."""
        self.write(step, cells, self._flat[cells] | np.uint8(bit))

    def unmark(self, step: int, cells: Cells, bit: int) -> None:
        """Take a mark back: this robot carries the cells again itself."""
        self.write(step, cells, self._flat[cells] & ~np.uint8(bit))

    def note(self, step: int, cells: NDArray[np.int32], more: Sequence[int]) -> None:
        """Count what was changed, and write the journal; shortened when a map longer than then.

        Args:
            cells: sorted. more: how many more are free, at base, relayed.
        """
        if not len(cells):
            return
        self.version += 1
        free, at_base, relayed = more
        self.free, self.at_base = self.free + free, self.at_base + at_base
        self.relayed += relayed
        self._journal.append((step, cells))
        self._entries += len(cells)
        if self._entries > self._kept + self.bits.size:
            self._shorten()

    def _shorten(self) -> None:
        """Keep for each cell only when it changed last."""
        steps = list(dict.fromkeys(step for step, _ in self._journal))
        ranks = {step: rank for rank, step in enumerate(steps, 1)}
        last = np.zeros(self.bits.size, np.min_scalar_type(len(steps)))  # small ones sort faster
        when = np.array([ranks[step] for step, _ in self._journal], last.dtype)
        sizes = [len(group) for _, group in self._journal]
        # of a cell that is named again the last one counts
        last[np.concatenate([group for _, group in self._journal])] = np.repeat(when, sizes)
        cells = np.flatnonzero(last)
        ends = np.cumsum(np.bincount(last[cells], minlength=len(steps) + 1)).tolist()
        ordered = cells[np.argsort(last[cells], kind="stable")].astype(np.int32)
        self._journal = [
            (step, ordered[begin:end])
            for step, begin, end in zip(steps, ends[:-1], ends[1:], strict=True)
            if begin < end
        ]
        self._entries = self._kept = len(cells)
