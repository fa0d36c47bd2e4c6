"""What robots tell each other, cell by cell, by numpy; see `trading`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.plain import Ints, recount
from usarsim_exploration.kernels.steps import AT_BASE, KNOWN, RELAYED

Bits = NDArray[np.uint8]


def once(size: int, cells: NDArray[np.int32]) -> Ints:
    """See `trading.once`."""
    flags = np.zeros(size, np.bool_)  # np.unique takes ten times as long
    flags[cells] = True
    return np.flatnonzero(flags)


def tell(maps: Bits, parts: Ints, cells: NDArray[np.int32]) -> tuple[Ints, int]:
    """See `trading.tell`."""
    runs = begin = 0
    for owner, takers, end in parts.tolist():
        told = cells[begin:end]
        runs += takers * len(_run_starts(told, maps[owner, told]))
        begin = end
    return once(maps.shape[1], cells), runs


def agree(
    maps: Bits, numbers: Ints, cells: Ints, merged: Bits, at_base: bool
) -> tuple[NDArray[np.int32], Ints, Ints]:
    """See `trading.agree`."""
    known = maps[numbers[:, None], cells]
    shared, relayed = known[0], np.bitwise_or.reduce(known) & RELAYED
    for one in known[1:]:
        shared = merged[shared, one]
    shared = shared & ~np.uint8(RELAYED)
    if at_base:
        shared[shared & KNOWN != 0] |= AT_BASE
    new = shared | np.where(known & KNOWN != 0, known & RELAYED, relayed).astype(np.uint8)
    found = [settle(maps[number], cells, one) for number, one in zip(numbers, new, strict=True)]
    changed, _, more = zip(*found, strict=True)
    return np.concatenate(changed), np.cumsum([len(one) for one in changed]), np.stack(more)


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


def _run_starts(cells: Ints | NDArray[np.int32], values: Bits) -> Ints:
    """Where runs of equal cells that follow each other begin."""
    begins = np.ones(len(cells), np.bool_)
    begins[1:] = (np.diff(cells) != 1) | (values[1:] != values[:-1])
    return np.flatnonzero(begins)
