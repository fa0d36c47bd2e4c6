"""How MRESim's robots see frontiers and when they plan, for runs by its rules.

Its frontiers are all that is not certain yet, not only the edge of the unknown, and robots drive to
their middles, which jump whenever an outline changes; who hears anybody plans anew at every step
(exploration reference 7 and 8). So teams shuttle while they are in contact.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.frontiers import AROUND, SMALLEST, Frontier, near
from usarsim_exploration.known_map import FREE, KNOWN, SAFE, WALL, KnownMap

FIRST = 3
"""Random steps at the start."""
NEVER_DONE = 100
"""Steps before which no robot takes its mission for complete."""
DONE = 0.95
"""Part of all free cells that a robot has to know for that."""
_DRAWN = 1_170_105_035
"""Number, counted around, of the vertex that stands for a middle that an outline does not hold."""


def find_frontiers(known: KnownMap) -> list[Frontier]:
    """Outlines of free space that is not certain or beside the unknown, holes as well.

    Of those that touch the unknown; the largest first, equal ones from top left.
    """
    bits = known.bits
    free = bits & (FREE | WALL) == FREE
    beside = near(bits & KNOWN == 0, AROUND)
    mask = free & (beside | (bits & SAFE == 0))
    outlines, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    found = []
    for traced in outlines:
        cells = traced[:, 0, :].astype(np.int64)
        touching = beside[cells[:, 1], cells[:, 0]]
        if not touching.any():
            continue
        size = float(cv2.contourArea(traced) + (len(cells) if len(cells) > 1 else 0))
        if size >= SMALLEST:
            found.append(Frontier(_middle(traced, cells, size), size, cells, cells[touching]))
    return sorted(found, key=lambda one: (-one.size, one.centre[1], one.centre[0]))


def _middle(traced: NDArray[np.int32], cells: NDArray[np.int64], size: float) -> Cell:
    """The centroid, too near to the origin as `size` counts the outline; if outside, a vertex."""
    moments = cv2.moments(traced)
    column, row = int(moments["m10"] / size), int(moments["m01"] / size)
    if cv2.pointPolygonTest(traced, (column, row), False) <= 0:
        column, row = cells[_DRAWN % len(cells)].tolist()
    return column, row
