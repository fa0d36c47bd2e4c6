"""Polygons into triangles: fans for convex ones, ear clipping for the rest, holes bridged."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Flat: TypeAlias = Sequence[tuple[float, float]]

MAX_CORNERS = 1_000
"""Polygons with more corners become fans: clipping ears takes the square of their number."""

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
        steps = np.arange(1, size - 1)
        fan = np.stack([np.zeros_like(steps), steps, steps + 1], axis=1)
        triangles.append(corners[fans][:, fan].reshape(-1, 3))
        owners.append(np.repeat(chosen[fans], size - 2))
        for polygon, ring in zip(chosen[~fans].tolist(), corners[~fans], strict=True):
            found = np.array(clip_ears(points[ring]), dtype=np.int64).reshape(-1, 3)
            triangles.append(ring[found])
            owners.append(np.full(len(found), polygon))
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(triangles)[order], owner[order]


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


def clip_ears(outline: Array, holes: Sequence[Array] = ()) -> list[tuple[int, int, int]]:
    """Triangles of one polygon.

    Args:
        outline: (n, 3).
        holes: (m, 3) each, inside the outline.

    Returns:
        Numbers of corners: those of the outline, then of each hole in turn.
    """
    points = np.concatenate([outline, *holes])
    count = len(outline)
    if not (np.abs(points) < FAR).all() or count < 3:
        return []
    flat = _flat(points, outline)
    ring = list(range(count))
    if _area(flat, ring) < 0.0:
        ring.reverse()
        turned = True
    else:
        turned = False
    start = count
    rings = []
    for hole in holes:
        inner = list(range(start, start + len(hole)))
        start += len(hole)
        if len(inner) >= 3:
            rings.append(inner if _area(flat, inner) < 0.0 else inner[::-1])
    for inner in sorted(rings, key=lambda r: -max(flat[i][0] for i in r)):
        ring = _bridged(flat, ring, inner)
    if len(ring) > MAX_CORNERS:
        found = [(ring[0], ring[k], ring[k + 1]) for k in range(1, len(ring) - 1)]
    else:
        found = _clip(flat, ring)
    return [(c, b, a) for a, b, c in found] if turned else found


def _flat(points: Array, outline: Array) -> list[tuple[float, float]]:
    """Coordinates in the plane of the outline, as plain numbers; its normal looks at us."""
    around = np.roll(outline, -1, axis=0)
    normal = np.cross(outline - outline[0], around - outline[0]).sum(axis=0)
    axis = int(np.argmax(np.abs(normal)))
    one, other = ((1, 2), (2, 0), (0, 1))[axis]
    sign = -1.0 if normal[axis] < 0.0 else 1.0
    return [(float(p[one]) * sign, float(p[other])) for p in points]


def _area(flat: Flat, ring: Sequence[int]) -> float:
    return sum(
        flat[a][0] * flat[b][1] - flat[b][0] * flat[a][1]
        for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)
    )


def _bridged(flat: Flat, ring: list[int], hole: list[int]) -> list[int]:
    """One ring out of an outline and a hole, along the shortest way that nothing crosses."""
    first = max(range(len(hole)), key=lambda i: flat[hole[i]])
    px, py = flat[hole[first]]
    edges = [*zip(ring, [*ring[1:], ring[0]], strict=True)]
    edges += zip(hole, [*hole[1:], hole[0]], strict=True)
    order = sorted(
        range(len(ring)), key=lambda i: (flat[ring[i]][0] - px) ** 2 + (flat[ring[i]][1] - py) ** 2
    )
    best = order[0]
    for place in order:
        q = flat[ring[place]]
        if not any(_cross((px, py), q, flat[a], flat[b]) for a, b in edges):
            best = place
            break
    around = hole[first:] + hole[:first]
    return [*ring[: best + 1], *around, around[0], *ring[best:]]


def _cross(
    p: tuple[float, float], q: tuple[float, float], a: tuple[float, float], b: tuple[float, float]
) -> bool:
    """Whether two segments cross properly; common ends do not count."""
    return (_turn(p, q, a) > 0.0) != (_turn(p, q, b) > 0.0) and (
        (_turn(a, b, p) > 0.0) != (_turn(a, b, q) > 0.0)
        if a not in (p, q) and b not in (p, q)
        else False
    )


def _turn(p: tuple[float, float], q: tuple[float, float], r: tuple[float, float]) -> float:
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def _clip(flat: Flat, ring: list[int]) -> list[tuple[int, int, int]]:
    ring = list(ring)
    found = []
    place = misses = 0
    while len(ring) > 3:
        size = len(ring)
        a, b, c = ring[place - 1], ring[place], ring[(place + 1) % size]
        # After a round without an ear a straight corner goes, or any, so that there is an end.
        straight = misses >= size and _turn(flat[a], flat[b], flat[c]) == 0.0
        if straight or misses >= 2 * size or _is_ear(flat, ring, a, b, c):
            found.append((a, b, c))
            del ring[place]
            place = (place - 1) % len(ring) if place else 0
            misses = 0
        else:
            place = (place + 1) % size
            misses += 1
    found.append((ring[0], ring[1], ring[2]))
    return found


def _is_ear(flat: Flat, ring: Sequence[int], a: int, b: int, c: int) -> bool:
    p, q, r = flat[a], flat[b], flat[c]
    if _turn(p, q, r) <= 0.0:
        return False
    for other in ring:
        s = flat[other]
        if s in (p, q, r):
            continue
        if _turn(p, q, s) >= 0.0 and _turn(q, r, s) >= 0.0 and _turn(r, p, s) >= 0.0:
            return False
    return True
