"""The kernels by numpy; see `compiled` for what they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.steps import (
    COLUMNS,
    DIAGONAL,
    FAR,
    MARKS,
    ROWS,
    SAFE,
    STRAIGHT,
    WALL,
)

Ints = NDArray[np.int64]


def march(
    blocked: NDArray[np.uint8], stride: int, starts: Ints, columns: Ints, rows: Ints
) -> NDArray[np.int64]:
    """See `compiled.march`."""
    offsets = rows * stride + columns
    found = np.empty((len(starts), len(columns)), np.int64)
    beyond = columns.shape[1]
    for number, start in enumerate(starts):
        hits = blocked[offsets + start] != 0
        first = hits.argmax(axis=1)
        found[number] = np.where(hits.any(axis=1), first, beyond)
    return found


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
    """See `compiled.sense`."""
    found = march(blocked, stride, starts, columns, rows)
    ray = np.broadcast_to(np.arange(len(columns)), found.shape)
    at = np.minimum(found, columns.shape[1] - 1)
    walls = blocked[starts[:, None] + rows[ray, at] * stride + columns[ray, at]] == 1

    def reached(steps: Ints) -> Ints:
        offsets = np.stack([columns[ray, steps], rows[ray, steps]], axis=-1)
        return cells[:, None] + offsets * (steps >= 0)[..., None]

    last = np.where(walls, at, found - 1)
    lengths = np.where(last >= 0, away[ray, last], 0.0)
    near = np.minimum(found - 1, close)
    return lengths, reached(last), reached(found - 1), reached(near), walls


def mark_walls(
    bits: NDArray[np.uint8],
    ends: Ints,
    hits: NDArray[np.bool_],
    directions: NDArray[np.float64],
    left: int,
    top: int,
) -> None:
    """See `compiled.mark_walls`."""
    height, width = bits.shape
    found = []
    for one, hit, (cosines, sines) in zip(ends, hits, directions, strict=True):
        found.append(wall_cells(one, hit, cosines, sines))
    behind = np.concatenate(found) - (left, top)
    behind = behind[(behind >= 0).all(axis=1) & (behind < (width, height)).all(axis=1)]
    for cells, told in ((behind, WALL), (ends[hits] - (left, top), WALL | SAFE)):
        column, row = cells.T
        old = bits[row, column]
        bits[row, column] = np.where(old & SAFE, old, old & MARKS | told)


def wall_cells(
    ends: Ints, hit: NDArray[np.bool_], cosines: NDArray[np.float64], sines: NDArray[np.float64]
) -> Ints:
    """See `compiled.wall_cells`."""
    near = hit[:-1] & hit[1:]
    step = ends[1:] - ends[:-1]
    near &= (step * step).sum(axis=1) < 25
    which = np.flatnonzero(near)
    if not len(which):
        return np.empty((0, 2), np.int64)
    begin, step = ends[which], step[which]
    cosine, sine = cosines[which], sines[which]
    parts = np.maximum(np.abs(step).max(axis=1), 1)
    found = []
    for part in range(5):
        share = part / parts
        column = np.floor(begin[:, 0] + step[:, 0] * share + 0.5)
        row = np.floor(begin[:, 1] + step[:, 1] * share + 0.5)
        for outward in range(3):
            cells = np.stack(
                [np.floor(column + outward * cosine + 0.5), np.floor(row + outward * sine + 0.5)],
                axis=1,
            )
            found.append(cells[part <= parts])
    return np.concatenate(found).astype(np.int64)


def flood(passable: NDArray[np.uint8], starts: Ints, limit: int) -> tuple[NDArray[np.int32], int]:
    """See `compiled.flood`.

    A bucket holds the cells within one orthogonal move, so none of them can make another one
    cheaper: each bucket is one operation on arrays.
    """
    height, width = passable.shape
    free = np.zeros((height + 2, width + 2), np.uint8)
    free[1:-1, 1:-1] = passable
    stride = width + 2
    free = free.ravel()
    costs = np.full(len(free), FAR, np.int32)
    first = (starts[:, 1] + 1) * stride + starts[:, 0] + 1
    costs[first] = 0
    free[first] = 1
    buckets: dict[int, list[Ints]] = {0: [np.unique(first)]}
    moves = ROWS * stride + COLUMNS
    expanded, number = 0, 0
    while buckets and expanded < limit:
        waiting = buckets.pop(number, None)
        number += 1
        if waiting is None:
            continue
        cells = np.unique(np.concatenate(waiting))
        cells = cells[costs[cells] // STRAIGHT == number - 1]
        expanded += len(cells)
        for index, move in enumerate(moves):
            price = STRAIGHT if index < 4 else DIAGONAL
            there = cells + move
            open_ = free[there] != 0
            if index >= 4:  # no corner is cut
                open_ &= (free[cells + COLUMNS[index]] != 0) & (
                    free[cells + ROWS[index] * stride] != 0
                )
            offered = costs[cells] + price
            better = open_ & (offered < costs[there])
            there, offered = there[better], offered[better]
            costs[there] = offered
            for bucket in np.unique(offered // STRAIGHT):
                buckets.setdefault(int(bucket), []).append(there[offered // STRAIGHT == bucket])
    return costs.reshape(height + 2, stride)[1:-1, 1:-1].copy(), expanded


def crossings(values: NDArray[np.uint8], pairs: Ints) -> Ints:
    """See `compiled.crossings`."""
    found = np.zeros((len(pairs), 4), np.int64)
    for index, pair in enumerate(pairs):
        step = pair[2:] - pair[:2]
        parts = max(int(np.abs(step).max()), 1)
        share = (np.arange(parts + 1) / parts)[:, None]
        cells = np.floor(pair[:2] + step * share + 0.5).astype(np.int64)
        on = values[cells[:, 1], cells[:, 0]]
        before = np.concatenate([[0], on[:-1]])
        found[index] = (
            np.count_nonzero((on == 2) & (before != 2)),
            np.count_nonzero(on == 2),
            np.count_nonzero((on != 0) & (before == 0)),
            np.count_nonzero(on == 1),
        )
    return found
