"""Mask into walls: few rectangles that cover all occupied cells, and free places to start from."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from usarsim_maps.geometry import CORNERS, QUADS
from usarsim_maps.scene import Mask, Mesh

COARSE = 300
"""Mask along the longer side of the grid on which free places are looked for."""


@dataclass(frozen=True, slots=True)
class Rectangle:
    """Mask `left` to `right` and `low` to `high`, ends not included; row 0 is at the lowest y."""

    left: int
    low: int
    right: int
    high: int


def rectangles(cells: Mask) -> list[Rectangle]:
    """Rectangles that cover exactly the set cells and do not overlap.

    Runs of cells that are alike in neighbouring rows are joined, along x or along y, whichever
    gives fewer rectangles.
    """
    along = _stacked(cells)
    across = [Rectangle(r.low, r.left, r.high, r.right) for r in _stacked(cells.T)]
    return along if len(along) <= len(across) else across


def _stacked(cells: Mask) -> list[Rectangle]:
    rows, columns = cells.shape
    padded = np.zeros((rows, columns + 2), dtype=np.int8)
    padded[:, 1:-1] = cells
    steps = np.diff(padded, axis=1)
    row, start = np.nonzero(steps == 1)
    _, end = np.nonzero(steps == -1)
    bounds = np.searchsorted(row, np.arange(rows + 1))
    finished: list[Rectangle] = []
    growing: dict[tuple[int, int], int] = {}
    for number in range(rows):
        here = range(bounds[number], bounds[number + 1])
        runs = {(int(start[k]), int(end[k])) for k in here}
        for run in [run for run in growing if run not in runs]:
            finished.append(Rectangle(run[0], growing.pop(run), run[1], number))
        for run in runs:
            growing.setdefault(run, number)
    finished += [Rectangle(run[0], low, run[1], rows) for run, low in growing.items()]
    return sorted(finished, key=lambda r: (r.low, r.left))


def pooled(cells: Mask) -> Mask:
    """Mask of twice the size; one is set if any of its four is."""
    rows, columns = (size + size % 2 for size in cells.shape)
    even = np.zeros((rows, columns), dtype=bool)
    even[: cells.shape[0], : cells.shape[1]] = cells
    return np.asarray(even.reshape(rows // 2, 2, columns // 2, 2).any(axis=(1, 3)))


def wall_mesh(walls: list[Rectangle], size: float, height: float, material: str) -> Mesh:
    """All walls as one mesh from z = 0 to a height, m, with a box to collide with for each.

    Mask have a size, m.
    """
    table = np.array([(w.left, w.low, w.right, w.high) for w in walls], dtype=float) * size
    low = np.column_stack([table[:, 0], table[:, 1], np.zeros(len(walls))])
    high = np.column_stack([table[:, 2], table[:, 3], np.full(len(walls), height)])
    corners = np.where(CORNERS > 0.0, high[:, None], low[:, None])
    # Nobody sees what a wall stands on.
    faces = np.array([t for a, b, c, d in QUADS[1:] for t in ((a, b, c), (a, c, d))])
    triangles = (faces[None] + 8 * np.arange(len(walls))[:, None, None]).reshape(-1, 3)
    return Mesh(
        name="walls",
        vertices=corners.reshape(-1, 3),
        triangles=triangles.astype(np.int32),
        materials=(material,),
        hulls=tuple(corners),
    )


def free_places(
    free: Mask, size: float, wanted: tuple[float, float] | None, room: float, count: int
) -> list[tuple[float, float]]:
    """Places in the largest connected region of free cells of a size, m, so many at most.

    They are far apart, have `room` m around them, and the first is near the wanted one: x, y in m
    from the grid's lower left corner, or the middle of the region.
    """
    block = max(1, -(-max(free.shape) // COARSE))
    rows, columns = free.shape[0] // block, free.shape[1] // block
    if not rows or not columns:
        return []
    coarse = free[: rows * block, : columns * block]
    coarse = np.asarray(coarse.reshape(rows, block, columns, block).all(axis=(1, 3)))
    step = size * block
    region = _largest(_eroded(coarse, int(np.ceil(room / step))))
    places = (np.argwhere(region)[:, ::-1] + 0.5) * step
    if not len(places):
        return []
    target = places.mean(axis=0) if wanted is None else np.array(wanted)
    away = np.hypot(*(places - target).T)
    chosen = [int(np.argmin(away))]
    away = np.hypot(*(places - places[chosen[0]]).T)
    while len(chosen) < count:
        far = int(np.argmax(away))
        if away[far] < 2.0 * room:
            break
        chosen.append(far)
        away = np.minimum(away, np.hypot(*(places - places[far]).T))
    return [(float(x), float(y)) for x, y in places[chosen]]


def _eroded(cells: Mask, margin: int) -> Mask:
    """Mask whose whole square of so many cells around is set; beyond the edge nothing is."""
    rows, columns = cells.shape
    total = np.zeros((rows + 1, columns + 1), dtype=np.int64)
    total[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    answer = np.zeros_like(cells)
    side = 2 * margin + 1
    if side > rows or side > columns:
        return answer
    sums = total[side:, side:] - total[:-side, side:] - total[side:, :-side] + total[:-side, :-side]
    answer[margin : rows - margin, margin : columns - margin] = sums == side * side
    return answer


def _largest(cells: Mask) -> Mask:
    """The largest region of cells that touch at their sides."""
    left = cells.copy()
    best: list[tuple[int, int]] = []
    rows, columns = cells.shape
    for row, column in np.argwhere(cells).tolist():
        if not left[row, column]:
            continue
        left[row, column] = False
        region, todo = [(row, column)], deque([(row, column)])
        while todo:
            r, c = todo.popleft()
            for y, x in ((r + 1, c), (r - 1, c), (r, c + 1), (r, c - 1)):
                if 0 <= y < rows and 0 <= x < columns and left[y, x]:
                    left[y, x] = False
                    region.append((y, x))
                    todo.append((y, x))
        if len(region) > len(best):
            best = region
    answer = np.zeros_like(cells)
    if best:
        y, x = np.array(best).T
        answer[y, x] = True
    return answer
