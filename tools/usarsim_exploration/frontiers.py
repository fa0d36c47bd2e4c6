"""Frontiers: outlines of known free space behind which the unknown begins.

A cell is of a frontier if it is free and beside an unknown one (Yamauchi, "A frontier-based
approach for autonomous exploration", CIRA 1997); connected ones are one frontier. MRESim takes
cells that are not yet certain as well, and counts outlines that touch unknown space (exploration
reference 7): robots then visit what they saw from afar. In an office of 505 x 304 cells four of
them know 90 % after 185 steps by the first rule and 195 by the second, means of five starts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.known_map import FREE, KNOWN, SAFE, WALL, KnownMap

if TYPE_CHECKING:
    from usarsim_exploration.strategy import View

SMALLEST = 3.0
"""Size below which a frontier is left alone (exploration 2)."""
WIDEST = 3
"""Cells of a passage that may have no frontier of that size."""
AROUND = np.ones((3, 3), np.uint8)
_BY_THE_WALL = np.ones((5, 5), np.uint8)
_BESIDE = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Frontier:
    """One frontier.

    Attributes:
        centre: a cell of it, the nearest to the centroid of its outline.
        size: area of the outline and length of it (each edge by its longer side), cells.
        outline: (n, 2) cells.
        openings: (m, 2) those cells of the outline that touch unknown space.
    """

    centre: Cell
    size: float
    outline: NDArray[np.int64]
    openings: NDArray[np.int64]


def find_frontiers(
    known: KnownMap,
    smallest: float = SMALLEST,
    *,
    uncertain: bool = False,
    across: float = math.inf,
) -> list[Frontier]:
    """All frontiers of a map, the largest first; equal ones from top left.

    Args:
        known: what a robot knows.
        smallest: size below which one is left out.
        uncertain: cells that are not yet certain are of frontiers as well (MRESim).
        across: cells that a robot sees of one; those that are wider are parted, for the middle of
            one that goes around a robot jumps from side to side.
    """
    bits = known.bits
    free = bits & (FREE | WALL) == FREE
    beside = near(bits & KNOWN == 0, AROUND)
    mask = free & (beside | (bits & SAFE == 0)) if uncertain else free & beside
    return _traced(mask, beside, smallest, across)


def frontiers_of(view: View, *, uncertain: bool = False) -> list[Frontier]:
    """Those of a robot's map, as small and as wide as its scanner and its scale say."""
    smallest = SMALLEST * view.scale
    return find_frontiers(view.known, smallest, uncertain=uncertain, across=view.across)


def passages(known: KnownMap) -> list[Frontier]:
    """Frontiers of any size in passages of three cells or fewer, as `find_frontiers` has them.

    A robot may drive straight on from there into what is unknown, or taken for a wall only because
    it is behind one: in passages that is often the next bend.
    """
    bits = known.bits
    free = bits & (FREE | WALL) == FREE
    square = np.ones((WIDEST + 1, WIDEST + 1), np.uint8)
    wide = np.asarray(cv2.morphologyEx(free.view(np.uint8), cv2.MORPH_OPEN, square), np.uint8)
    doubtful = (bits & KNOWN == 0) | (bits & (WALL | SAFE) == WALL)
    mask = free & near(doubtful, _BESIDE) & ~near(wide != 0, _BY_THE_WALL)
    return _traced(mask, mask, 0.0)


def leftovers(known: KnownMap) -> list[Frontier]:
    """Frontiers of any size, anywhere, from where a robot may drive straight into the unknown."""
    bits = known.bits
    mask = (bits & (FREE | WALL) == FREE) & near(bits & KNOWN == 0, _BESIDE)
    return _traced(mask, mask, 0.0)


def near(cells: NDArray[np.bool_], shape: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """What is within a shape around cells."""
    wide = cv2.dilate(cells.view(np.uint8), shape, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(wide, np.uint8).view(np.bool_)


def _traced(
    mask: NDArray[np.bool_], beside: NDArray[np.bool_], smallest: float, across: float = math.inf
) -> list[Frontier]:
    """Frontiers of the cells of a mask; `beside` are those that touch the unknown."""
    outlines: Any
    outlines, _ = cv2.findContours(mask.view(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    kept, sizes = list[NDArray[np.int32]](), list[float]()
    for traced in outlines:
        length = len(traced) if len(traced) > 1 else 0  # each edge leads to a neighbour
        size = float(cv2.contourArea(traced) + length)
        if size < smallest:
            continue
        parts = _parted(traced, across)
        kept += parts
        if len(parts) > 1:  # each as if it were a line of its own
            sizes += [max(2.0 * (len(part) - 1), smallest) for part in parts]
        else:
            sizes.append(max(size, 1.0))
    if not kept:
        return []
    cells = np.concatenate(kept)[:, 0, :].astype(np.int64)  # of all at once: there may be many
    columns, rows = cells.T.astype(np.float64)
    touching, found, begin = beside[cells[:, 1], cells[:, 0]], [], 0
    for traced, size in zip(kept, sizes, strict=True):
        end = begin + len(traced)
        part, begin = slice(begin, end), end
        openings = cells[part][touching[part]]
        if len(openings):
            column, row = cells[part][_central(traced, columns[part], rows[part])].tolist()
            found.append(Frontier((column, row), size, cells[part], openings))
    return sorted(found, key=lambda one: (-one.size, one.centre[1], one.centre[0]))


def _parted(traced: NDArray[np.int32], across: float) -> list[NDArray[np.int32]]:
    """Pieces of an outline, of neighbours, none wider than `across`; the whole, if it is not."""
    if len(traced) <= across or np.ptp(traced[:, 0], axis=0).max() < across:
        return [traced]
    _, first = np.unique(traced[:, 0], axis=0, return_index=True)
    line = traced[np.sort(first)]  # thin ones were traced there and back
    apart = np.abs(np.diff(line[:, 0], axis=0)).max(axis=1) > 1
    return [
        part
        for run in np.split(line, np.flatnonzero(apart) + 1)
        for part in np.array_split(run, math.ceil(len(run) / across))
    ]


def _central(
    traced: NDArray[np.int32], across: NDArray[np.float64], down: NDArray[np.float64]
) -> int:
    """Which cell of an outline is nearest to its centroid; the first of equally near ones."""
    moments = cv2.moments(traced)
    if moments["m00"] > 0.0:
        x, y = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
    else:
        x, y = across.sum() / len(across), down.sum() / len(down)
    right, below = across - x, down - y
    return int((right * right + below * below).argmin())
