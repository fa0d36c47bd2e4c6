"""Areas of the floor: polygons as corners (x, y) in m, in either sense of rotation."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import Limits
from usarsim_server.base.tables import Table, finite
from usarsim_server.simulation.frames import Array

Corner = tuple[float, float]
Polygon = Sequence[Corner]

MOST_CORNERS = 200
TOUCH = 1e-3
"""m by which areas may overlap and still count as side by side."""


def read_corners(table: Table, key: str, least: int = 3) -> tuple[Corner, ...]:
    """The places under a key, written as a list of [x, y].

    Raises:
        UsarsimError: of the table, if it is no list of so many or more.
    """
    rows = table.raw(key)
    if not isinstance(rows, list) or not least <= len(rows) <= MOST_CORNERS:
        example = "[[0, 0], [4, 0], [4, 3]]" if least > 2 else "[[0, 0], [4, 0]]"
        raise table.wrong(key, rows, f"a list of {least} corners or more such as {example}")
    corners = []
    for row in rows:
        if not isinstance(row, list) or len(row) != 2 or any(finite(one) is None for one in row):
            raise table.wrong(key, row, "a corner such as [1.0, 2.0]")
        x, y = (table.check_number(key, one, Limits()) for one in row)
        corners.append((x, y))
    return tuple(corners)


def read_polygon(table: Table, key: str) -> tuple[Corner, ...]:
    """The polygon under a key.

    Raises:
        UsarsimError: of the table, if it is none, crosses itself or has no area.
    """
    corners = read_corners(table, key)
    crossing = _self_crossing(corners)
    if crossing is not None:
        one, other = crossing
        problem = f"the side from corner {one + 1} meets the side from corner {other + 1}"
        raise table.error(key, problem, "write the corners in the order of a walk round the area")
    if abs(area(corners)) < TOUCH:
        raise table.error(key, "has no area", "write corners that are not all on one line")
    return corners


def area(polygon: Polygon) -> float:
    """m2; positive if the corners go anticlockwise."""
    x, y = np.asarray(polygon, dtype=float).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2.0)


def contains(polygon: Polygon, points: Array) -> NDArray[np.bool_]:
    """Which of the points (n, 2) lie inside, by the number of sides that a ray to +x crosses.

    A point on the border belongs to one of two areas that share the border, never to both.
    """
    corners = np.asarray(polygon, dtype=float)
    x, y = points[:, 0], points[:, 1]
    inside = np.zeros(len(points), dtype=bool)
    for (ax, ay), (bx, by) in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        spans = (ay > y) != (by > y)
        if spans.any():
            inside ^= spans & (x < ax + (y - ay) / (by - ay if by != ay else 1.0) * (bx - ax))
    return inside


def overlap(one: Polygon, other: Polygon) -> bool:
    """Whether two areas share more than a border (`TOUCH`)."""
    mine, theirs = _triangles(one), _triangles(other)
    return any(_meet(a, b) for a in mine for b in theirs)


def sides(polygon: Polygon) -> list[tuple[Corner, Corner]]:
    """From corner to corner, the area to the left of each."""
    corners = list(polygon) if area(polygon) > 0.0 else list(reversed(polygon))
    return list(zip(corners, corners[1:] + corners[:1], strict=True))


def _triangles(polygon: Polygon) -> Array:
    """(n, 3, 2) that fill the area."""
    corners = np.asarray(polygon, dtype=np.float64)
    ends = np.array([len(corners)], dtype=np.uint32)
    picked = mapbox_earcut.triangulate_float64(corners, ends)
    answer: Array = corners[np.asarray(picked).reshape(-1, 3)]
    return answer


def _meet(one: Array, other: Array) -> bool:
    """Whether two triangles overlap: no side of either has them on its two sides."""
    for triangle in (one, other):
        edges = np.roll(triangle, -1, axis=0) - triangle
        for dx, dy in edges:
            normal = np.array([dy, -dx]) / max(np.hypot(dx, dy), 1e-12)
            mine, theirs = one @ normal, other @ normal
            if mine.max() < theirs.min() + TOUCH or theirs.max() < mine.min() + TOUCH:
                return False
    return True


def _self_crossing(corners: Polygon) -> tuple[int, int] | None:
    """The numbers of two sides that meet although they are not neighbours."""
    count = len(corners)
    pairs = list(zip(corners, [*corners[1:], corners[0]], strict=True))
    for one, other in itertools.combinations(range(count), 2):
        neighbours = other - one == 1 or (one == 0 and other == count - 1)
        if not neighbours and _cross(*pairs[one], *pairs[other]):
            return one, other
    return None


def _cross(a: Corner, b: Corner, c: Corner, d: Corner) -> bool:
    def side(p: Corner, q: Corner, r: Corner) -> float:
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return (
        side(a, b, c) * side(a, b, d) <= 0.0
        and side(c, d, a) * side(c, d, b) <= 0.0
        and (
            max(a[0], b[0]) >= min(c[0], d[0])
            and max(c[0], d[0]) >= min(a[0], b[0])
            and max(a[1], b[1]) >= min(c[1], d[1])
            and max(c[1], d[1]) >= min(a[1], b[1])
        )
    )
