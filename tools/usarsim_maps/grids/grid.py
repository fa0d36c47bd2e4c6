"""Mask into walls: few rectangles that cover all occupied cells, and free places to start from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from usarsim_maps.geometry import CORNERS, QUADS
from usarsim_maps.grids.inside import largest_part
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
    free: Mask,
    allowed: Mask,
    size: float,
    wanted: tuple[float, float] | None,
    room: float,
    count: int,
) -> list[tuple[float, float]]:
    """Allowed places in one connected region of free cells, so many at most.

    The region has more of the allowed places than any other. The places are far apart, have `room`
    m around them, and the first is near the wanted one.

    Args:
        free: cells of a map, row 0 at the lowest y.
        allowed: cells, of the free ones, where places may be.
        size: of a cell, m.
        wanted: x and y in m from the grid's lower left corner; None: the middle of the region.
        room: m that are free around each place.
        count: most places.

    Returns:
        x and y of each place, m from the grid's lower left corner.
    """
    block = max(1, -(-max(free.shape) // COARSE))
    step = size * block
    allowed = _joined(allowed, block)
    roomy = _eroded(_joined(free, block), int(np.ceil(room / step)))
    region = largest_part(roomy, allowed) & allowed
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


def _joined(cells: Mask, block: int) -> Mask:
    """Squares of so many cells along each side; one is set if all of its cells are."""
    rows, columns = cells.shape[0] // block, cells.shape[1] // block
    whole = cells[: rows * block, : columns * block]
    return np.asarray(whole.reshape(rows, block, columns, block).all(axis=(1, 3)))


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
