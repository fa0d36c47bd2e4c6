"""Which links a robot can expect by its map, and how far radios reach: compiled by numba.

`plain` says the same by numpy; a test compares them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.compiled import Ints, compiled, line, turns
from usarsim_exploration.kernels.steps import KNOWN, WALL


@compiled
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
    """Whether links between cells and others are to be expected, (cells, others).

    A line is followed only until its walls are too many for its length.

    Args:
        bits: (rows, columns) of the map. cells, others: (n, 2), the ends of the lines.
        slack: cells by which each pair may still move apart.
        ranges: the farthest distances with a link through 0 walls, 1, 2 ...; never longer than the
            one before; the last one holds for more walls, too.
        cells_count: cells of walls are counted, not runs of what is unknown or a wall.
        per_wall: so many unknown cells are one more wall.
        unknown: with more unknown cells on a line, each of them is one.
        enough: a cell's first link is; others that come later are not asked.
    """
    found = np.zeros((len(cells), len(others)), np.bool_)
    flat, stride, last = bits.ravel(), bits.shape[1], len(ranges) - 1
    for index in range(len(cells)):
        column, row = cells[index, 0], cells[index, 1]
        for other in range(len(others)):
            right, down = others[other, 0] - column, others[other, 1] - row
            away = math.sqrt(right * right + down * down) + slack
            if away > ranges[0]:
                continue
            most = 0  # walls through which it is linked
            while most < last and away <= ranges[most + 1]:
                most += 1
            if most < last:
                parts, along, beside, begin, aside = line(column, row, right, down, stride)
                cell = row * stride + column
                walls = seen = doubtful = error = part = 0
                before = False
                while True:
                    value = flat[cell]
                    if value & WALL == 0 and value & KNOWN:
                        before = False
                    else:
                        doubtful += value & KNOWN == 0
                        if cells_count:
                            seen += value & WALL != 0
                        else:
                            seen += not before
                        before = True
                        walls = seen + (doubtful if doubtful > unknown else doubtful // per_wall)
                    part += 1
                    if part > parts or walls > most:
                        break
                    cell += along
                    error += 2 * abs(aside)
                    if turns(error, part, parts, begin, aside):
                        cell += beside
                        error -= 2 * parts
                if walls > most:
                    continue
            found[index, other] = True
            if enough:
                break
    return found


@compiled
def outlined(
    walls: NDArray[np.uint8],
    column: int,
    row: int,
    ways: NDArray[np.float64],
    ranges: NDArray[np.float64],
    cells_count: bool,
) -> Ints:
    """The last cells with a link from a cell, (directions, 2); the first one without ends each.

    Args:
        walls: (rows, columns) of the world, not 0: a wall. column, row: of the cell.
        ways: (directions, 2) cosines and sines.
        ranges, cells_count: as `expected` has them; without unknown cells.
    """
    (height, width), flat = walls.shape, walls.ravel()
    ends = np.empty((len(ways), 2), np.int64)
    last = len(ranges) - 1
    for way in range(len(ways)):
        ends[way, 0], ends[way, 1] = column, row
        along = 0
        while True:
            along += 1
            c = math.floor(column + ways[way, 0] * along + 0.5)
            r = math.floor(row + ways[way, 1] * along + 0.5)
            if not (0 <= c < width and 0 <= r < height):
                break
            right, down = c - column, r - row
            away = math.sqrt(right * right + down * down)
            if away > ranges[0]:
                break
            most = 0  # walls through which it is linked
            while most < last and away <= ranges[most + 1]:
                most += 1
            if most < last:
                parts, ahead, beside, begin, aside = line(column, row, right, down, width)
                cell = row * width + column
                seen = error = part = 0
                before = False
                while True:
                    wall = flat[cell] != 0
                    seen += wall and (cells_count or not before)
                    before = wall
                    part += 1
                    if part > parts or seen > most:
                        break
                    cell += ahead
                    error += 2 * abs(aside)
                    if turns(error, part, parts, begin, aside):
                        cell += beside
                        error -= 2 * parts
                if seen > most:
                    break
            ends[way, 0], ends[way, 1] = c, r
    return ends
