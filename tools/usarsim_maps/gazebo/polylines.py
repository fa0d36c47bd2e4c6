"""Polylines of SDF: outlines in the ground plane that are extruded upwards, with holes.

Several polylines in one geometry are nested by which of them lies in which, whatever their order:
what is inside an outline is a hole, what is inside a hole is solid again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from usarsim_maps.meshes.polygons import triangulate_one
from usarsim_maps.scene import Array, Integers, Mask, Mesh

MAX_NESTED = 500
"""Outlines whose nesting is looked at: each is compared with each."""

MAX_HULLS = 1_000
"""Convex pieces of one shape; of more the builder makes its own."""

BENT = 1e-9
"""m^2: an inward corner of less area is straight."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """One polyline."""

    points: Array  # (n, 2)
    height: float

    @property
    def area(self) -> float:
        """Signed: positive if the points run counter-clockwise."""
        x, y = self.points.T
        return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum() / 2.0)


def extruded(outlines: Sequence[Outline]) -> Mesh | None:
    """A mesh of all outlines, with convex pieces to collide; None if they enclose nothing."""
    sound = [found for outline in outlines if (found := _cleaned(outline)) is not None]
    points: list[Array] = []
    faces: list[Integers] = []
    hulls: list[Array] = []
    count = 0
    for outer, holes in _nested(sound):
        rings = [_turned(outer.points, 1.0), *(_turned(hole.points, -1.0) for hole in holes)]
        flat = np.concatenate(rings)
        high = np.full(len(flat), outer.height)
        low = np.column_stack([flat, np.zeros(len(flat))])
        top = np.column_stack([flat, high])
        cover = triangulate_one(top[: len(rings[0])], _split(top, rings)[1:])
        if not len(cover):
            continue
        size = len(flat)
        sides = [_walls(first, len(ring), size) for first, ring in _numbered(rings)]
        faces += [np.concatenate([cover + size, cover[:, ::-1], *sides]) + count]
        points += [low, top]
        for corners in _convex(flat, cover):
            hulls.append(np.concatenate([low[corners], top[corners]]))
        count += 2 * size
    if not faces:
        return None
    return Mesh(
        "polyline",
        np.concatenate(points),
        np.concatenate(faces).astype(np.int32),
        hulls=tuple(hulls) if len(hulls) <= MAX_HULLS else (),
    )


def _cleaned(outline: Outline) -> Outline | None:
    """Without points that repeat the one before; None if nothing is enclosed."""
    points = outline.points
    apart = np.abs(points - np.roll(points, 1, axis=0)).max(axis=1) > 0.0
    cleaned = Outline(points[apart], outline.height)
    return cleaned if len(cleaned.points) >= 3 and cleaned.area != 0.0 else None


def _nested(outlines: list[Outline]) -> list[tuple[Outline, list[Outline]]]:
    """Outlines of what is solid, each with the holes in it."""
    if len(outlines) > MAX_NESTED:
        return [(outline, []) for outline in outlines]
    ordered = sorted(outlines, key=lambda outline: -abs(outline.area))
    parents: list[int | None] = []
    depths: list[int] = []
    kept: list[Outline] = []
    for outline in ordered:
        if any(_is_same(outline, other) for other in kept):
            continue
        around = [k for k, other in enumerate(kept) if _is_inside(outline, other)]
        # The smallest of those around it is the last one.
        parents.append(around[-1] if around else None)
        depths.append(len(around))
        kept.append(outline)
    solid = {k: (kept[k], list[Outline]()) for k in range(len(kept)) if depths[k] % 2 == 0}
    for k, parent in enumerate(parents):
        if depths[k] % 2 and parent in solid:
            solid[parent][1].append(kept[k])
    return list(solid.values())


def _is_same(one: Outline, other: Outline) -> bool:
    return one.points.shape == other.points.shape and bool((one.points == other.points).all())


def _is_inside(inner: Outline, outer: Outline) -> bool:
    """Whether most corners and middles of sides of an outline lie in another one."""
    points, ring = inner.points, outer.points
    apart = (points.max(axis=0) <= ring.min(axis=0)) | (points.min(axis=0) >= ring.max(axis=0))
    if apart.any():
        return False
    middles = (points + np.roll(points, -1, axis=0)) / 2.0
    return bool(_within(np.concatenate([points, middles]), ring).mean() > 0.5)


def _within(points: Array, ring: Array) -> Mask:
    """Which points (n, 2) lie in a ring (m, 2): a ray along x crosses it an odd number of times."""
    x0, y0 = ring.T
    x1, y1 = np.roll(ring, -1, axis=0).T
    slope = (x1 - x0) / np.where(y1 == y0, 1.0, y1 - y0)
    inside = []
    for block in np.array_split(points, len(points) * len(ring) // 1_000_000 + 1):
        x, y = block[:, :1], block[:, 1:]
        crossed = ((y0 > y) != (y1 > y)) & (x < x0 + (y - y0) * slope)
        inside.append(crossed.sum(axis=1) % 2 == 1)
    return np.concatenate(inside)


def _turned(points: Array, sign: float) -> Array:
    """The ring so that its area has a sign."""
    return points if Outline(points, 0.0).area * sign > 0.0 else points[::-1]


def _numbered(rings: Sequence[Array]) -> list[tuple[int, Array]]:
    """Rings with the number of their first point."""
    starts = np.cumsum([0, *(len(ring) for ring in rings)])
    return list(zip(starts.tolist(), rings, strict=False))


def _split(points: Array, rings: Sequence[Array]) -> list[Array]:
    return [points[first : first + len(ring)] for first, ring in _numbered(rings)]


def _walls(first: int, count: int, above: int) -> Integers:
    """Triangles of the sides over a ring whose solid is on its left; the top is `above` later."""
    here = first + np.arange(count)
    after = first + (np.arange(count) + 1) % count
    return np.concatenate(
        [
            np.column_stack([here, after, after + above]),
            np.column_stack([here, after + above, here + above]),
        ]
    )


def _convex(flat: Array, triangles: Integers) -> list[list[int]]:
    """Convex polygons, as numbers of corners, that cover the same plane as triangles.

    Triangles grow over shared edges while they stay convex (Hertel and Mehlhorn).
    """
    if len(triangles) > 4 * MAX_HULLS:
        return [corners.tolist() for corners in triangles]
    pieces: dict[int, list[int]] = dict(enumerate(triangles.tolist()))
    owner: dict[tuple[int, int], int] = {
        (ring[k - 1], ring[k]): number for number, ring in pieces.items() for k in range(3)
    }
    for a, b in [edge for edge in owner if edge[0] < edge[1] and edge[::-1] in owner]:
        one, other = owner[a, b], owner[b, a]
        if one == other:
            continue
        left, right = pieces[one], pieces[other]
        start, back = left.index(b), right.index(a)
        # Around the left piece from b to a, then around the right one from behind a to before b.
        ring = left[start:] + left[:start] + (right[back:] + right[:back])[1:-1]
        if not _is_convex(flat[ring]):
            continue
        pieces[one] = ring
        del pieces[other]
        del owner[a, b], owner[b, a]
        for k in range(len(ring)):
            owner[ring[k - 1], ring[k]] = one
    return list(pieces.values())


def _is_convex(ring: Array) -> bool:
    after = np.roll(ring, -1, axis=0) - ring
    before = np.roll(after, 1, axis=0)
    turn = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    return bool((turn >= -BENT).all())
