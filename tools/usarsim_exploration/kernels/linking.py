"""Which links a robot can expect by its map: compiled by numba.

`plain.expected` says the same by numpy; a test compares them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.kernels.compiled import Ints, compiled
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
    last = len(ranges) - 1
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
                parts = max(abs(right), abs(down), 1)
                walls = seen = doubtful = part = 0
                before = False
                while part <= parts and walls <= most:
                    share = part / parts
                    value = bits[
                        math.floor(row + down * share + 0.5),
                        math.floor(column + right * share + 0.5),
                    ]
                    part += 1
                    if value & WALL == 0 and value & KNOWN:
                        before = False
                        continue
                    doubtful += value & KNOWN == 0
                    if cells_count:
                        seen += value & WALL != 0
                    else:
                        seen += not before
                    before = True
                    walls = seen + (doubtful if doubtful > unknown else doubtful // per_wall)
                if walls > most:
                    continue
            found[index, other] = True
            if enough:
                break
    return found
