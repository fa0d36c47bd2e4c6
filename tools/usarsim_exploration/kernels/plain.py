"""The kernels by numpy, but for those of `plain_looking`; see `compiled` for what they do."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.steps import (
    AT_BASE,
    COLUMNS,
    DIAGONAL,
    FAR,
    FELT,
    FREE,
    KNOWN,
    RELAYED,
    ROWS,
    STRAIGHT,
    WALL,
)

Ints = NDArray[np.int64]
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

_CHUNK = 16
"""Cells by which an outline grows at once."""


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


def flood(
    passable: NDArray[np.uint8], starts: Ints, limit: int, targets: Ints
) -> tuple[NDArray[np.int32], int]:
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
    wanted = (targets[:, 1] + 1) * stride + targets[:, 0] + 1
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
        if len(wanted) and (costs[wanted] // STRAIGHT < number).all():
            break
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


def expected(
    bits: NDArray[np.uint8],
    cells: Ints,
    others: Ints,
    slack: float,
    ranges: NDArray[np.float64],
    cells_count: bool,
    per_wall: int,
    unknown: int,
    enough: bool,
) -> NDArray[np.bool_]:
    """See `linking.expected`; `enough` or not, all are asked."""
    pairs = np.hstack([np.repeat(cells, len(others), axis=0), np.tile(others, (len(cells), 1))])
    away = np.sqrt(((pairs[:, :2] - pairs[:, 2:]) ** 2).sum(axis=1)) + slack
    walls = np.zeros(len(pairs), np.int64)
    if len(ranges) > 1:
        values = np.where(bits & WALL != 0, 2, bits & KNOWN == 0).astype(np.uint8)
        on = crossings(values, pairs)
        seen, doubtful = on[:, 1 if cells_count else 2], on[:, 3]
        walls = seen + np.where(doubtful > unknown, doubtful, doubtful // per_wall)
    linked: NDArray[np.bool_] = away <= ranges[np.minimum(walls, len(ranges) - 1)]
    return linked.reshape(len(cells), len(others))


def outlined(
    walls: NDArray[np.uint8],
    column: int,
    row: int,
    ways: NDArray[np.float64],
    ranges: NDArray[np.float64],
    cells_count: bool,
) -> Ints:
    """See `linking.outlined`; several cells of all directions at once."""
    rows, columns = walls.shape
    cell = np.array([column, row], np.int64)
    ends = np.tile(cell, (len(ways), 1))
    open_ = np.arange(len(ways))
    values, start = (walls != 0) * np.uint8(2), 1
    while len(open_):
        along = np.arange(start, start + _CHUNK)
        cells = np.floor(cell + ways[open_, None] * along[:, None] + 0.5).astype(np.int64)
        inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=2)
        heard = np.zeros(inside.shape, np.bool_)
        pairs = np.concatenate([np.broadcast_to(cell, (inside.sum(), 2)), cells[inside]], axis=1)
        away = np.sqrt(((pairs[:, :2] - pairs[:, 2:]) ** 2).sum(axis=1))
        between = np.zeros(len(pairs), np.int64)
        if len(ranges) > 1:
            between = crossings(values, pairs)[:, int(cells_count)]
        heard[inside] = away <= ranges[np.minimum(between, len(ranges) - 1)]
        lost = ~heard
        count = np.where(lost.any(axis=1), lost.argmax(axis=1), _CHUNK)
        some = count > 0
        ends[open_[some]] = cells[some, count[some] - 1]
        open_ = open_[count == _CHUNK]
        start += _CHUNK
    return ends


def recount(old: NDArray[np.uint8], new: NDArray[np.uint8]) -> Ints:
    """How many more cells are free, at base and relayed than were."""
    values = len(_ALL)
    more: Ints = _COUNTED @ (
        np.bincount(new, minlength=values) - np.bincount(old, minlength=values)
    )
    return more
