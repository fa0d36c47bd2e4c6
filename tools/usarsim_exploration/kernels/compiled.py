"""The kernels compiled by numba."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.steps import DIAGONAL, FAR, MARKS, SAFE, SHIFT, STRAIGHT, WALL

Ints = NDArray[np.int64]
OPEN, DONE = 1, 2
"""Of a cell that may be entered: whether its cost is final."""
F = TypeVar("F", bound=Callable[..., Any])


def _compiled(function: F) -> F:
    made: Any = numba.njit(cache=True, nogil=True)(function)
    return cast(F, made)


@_compiled
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


@_compiled
def sense(
    blocked: NDArray[np.uint8],
    stride: int,
    starts: Ints,
    cells: Ints,
    columns: Ints,
    rows: Ints,
    away: NDArray[np.float64],
    close: int,
) -> tuple[NDArray[np.float64], Ints, Ints, Ints, NDArray[np.bool_]]:
    """What scans from several cells tell, all in one direction.

    Args:
        blocked, stride, starts, columns, rows: as `march` has them; blocked is 1 at walls.
        cells: (scans, 2) the same cells as `starts`, as column and row.
        away: (rays, range) distance of cell m of a ray.
        close: index of the last cell of a ray that is near.

    Returns:
        Distances of the ends (scans, rays); these (scans, rays, 2); the last free cells; the last
        free ones that are near; and whether the end is a wall.
    """
    count, reach = columns.shape
    shape = (len(starts), count, 2)
    found = march(blocked, stride, starts, columns, rows)
    lengths, walls = np.zeros(found.shape), np.zeros(found.shape, np.bool_)
    ends, clear, near = (
        np.empty(shape, np.int64),
        np.empty(shape, np.int64),
        np.empty(shape, np.int64),
    )
    for scan in range(len(starts)):
        column, row = cells[scan, 0], cells[scan, 1]
        for ray in range(count):
            free = found[scan, ray] - 1
            last = free
            if free + 1 < reach:
                there = starts[scan] + rows[ray, free + 1] * stride + columns[ray, free + 1]
                if blocked[there] == 1:
                    last, walls[scan, ray] = free + 1, True
            if last >= 0:
                lengths[scan, ray] = away[ray, last]
            ends[scan, ray, 0], ends[scan, ray, 1] = column, row
            clear[scan, ray, 0], clear[scan, ray, 1] = column, row
            near[scan, ray, 0], near[scan, ray, 1] = column, row
            if last >= 0:
                ends[scan, ray, 0] += columns[ray, last]
                ends[scan, ray, 1] += rows[ray, last]
            if free >= 0:
                clear[scan, ray, 0] += columns[ray, free]
                clear[scan, ray, 1] += rows[ray, free]
                near[scan, ray, 0] += columns[ray, min(free, close)]
                near[scan, ray, 1] += rows[ray, min(free, close)]
    return lengths, ends, clear, near, walls


@_compiled
def mark_walls(
    bits: NDArray[np.uint8],
    ends: Ints,
    hits: NDArray[np.bool_],
    directions: NDArray[np.float64],
    left: int,
    top: int,
) -> None:
    """Write into part of a map what walls scans have seen; certain cells stay as they are.

    First what `wall_cells` tells, then, as certain, the cells that were hit themselves.

    Args:
        bits: the part, (rows, columns). left, top: its corner.
        ends: (scans, rays, 2) cells where rays end. hits: (scans, rays) whether at a wall.
        directions: (scans, 2, rays) cosines and sines.
    """
    height, width = bits.shape
    for scan in range(len(ends)):
        behind = wall_cells(ends[scan], hits[scan], directions[scan, 0], directions[scan, 1])
        for index in range(len(behind)):
            column, row = behind[index, 0] - left, behind[index, 1] - top
            if 0 <= column < width and 0 <= row < height and not bits[row, column] & SAFE:
                bits[row, column] = bits[row, column] & MARKS | WALL
    for scan in range(len(ends)):
        for ray in range(ends.shape[1]):
            column, row = ends[scan, ray, 0] - left, ends[scan, ray, 1] - top
            if hits[scan, ray] and not bits[row, column] & SAFE:
                bits[row, column] = bits[row, column] & MARKS | WALL | SAFE


@_compiled
def wall_cells(
    ends: Ints, hit: NDArray[np.bool_], cosines: NDArray[np.float64], sines: NDArray[np.float64]
) -> Ints:
    """The wall that a scan has seen: between ends of neighbouring rays, and two cells behind.

    Only between ends that are nearer than 5 cells to each other (exploration reference 6.3).

    Args:
        ends: (rays, 2) cells where rays end. hit: whether at a wall.
        cosines, sines: (rays,) of their directions.

    Returns:
        (n, 2) cells, some of them twice, in no useful order.
    """
    found = np.empty((len(ends) * 15, 2), np.int64)
    count = 0
    for ray in range(len(ends) - 1):
        if not (hit[ray] and hit[ray + 1]):
            continue
        right, down = ends[ray + 1, 0] - ends[ray, 0], ends[ray + 1, 1] - ends[ray, 1]
        if right * right + down * down >= 25:
            continue
        parts = max(abs(right), abs(down), 1)
        for part in range(parts + 1):
            share = part / parts
            column = math.floor(ends[ray, 0] + right * share + 0.5)
            row = math.floor(ends[ray, 1] + down * share + 0.5)
            for outward in range(3):
                found[count, 0] = math.floor(column + outward * cosines[ray] + 0.5)
                found[count, 1] = math.floor(row + outward * sines[ray] + 0.5)
                count += 1
    return found[:count]


@_compiled
def _longer(cells: NDArray[np.int32], room: int) -> NDArray[np.int32]:
    longer = np.empty(room, np.int32)
    longer[: len(cells)] = cells
    return longer


@_compiled
def flood(passable: NDArray[np.uint8], starts: Ints, limit: int) -> tuple[NDArray[np.int32], int]:
    """The least cost from the nearest of some cells to every other one.

    Moves go to the eight neighbours; a diagonal one needs both orthogonal cells passable. Buckets
    as wide as an orthogonal move, so that no cell is looked at before its cost is final (Dial,
    "Algorithm 360", CACM 1969).

    Args:
        passable: (rows, columns) not 0: may be entered.
        starts: (n, 2) cells (column, row); passable whatever they are.
        limit: buckets end when so many cells were expanded.

    Returns:
        Costs in units of `steps`, `FAR` where nothing leads; and how many cells were expanded.
    """
    height, width = passable.shape
    stride = width + 2
    padded = np.zeros((height + 2, stride), np.uint8)
    padded[1:-1, 1:-1] = np.where(passable != 0, OPEN, 0)
    state = padded.ravel()
    costs = np.full((height + 2) * stride, FAR, np.int32)
    room = 8 * (height + width) + len(starts)
    now, soon, later = np.empty(room, np.int32), np.empty(room, np.int32), np.empty(room, np.int32)
    here, next_, then = 0, 0, 0  # how many cells each holds
    for index in range(len(starts)):
        cell = (starts[index, 1] + 1) * stride + starts[index, 0] + 1
        costs[cell], state[cell] = 0, OPEN
        now[here] = cell
        here += 1
    expanded, bucket = 0, 0
    while here + next_ + then > 0 and expanded < limit:
        for entry in range(here):
            cell = now[entry]
            cost = costs[cell]
            if state[cell] == DONE or cost >> SHIFT != bucket:
                continue
            state[cell] = DONE
            expanded += 1
            east, south = state[cell + 1], state[cell + stride]
            west, north = state[cell - 1], state[cell - stride]
            offered = cost + STRAIGHT  # always of the next bucket
            if east == OPEN and offered < costs[cell + 1]:
                costs[cell + 1], soon[next_] = offered, cell + 1
                next_ += 1
            if south == OPEN and offered < costs[cell + stride]:
                costs[cell + stride], soon[next_] = offered, cell + stride
                next_ += 1
            if west == OPEN and offered < costs[cell - 1]:
                costs[cell - 1], soon[next_] = offered, cell - 1
                next_ += 1
            if north == OPEN and offered < costs[cell - stride]:
                costs[cell - stride], soon[next_] = offered, cell - stride
                next_ += 1
            offered = cost + DIAGONAL  # of the next bucket or the one after
            for diagonal in range(4):  # no corner is cut
                if diagonal == 0:
                    clear, there = east and south, cell + stride + 1
                elif diagonal == 1:
                    clear, there = west and south, cell + stride - 1
                elif diagonal == 2:
                    clear, there = west and north, cell - stride - 1
                else:
                    clear, there = east and north, cell - stride + 1
                if clear and state[there] == OPEN and offered < costs[there]:
                    costs[there] = offered
                    if offered >> SHIFT == bucket + 1:
                        soon[next_] = there
                        next_ += 1
                    else:
                        later[then] = there
                        then += 1
        now, soon, later = soon, later, now
        here, next_, then = next_, then, 0
        bucket += 1
        if 8 * max(here, next_) > room:  # each cell offers eight moves at most
            room = 16 * max(here, next_)
            now, soon, later = _longer(now, room), _longer(soon, room), np.empty(room, np.int32)
    return costs.reshape(height + 2, stride)[1:-1, 1:-1].copy(), expanded


@_compiled
def crossings(values: NDArray[np.uint8], pairs: Ints) -> Ints:
    """What lies on the lines between pairs of cells, ends included.

    Args:
        values: (rows, columns) 0: free, 1: unknown, 2: wall.
        pairs: (n, 4) column and row of one end, and of the other.

    Returns:
        (n, 4) runs of walls, cells of walls, runs of what is not free, unknown cells.
    """
    found = np.zeros((len(pairs), 4), np.int64)
    for index in range(len(pairs)):
        right, down = pairs[index, 2] - pairs[index, 0], pairs[index, 3] - pairs[index, 1]
        parts = max(abs(right), abs(down), 1)
        before = 0
        for part in range(parts + 1):
            share = part / parts
            column = math.floor(pairs[index, 0] + right * share + 0.5)
            row = math.floor(pairs[index, 1] + down * share + 0.5)
            value = values[row, column]
            if value == 2:
                found[index, 1] += 1
                if before != 2:
                    found[index, 0] += 1
            elif value == 1:
                found[index, 3] += 1
            if value and not before:
                found[index, 2] += 1
            before = value
    return found
