"""What a learner sees of a robot's map: the surroundings in detail, and all of it coarsely.

Both have the same shape in every world, rows before columns from the top left, as `usarsim explore`
has them, and are pictures of bytes, channels first.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.known_map import FREE, KNOWN, WALL

LOCAL = 64
"""Cells: side of the surroundings, the robot at row and column 32."""
WHOLE = 48
"""Rows and columns of the whole map."""
ME, MATE = 255, 128
"""Of the third channel of the whole map: this robot, and where it thinks that others are."""

Picture = NDArray[np.uint8]
Observation = dict[str, Any]

_FREE = np.array([255 if bits & (FREE | WALL) == FREE else 0 for bits in range(64)], np.uint8)
_WALL = np.array([255 if bits & WALL else 0 for bits in range(64)], np.uint8)
_UNKNOWN = np.array([0 if bits & KNOWN else 255 for bits in range(64)], np.uint8)
_AROUND = np.ones((3, 3), np.uint8)


def map_spaces() -> dict[str, spaces.Space[Any]]:
    """`local` (3, 64, 64) and `map` (3, 48, 48), uint8."""
    return {
        "local": spaces.Box(0, 255, (3, LOCAL, LOCAL), np.uint8),
        "map": spaces.Box(0, 255, (3, WHOLE, WHOLE), np.uint8),
    }


def surroundings(bits: Picture, cell: Cell) -> Picture:
    """(3, 64, 64) known free cells, walls, and free cells beside unknown ones: 255, else 0.

    Args:
        bits: (rows, columns) of a known map; what is outside is a wall.
        cell: column and row of the robot.
    """
    half = LOCAL // 2
    rows, columns = bits.shape
    left, top = cell[0] - half, cell[1] - half
    part = np.full((LOCAL, LOCAL), WALL, np.uint8)
    a, b = max(top, 0), min(top + LOCAL, rows)
    c, d = max(left, 0), min(left + LOCAL, columns)
    part[a - top : b - top, c - left : d - left] = bits[a:b, c:d]
    found = np.empty((3, LOCAL, LOCAL), np.uint8)
    found[0], found[1] = _FREE[part], _WALL[part]
    found[2] = found[0] & cv2.dilate(_UNKNOWN[part], _AROUND)
    return found


def whole(bits: Picture, cell: Cell, mates: Iterable[Cell] = ()) -> Picture:
    """(3, 48, 48) how much of each patch is known free space and wall, 255: all; and who is where.

    Args:
        bits: (rows, columns) of a known map. cell: of the robot. mates: cells of others.
    """
    found = np.zeros((3, WHOLE, WHOLE), np.uint8)
    shape = bits & (FREE | WALL)
    found[0], found[1] = _parts(shape == FREE), _parts(shape & WALL != 0)
    rows, columns = bits.shape
    for value, (column, row) in [*((MATE, one) for one in mates), (ME, cell)]:
        found[2, row * WHOLE // rows, column * WHOLE // columns] = value
    return found


def _parts(cells: NDArray[np.bool_]) -> Picture:
    """(48, 48) of each patch the part that is set, 0 to 255."""
    corners, areas = _corners(*cells.shape)
    low_right, low_left, high_right, high_left = cv2.integral(cells.view(np.uint8)).take(corners)
    counts = low_right - low_left - high_right + high_left
    parts: Picture = (255 * counts // areas).astype(np.uint8)
    return parts


@lru_cache(maxsize=64)
def _corners(rows: int, columns: int) -> tuple[NDArray[np.int64], NDArray[np.int32]]:
    """(4, 48, 48) places of the corners of patches in a flat sum over cells; (48, 48) areas."""
    top, bottom = _patches(rows)
    left, right = _patches(columns)
    ends = (bottom, right), (bottom, left), (top, right), (top, left)
    places = np.stack([np.add.outer(row * (columns + 1), column) for row, column in ends])
    return places, np.multiply.outer(bottom - top, right - left).astype(np.int32)


def _patches(length: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Where patches of rows or columns begin and end; in small maps some are the same."""
    edges = -(-np.arange(WHOLE + 1) * length // WHOLE)
    firsts = np.minimum(edges[:-1], length - 1)
    return firsts, np.maximum(edges[1:], firsts + 1)
