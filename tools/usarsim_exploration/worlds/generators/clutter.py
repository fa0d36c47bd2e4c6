"""What stands about: desks and rubble, never so near to one another that no robot gets between."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.worlds.generators.shape import PASSABLE

_DENSE = 0.02
"""Pieces per cell of floor that are tried at the most."""
_CORNERS = 7
Piece = NDArray[np.uint8]


def scatter(
    walls: NDArray[np.uint8],
    where: NDArray[np.bool_],
    clutter: float,
    random: np.random.Generator,
    *,
    rubble: bool = False,
) -> None:
    """Add pieces to the walls.

    Args:
        walls: changed.
        where: cells on which something may stand.
        clutter: 0 to 1, how many pieces.
        random: of the generator.
        rubble: heaps with corners, else boxes.
    """
    cells = np.flatnonzero(where)
    busy = _grown(walls)
    for _ in range(int(clutter * _DENSE * len(cells))):
        row, column = divmod(int(cells[int(random.integers(len(cells)))]), walls.shape[1])
        width, height = random.integers(4, 18 if rubble else 13, 2).tolist()
        top, left = row - height // 2, column - width // 2
        margin = PASSABLE + 1
        part = (
            slice(max(top - margin, 0), top + height + margin),
            slice(max(left - margin, 0), left + width + margin),
        )
        piece: Piece = np.zeros(walls[part].shape, np.uint8)
        corner = (left - part[1].start, top - part[0].start)
        if rubble:
            turns = (np.arange(_CORNERS) + random.random(_CORNERS)) * (2 * np.pi / _CORNERS)
            reach = 0.5 + 0.5 * random.random(_CORNERS)
            x = corner[0] + width / 2 * (1 + reach * np.cos(turns))
            y = corner[1] + height / 2 * (1 + reach * np.sin(turns))
            cv2.fillPoly(piece, [np.stack([x, y], axis=1).astype(np.int32)], 1)
        else:
            piece[corner[1] : corner[1] + height, corner[0] : corner[0] + width] = 1
        if (piece & busy[part]).any():
            continue
        walls[part] |= piece
        busy[part] |= _grown(piece)


def _grown(cells: Piece) -> Piece:
    """With all that is too near to them."""
    square = np.ones((2 * PASSABLE + 1, 2 * PASSABLE + 1), np.uint8)
    return np.asarray(cv2.dilate(cells, square), np.uint8)
