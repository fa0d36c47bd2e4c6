"""Polygons into triangles: fans for convex ones, ear clipping (mapbox_earcut) for the rest."""

from __future__ import annotations

from collections.abc import Sequence

import mapbox_earcut
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

MAX_CORNERS = 10_000
"""Polygons with more corners become fans: one that crosses itself takes the square of them."""

FAR = 1e12
"""Coordinates beyond which no polygon with an inward corner is believed."""

BENT = 1e-6
"""Sine of an inward corner that counts."""


def triangulate(points: Array, sizes: Integers) -> tuple[Integers, Integers]:
    """Triangles of many polygons.

    Args:
        points: (c, 3) corners of all polygons, one after the other.
        sizes: (p,) corners of each; polygons of fewer than three give nothing.

    Returns:
        (t, 3) numbers of corners, and (t,) the polygon that each triangle is of; in order.
    """
    starts = np.cumsum(sizes) - sizes
    triangles = [np.zeros((0, 3), np.int64)]
    owners = [np.zeros(0, np.int64)]
    for size in np.unique(sizes[sizes >= 3]).tolist():
        chosen = np.flatnonzero(sizes == size)
        corners = starts[chosen, None] + np.arange(size)
        fans = np.ones(len(chosen), dtype=bool) if size == 3 else _is_convex(points[corners])
        triangles.append(corners[fans][:, _fan(size)].reshape(-1, 3))
        owners.append(np.repeat(chosen[fans], size - 2))
        for polygon, ring in zip(chosen[~fans].tolist(), corners[~fans], strict=True):
            found = triangulate_one(points[ring])
            triangles.append(ring[found])
            owners.append(np.full(len(found), polygon))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


def triangulate_one(outline: Array, holes: Sequence[Array] = ()) -> Integers:
    """Triangles of one polygon, which look to the same side as its outline.

    Args:
        outline: (n, 3).
        holes: (m, 3) each, inside the outline, in either direction.

    Returns:
        (t, 3) numbers of corners: those of the outline, then of each hole in turn. None where the
        polygon encloses nothing, or a corner is at no place.
    """
    points = np.concatenate([outline, *holes])
    if len(outline) < 3 or not (np.abs(points) < FAR).all():
        return np.zeros((0, 3), np.int64)
    if len(points) > MAX_CORNERS:
        return _fan(len(outline))
    rings = [len(outline), *(len(hole) for hole in holes)]
    numbers = np.arange(len(points))
    # A hole without three corners leaves nothing out.
    numbers = numbers[np.repeat([size >= 3 for size in rings], rings)]
    ends = np.cumsum([size for size in rings if size >= 3], dtype=np.uint32)
    found = mapbox_earcut.triangulate_float64(_flat(points, outline)[numbers], ends)
    answer: Integers = numbers[found].reshape(-1, 3)
    return answer


def _fan(size: int) -> Integers:
    steps = np.arange(1, size - 1)
    return np.stack([np.zeros_like(steps), steps, steps + 1], axis=1)


def _is_convex(corners: Array) -> NDArray[np.bool_]:
    """Whether polygons (g, n, 3) have no inward corner."""
    with np.errstate(all="ignore"):
        before = corners - np.roll(corners, 1, axis=1)
        after = np.roll(before, -1, axis=1)
        normal = np.cross(corners - corners[:, :1], np.roll(corners, -1, axis=1) - corners[:, :1])
        normal = normal.sum(axis=1, keepdims=True)
        turn = (np.cross(before, after) * normal).sum(axis=2)
        size = np.linalg.norm(before, axis=2) * np.linalg.norm(after, axis=2)
        size *= np.linalg.norm(normal, axis=2)
        answer: NDArray[np.bool_] = (turn >= -BENT * size).all(axis=1)
        answer |= ~np.isfinite(size).all(axis=1)
    return answer


def _flat(points: Array, outline: Array) -> Array:
    """Coordinates (n, 2) in the plane of the outline, whose normal looks at us."""
    around = np.roll(outline, -1, axis=0)
    normal = np.cross(outline - outline[0], around - outline[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    flat: Array = points[:, [(1, 2), (2, 0), (0, 1)][axis]]
    flat = flat * (-1.0 if normal[axis] < 0.0 else 1.0, 1.0)
    return np.ascontiguousarray(flat)
