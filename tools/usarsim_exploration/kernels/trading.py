"""What robots tell each other, cell by cell: compiled by numba.

`plain_trading` says the same by numpy; a test compares them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.compiled import Ints, compiled
from usarsim_exploration.kernels.looking import Bits, count_cell
from usarsim_exploration.kernels.steps import AT_BASE, KNOWN, RELAYED


@compiled
def once(size: int, cells: NDArray[np.int32]) -> Ints:
    """Cells below `size`, sorted, each once."""
    if not len(cells):
        return np.empty(0, np.int64)
    flags = np.zeros(size + 8, np.uint8)
    for cell in cells:
        flags[cell] = 1
    found = np.empty(min(len(cells), size), np.int64)
    count, eight = 0, flags[: (size + 8) // 8 * 8].view(np.uint64)
    for group in range(cells.min() // 8, cells.max() // 8 + 1):
        if eight[group]:
            for cell in range(8 * group, 8 * group + 8):
                found[count] = cell
                count += flags[cell]
                if count == len(found):
                    break
    return found[:count].copy()


@compiled
def tell(maps: Bits, parts: Ints, cells: NDArray[np.int32]) -> tuple[Ints, int]:
    """What robots tell each other: cells that are news to anybody, and how much all hear of them.

    Args:
        maps: (robots, cells) of each.
        parts: (n, 3) who tells, how many hear it, and where in `cells` that ends.
        cells: that each part names, sorted within it.

    Returns:
        The cells, sorted, each once; and how many runs of equal ones are heard.
    """
    runs = begin = 0
    for part in range(len(parts)):
        owner, takers, end = parts[part]
        bits, last, own = maps[owner], -2, 0
        for index in range(begin, end):
            cell = cells[index]
            own += cell != last + 1 or bits[cell] != bits[last]
            last = cell
        runs += takers * own
        begin = end
    return once(maps.shape[1], cells), runs


@compiled
def agree(
    maps: Bits, numbers: Ints, cells: Ints, merged: Bits, at_base: bool
) -> tuple[NDArray[np.int32], Ints, Ints]:
    """Let a group know the same of some cells: what they know, folded in the order of numbers.

    Who knew a cell keeps its own mark of relayed; who did not gets it if anybody had it.

    Args:
        maps: (robots, cells) of each; changed. numbers: of the group. cells: sorted.
        merged: (old, told) the rule for two. at_base: the base is of the group.

    Returns:
        Cells that changed, of one robot after the other; where those of each end; and (robots, 3)
        how many more of its cells are free, at base, relayed.
    """
    shared = np.empty(len(cells), np.uint8)
    relayed = np.empty(len(cells), np.uint8)
    for index in range(len(cells)):
        one = maps[numbers[0], cells[index]]
        shared[index], relayed[index] = one, one & RELAYED
    for other in range(1, len(numbers)):
        bits = maps[numbers[other]]
        for index in range(len(cells)):
            one = bits[cells[index]]
            shared[index] = merged[shared[index], one]
            relayed[index] |= one & RELAYED
    for index in range(len(cells)):
        shared[index] &= ~RELAYED
        if at_base and shared[index] & KNOWN:
            shared[index] |= AT_BASE
    changed = np.empty(len(numbers) * len(cells), np.int32)
    ends, more = np.empty(len(numbers), np.int64), np.zeros((len(numbers), 3), np.int64)
    total = 0
    for robot in range(len(numbers)):
        bits = maps[numbers[robot]]
        for index in range(len(cells)):
            cell = cells[index]
            old = bits[cell]
            new = shared[index] | (old & RELAYED if old & KNOWN else relayed[index])
            if new != old:
                bits[cell] = new
                changed[total] = cell
                total += 1
                count_cell(more[robot], old, bits[cell])
        ends[robot] = total
    return changed[:total].copy(), ends, more


@compiled
def settle(bits: Bits, cells: Ints, new: Bits) -> tuple[NDArray[np.int32], NDArray[np.int32], Ints]:
    """Write cells of a map, flat and each once; returns what `looking.look` does."""
    changed, found = np.empty(len(cells), np.int32), np.empty(len(cells), np.int32)
    more = np.zeros(3, np.int64)
    total = news = 0
    for index in range(len(cells)):
        cell = cells[index]
        old = bits[cell]
        if new[index] == old:
            continue
        bits[cell] = new[index]
        changed[total] = cell
        total += 1
        if not old & KNOWN:
            found[news] = cell
            news += 1
        count_cell(more, old, new[index])
    return changed[:total].copy(), found[:news].copy(), more


@compiled
def waiting_news(bits: Bits, told: Bits, waiting: Ints, changed: Ints) -> tuple[Ints, Bits, Ints]:
    """What one robot can tell another one.

    Args:
        bits, told: of the robot, and as last told; flat.
        waiting, changed: cells that may be news, both sorted and each once.

    Returns:
        Cells that are, sorted; their bits; and where among them runs of equal ones begin.
    """
    most = len(waiting) + len(changed)
    cells, values = np.empty(most, np.int64), np.empty(most, np.uint8)
    starts = np.empty(most, np.int64)
    one = other = count = runs = 0
    while one < len(waiting) or other < len(changed):
        if other == len(changed) or (one < len(waiting) and waiting[one] <= changed[other]):
            cell = waiting[one]
            other += other < len(changed) and changed[other] == cell
            one += 1
        else:
            cell = changed[other]
            other += 1
        value = bits[cell]
        if (value ^ told[cell]) & ~RELAYED == 0:
            continue
        if count == 0 or cells[count - 1] != cell - 1 or values[count - 1] != value:
            starts[runs] = count
            runs += 1
        cells[count], values[count] = cell, value
        count += 1
    return cells[:count].copy(), values[:count].copy(), starts[:runs].copy()


@compiled
def send(
    told: Bits, cells: Ints, values: Bits, starts: Ints, first: int, arrives: NDArray[np.bool_]
) -> tuple[Ints, Bits, Ints]:
    """Send some runs of `waiting_news`.

    Args:
        told: flat; gets what arrives. first: run to begin with; after the last one comes the
            first. arrives: of as many runs as are sent, in that order.

    Returns:
        Cells and bits that arrive, and cells that go on waiting, all sorted.
    """
    count = len(starts)
    gone = np.zeros(len(cells), np.bool_)
    for number in range(len(arrives)):
        run = (first + number) % count
        end = starts[run + 1] if run + 1 < count else len(cells)
        if arrives[number]:
            gone[starts[run] : end] = True
    total = np.count_nonzero(gone)
    there, bits = np.empty(total, np.int64), np.empty(total, np.uint8)
    left = np.empty(len(cells) - total, np.int64)
    sent = stays = 0
    for index in range(len(cells)):
        if gone[index]:
            there[sent], bits[sent] = cells[index], values[index]
            told[cells[index]] = values[index]
            sent += 1
        else:
            left[stays] = cells[index]
            stays += 1
    return there, bits, left
