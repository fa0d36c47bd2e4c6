"""The skeleton of free space, one cell wide, and its cells that matter: junctions, ends, others.

Thinning peels cells off from north, south, west and east in turn, whose removal leaves the
neighbourhood connected (Rosenfeld, "A characterization of parallel thinning algorithms", 1975), so
connected space has a connected skeleton. Neighbourhoods are numbers of 8 bits that one filter makes
and one table judges.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.uint8]
Cells = NDArray[np.int64]
"""(n, 2) columns and rows."""

WIDE = 101
"""Cells with so much free space around in each direction are no part of a skeleton, so that halls
have rings (exploration 9)."""
CLEARANCE = 3.0
APART = 20.0
SPACING = 40.0
"""Cells from walls and from each other, and where along a skeleton further ones come."""

# the neighbours in turn, from the right, downwards; even ones are orthogonal
_RING = ((1, 0), (1, 1), (0, 1), (-1, 1), (-1, 0), (-1, -1), (0, -1), (1, -1))
_WEIGHTS = np.zeros((3, 3), np.float32)
for _bit, (_column, _row) in enumerate(_RING):
    _WEIGHTS[_row + 1, _column + 1] = 1 << _bit
_BITS = (np.arange(256)[:, None] >> np.arange(8)) & 1 != 0
_TRANSITIONS = (~_BITS & np.roll(_BITS, -1, axis=1)).sum(axis=1).astype(np.uint8)
_NEIGHBOURS = _BITS.sum(axis=1).astype(np.uint8)


def _peelable() -> list[Mask]:
    """For each of four sides a table: 1 where a cell with these neighbours may go.

    The cell is at that side of the space, is no end, and its neighbours hang together without it:
    the number of orthogonal gaps that are followed by a neighbour is one (Yokoi's, for 8
    neighbours).
    """
    orthogonal = ~_BITS[:, ::2]
    beyond = ~(_BITS[:, 1::2] | np.roll(_BITS[:, ::2], -1, axis=1))
    simple = (orthogonal.astype(int) - (orthogonal & beyond)).sum(axis=1) == 1
    inner = simple & (_NEIGHBOURS >= 2)
    return [(inner & ~_BITS[:, side]).astype(np.uint8) for side in (6, 2, 4, 0)]


_PEELABLE = _peelable()


def _around(mask: Mask) -> Mask:
    """For each cell the number of its neighbourhood; outside there is nothing."""
    return cv2.filter2D(mask, -1, _WEIGHTS, borderType=cv2.BORDER_CONSTANT).astype(np.uint8)


def _looked_up(around: Mask, table: Mask) -> Mask:
    return cv2.LUT(around, table).astype(np.uint8)


def thin(free: Mask) -> Mask:
    """Peel a mask of 0 and 1 until it is one cell wide; the rest is 0."""
    left, top, width, height = cv2.boundingRect(free)
    found = np.zeros_like(free)
    if not width:
        return found
    part = np.pad(free[top : top + height, left : left + width], 1)
    remaining, before = int(np.count_nonzero(part)), -1
    while remaining != before:
        before = remaining
        for table in _PEELABLE:
            part -= _looked_up(_around(part), table) & part
        remaining = int(np.count_nonzero(part))
    found[top : top + height, left : left + width] = part[1:-1, 1:-1]
    return found


def skeleton(free: Mask, wide: int = WIDE) -> Mask:
    """The skeleton of free space (0 and 1); rings in halls that are wider than `wide` cells."""
    square = np.ones((wide, wide), np.uint8)
    deep = cv2.erode(free, square, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return thin((free & (deep == 0)).astype(np.uint8))


def degrees(bones: Mask) -> Mask:
    """Branches at each cell of a skeleton: 1 an end, 2 a corridor, 3 and more a junction.

    Counted are changes from nothing to something around the cell; 0 where no skeleton is.
    """
    return _looked_up(_around(bones), _TRANSITIONS) * bones


def key_cells(
    bones: Mask,
    walls: NDArray[np.bool_],
    spacing: float = SPACING,
    clearance: float = CLEARANCE,
    apart: float = APART,
) -> Cells:
    """Junctions, ends, and cells of the skeleton that are `spacing` from all before
    (exploration 9).

    Then those go that are nearer than `clearance` to a wall, or nearer than `apart` to one that
    comes before. Junctions come first, then ends, then others, each from the top left.
    """
    many = degrees(bones)
    junctions = (many >= 3) & (_looked_up(_around(bones), _NEIGHBOURS) >= 3)
    ends = (many == 1) & (_looked_up(_around(bones), _NEIGHBOURS) <= 2)
    first = np.concatenate([_cells(junctions), _cells(ends)])
    others = _cells(bones != 0)
    for cell in first:
        others = others[_distances(others, cell) >= spacing]
    spaced = _spread(others, spacing)
    found = np.concatenate([first, spaced])
    room = cv2.distanceTransform((~walls).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return _spread(found[room[found[:, 1], found[:, 0]] >= clearance], apart)


def _spread(cells: Cells, apart: float) -> Cells:
    """Cells in order, without those that are too near to one before."""
    kept = []
    while len(cells):
        kept.append(cells[0])
        cells = cells[_distances(cells, cells[0]) >= apart]
    return np.array(kept, np.int64).reshape(-1, 2)


def _distances(cells: Cells, cell: Cells) -> NDArray[np.float64]:
    found: NDArray[np.float64] = np.hypot(cells[:, 0] - cell[0], cells[:, 1] - cell[1])
    return found


def _cells(mask: NDArray[np.bool_]) -> Cells:
    """Columns and rows of what is set, from the top left."""
    return np.argwhere(mask)[:, ::-1]
