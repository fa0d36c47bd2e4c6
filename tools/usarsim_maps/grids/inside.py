"""Which free cells of a map lie within its walls."""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

Mask: TypeAlias = NDArray[np.bool_]

TRIM = 0.01
"""Part of the cells that are not free that may lie beyond each side of the building: specks."""

SHARE = 0.25
"""An inside has at least this part of the free cells between the building's sides."""


def inside(free: Mask) -> Mask:
    """The free cells within walls, or all free ones of a map that has no inside.

    A cell is inside if a straight way to the left, to the right, up and down each ends at a cell
    that is not free before the map ends. So doors and windows may be open. A map has an inside if
    these cells are a good part of what lies between its outermost walls; trees in a field and a
    shed among them are no building.

    Args:
        free: (rows, columns) cells that are free; all others stop a way.
    """
    blocked = ~free
    within = free.copy()
    for axis in (0, 1):
        within &= np.logical_or.accumulate(blocked, axis=axis)
        within &= np.flip(np.logical_or.accumulate(np.flip(blocked, axis), axis=axis), axis)
    if np.array_equal(within, free) or not within.any():
        return free
    rows, columns = (_sides(places) for places in np.nonzero(blocked))
    between = int(np.count_nonzero(free[rows, columns]))
    return within if int(np.count_nonzero(within)) >= SHARE * between else free


def _sides(places: NDArray[np.int64]) -> slice:
    """From the first to the last place, some of the outermost left out."""
    first, last = np.quantile(places, [TRIM, 1.0 - TRIM])
    return slice(int(first), int(last) + 1)


def largest_part(cells: Mask, wanted: Mask | None = None) -> Mask:
    """The part of cells that touch at their sides with the most wanted ones; by default, of all.

    Of equal parts it is the first from the top left. Without any wanted cell, nothing is set.
    """
    count, labels = cv2.connectedComponents(cells.astype(np.uint8), connectivity=4)
    sizes = np.bincount(labels[cells if wanted is None else cells & wanted], minlength=count)
    sizes[0] = 0
    return np.asarray((labels == int(np.argmax(sizes))) & bool(sizes.any()))
