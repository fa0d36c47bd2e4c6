"""What robots tell each other, cell by cell, by numpy; see `trading`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.plain import Ints, recount
from usarsim_exploration.kernels.steps import KNOWN, RELAYED

Bits = NDArray[np.uint8]


def once(size: int, cells: NDArray[np.int32]) -> Ints:
    """See `trading.once`."""
    flags = np.zeros(size, np.bool_)  # np.unique takes ten times as long
    flags[cells] = True
    return np.flatnonzero(flags)


def tell(bits: Bits, cells: Ints, fresh: NDArray[np.bool_]) -> int:
    """See `trading.tell`."""
    fresh[cells] = True
    return len(_run_starts(cells, bits[cells]))


def fold(shared: Bits, relayed: Bits, bits: Bits, cells: Ints, merged: Bits) -> None:
    """See `trading.fold`."""
    one = bits[cells]
    shared[:] = merged[shared, one]
    relayed |= one & RELAYED


def agree(
    bits: Bits, cells: Ints, shared: Bits, relayed: Bits
) -> tuple[NDArray[np.int32], NDArray[np.int32], Ints]:
    """See `trading.agree`."""
    own = bits[cells]
    mark = np.where(own & KNOWN != 0, own & RELAYED, relayed).astype(np.uint8)
    return settle(bits, cells, shared | mark)


def settle(bits: Bits, cells: Ints, new: Bits) -> tuple[NDArray[np.int32], NDArray[np.int32], Ints]:
    """See `trading.settle`."""
    old = bits[cells]
    differ = new != old
    changed, old, new = cells[differ].astype(np.int32), old[differ], new[differ]
    bits[changed] = new
    return changed, changed[old & KNOWN == 0], recount(old, new)


def waiting_news(bits: Bits, told: Bits, waiting: Ints, changed: Ints) -> tuple[Ints, Bits, Ints]:
    """See `trading.waiting_news`."""
    flags = np.zeros(len(bits), np.bool_)
    flags[waiting] = flags[changed] = True
    cells = np.flatnonzero(flags)
    values = bits[cells]
    news = (values ^ told[cells]) & ~np.uint8(RELAYED) != 0
    cells, values = cells[news], values[news]
    return cells, values, _run_starts(cells, values)


def send(
    told: Bits, cells: Ints, values: Bits, starts: Ints, first: int, arrives: NDArray[np.bool_]
) -> tuple[Ints, Bits, Ints]:
    """See `trading.send`."""
    chosen = np.zeros(len(starts), np.bool_)
    chosen[(first + np.flatnonzero(arrives)) % len(starts)] = True
    gone = np.repeat(chosen, np.diff(starts, append=len(cells)))
    told[cells[gone]] = values[gone]
    return cells[gone], values[gone], cells[~gone]


def _run_starts(cells: Ints, values: Bits) -> Ints:
    """Where runs of equal cells that follow each other begin."""
    begins = np.ones(len(cells), np.bool_)
    begins[1:] = (np.diff(cells) != 1) | (values[1:] != values[:-1])
    return np.flatnonzero(begins)
