"""The kernels compiled by numba, but for those of `looking`."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.steps import DIAGONAL, FAR, SHIFT, STRAIGHT

Ints = NDArray[np.int64]
CLOSED = -1
"""Cost of a cell that may not be entered: less than any that is offered."""
F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Decorator: compile at the first call, and keep that on disk."""
    made: Any = numba.njit(cache=True, nogil=True)(function)
    return cast(F, made)


@compiled
def march(
    blocked: NDArray[np.uint8], stride: int, starts: Ints, columns: Ints, rows: Ints
) -> NDArray[np.int64]:
    """How many cells of each ray are free, for scans from several cells.

    Args:
        blocked: cells of a world, flat, with a margin as wide as the range; not 0: blocked.
        stride: cells of a row.
        starts: (scans,) flat cells of the scanners.
        columns: (rays, range) how far cell m of a ray lies to the right of the scanner.
        rows: (rays, range) how far below.

    Returns:
        (scans, rays) index of the first blocked cell; range if none is.
    """
    count, length = columns.shape
    found = np.empty((len(starts), count), np.int64)
    for scan in range(len(starts)):
        start = starts[scan]
        for ray in range(count):
            index = 0
            while index < length:
                if blocked[start + rows[ray, index] * stride + columns[ray, index]]:
                    break
                index += 1
            found[scan, ray] = index
    return found


@compiled
def _longer(cells: NDArray[np.int32], room: int) -> NDArray[np.int32]:
    longer = np.empty(room, np.int32)
    longer[: len(cells)] = cells
    return longer


@compiled
def flood(
    passable: NDArray[np.uint8], starts: Ints, limit: int, targets: Ints
) -> tuple[NDArray[np.int32], int]:
    """The least cost from the nearest of some cells to every other one.

    Moves go to the eight neighbours; a diagonal one needs both orthogonal cells passable. Buckets
    as wide as an orthogonal move, so that no cell is looked at before its cost is final (Dial,
    "Algorithm 360", CACM 1969).

    Args:
        passable: (rows, columns) not 0: may be entered.
        starts: (n, 2) cells (column, row); passable whatever they are.
        limit: buckets end when so many cells were expanded.
        targets: (n, 2) cells; when the costs of all of them are final, those of others, which are
            farther, are not found out. None: all are.

    Returns:
        Costs in units of `steps`, `FAR` where nothing leads; and how many cells were expanded.
    """
    height, width = passable.shape
    stride = width + 2
    padded = np.full((height + 2, stride), CLOSED, np.int32)
    for row in range(height):
        for column in range(width):
            if passable[row, column]:
                padded[row + 1, column + 1] = FAR
    costs = padded.ravel()
    room = 8 * (height + width) + len(starts)
    now, soon, later = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.int32)
    here, next_, then = 0, 0, 0  # how many cells each holds, each cell once
    for index in range(len(starts)):
        cell = (starts[index, 1] + 1) * stride + starts[index, 0] + 1
        if costs[cell] != 0:
            costs[cell] = 0
            now[here] = cell
            here += 1
    wanted = (targets[:, 1] + 1) * stride + targets[:, 0] + 1
    missing = len(wanted)  # from there on all are final
    expanded, bucket = 0, 0
    while here + next_ + then > 0 and expanded < limit:
        for entry in range(here):
            cell = np.uint32(now[entry])  # unsigned: compiled code need not ask for the sign
            cost = costs[cell]
            if cost >> SHIFT != bucket:  # it has become cheaper, and was expanded before
                continue
            expanded += 1
            right, left = cell + np.uint32(1), cell - np.uint32(1)
            below, above = cell + np.uint32(stride), cell - np.uint32(stride)
            east, south, west, north = costs[right], costs[below], costs[left], costs[above]
            offered = np.int32(cost + STRAIGHT)  # always of the next bucket
            for there, before in ((right, east), (below, south), (left, west), (above, north)):
                if offered < before:
                    costs[there] = offered
                    if before >> SHIFT != bucket + 1:
                        soon[next_] = there
                        next_ += 1
            offered = np.int32(cost + DIAGONAL)  # of the next bucket or the one after
            due = offered >> SHIFT
            for there, one, other in (
                (below + np.uint32(1), east, south),
                (below - np.uint32(1), west, south),
                (above - np.uint32(1), west, north),
                (above + np.uint32(1), east, north),
            ):
                before = costs[there]
                if offered < before and one != CLOSED and other != CLOSED:  # no corner is cut
                    costs[there] = offered
                    if before >> SHIFT == due:
                        continue
                    if due == bucket + 1:
                        soon[next_] = there
                        next_ += 1
                    else:
                        later[then] = there
                        then += 1
        now, soon, later = soon, later, now
        here, next_, then = next_, then, 0
        while missing > 0 and 0 <= costs[wanted[missing - 1]] >> SHIFT <= bucket:
            missing -= 1
        bucket += 1
        if missing == 0 and len(wanted) > 0:
            break
        if 8 * max(here, next_) > room:  # each cell offers eight moves at most
            room = 16 * max(here, next_)
            now, soon, later = _longer(now, room), _longer(soon, room), np.empty(room, np.int32)
    found = np.empty((height, width), np.int32)
    for row in range(height):
        for column in range(width):
            cost = padded[row + 1, column + 1]
            found[row, column] = cost if cost != CLOSED else FAR
    return found, expanded


@compiled
def line(
    column: int, row: int, right: int, down: int, stride: int
) -> tuple[int, int, int, int, int]:
    """How to go along the line from a cell to one so far to the right and below, cell by cell.

    Part p of it is the cell's own plus the way times p / parts, rounded, halves up.

    Args:
        stride: cells of a row.

    Returns:
        Parts; flat moves along the longer side and, when `turns` says so, along the other one;
        where it begins on the other side, and how far it goes there.
    """
    along, beside = (1 if right > 0 else -1), (stride if down > 0 else -stride)
    if abs(down) > abs(right):
        return abs(down), beside, along, column, right
    return max(abs(right), 1), along if right else 0, beside, row, down


@compiled
def turns(error: int, part: int, parts: int, begin: int, aside: int) -> bool:
    """Whether a line moves to the side at a part.

    Whole numbers tell, but where it passes right between two cells: there floats do, as in numpy.

    Args:
        error: 2 |aside| more at each part, and 2 parts less at each move to the side.
        parts, begin, aside: of `line`.
    """
    if error != parts:
        return error > parts
    before = (2 * abs(aside) * part - parts) // (2 * parts)
    place = begin + (before if aside > 0 else -before)
    return bool(math.floor(begin + aside * (part / parts) + 0.5) != place)


@compiled
def crossings(values: NDArray[np.uint8], pairs: Ints) -> Ints:
    """What lies on the lines between pairs of cells, ends included.

    Args:
        values: (rows, columns) 0: free, 1: unknown, 2: wall.
        pairs: (n, 4) column and row of one end, and of the other.

    Returns:
        (n, 4) runs of walls, cells of walls, runs of what is not free, unknown cells.
    """
    found = np.zeros((len(pairs), 4), np.int64)
    flat, stride = values.ravel(), values.shape[1]
    for index in range(len(pairs)):
        column, row = pairs[index, 0], pairs[index, 1]
        right, down = pairs[index, 2] - column, pairs[index, 3] - row
        parts, along, beside, begin, aside = line(column, row, right, down, stride)
        cell = row * stride + column
        before = error = part = 0
        while True:
            value = flat[cell]
            if value == 2:
                found[index, 1] += 1
                if before != 2:
                    found[index, 0] += 1
            elif value == 1:
                found[index, 3] += 1
            if value and not before:
                found[index, 2] += 1
            before = value
            part += 1
            if part > parts:
                break
            cell += along
            error += 2 * abs(aside)
            if turns(error, part, parts, begin, aside):
                cell += beside
                error -= 2 * parts
    return found
