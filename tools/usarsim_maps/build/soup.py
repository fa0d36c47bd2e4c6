"""Triangle soups made tidy: welded, cleaned, split into components, merged into convex polygons.

The merge uses plain Python numbers: for polygons of a few corners that is many times faster than
arrays (worlds reference 9.2).
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_maps.geometry import FARTHEST, LEAST_AREA, normals_areas
from usarsim_maps.scene import Array, Indices

WELD = 1e-5
"""m: vertices nearer than this are one."""

SAME_NORMAL = 1e-3
"""rad between the normals of triangles that count as coplanar."""

SAME_PLANE = 1e-4
"""m between their planes."""

BEND = 1e-7
"""Least sine at a corner: less is straight on."""


@dataclass(frozen=True, slots=True, eq=False)
class Soup:
    """Sound triangles."""

    vertices: Array  # (n, 3), no two at one place
    triangles: Indices  # (m, 3)
    origin: NDArray[np.intp]  # (m,) index of every triangle in the mesh it came from
    dropped: int  # triangles that were degenerate, double or not finite (worlds 60)


def clean(vertices: Array, triangles: Indices) -> Soup:
    """Weld vertices; drop triangles without area, doubles, and those not finite or at no place.

    A double that faces the other way is dropped, too: the rest is a sheet seen from both sides.

    Raises:
        ValueError: a triangle refers to a vertex that is not there.
    """
    count = len(triangles)
    if count and (triangles.min() < 0 or triangles.max() >= len(vertices)):
        raise ValueError(f"a triangle refers to vertex {triangles.max()} of {len(vertices)}")
    sound = np.asarray((np.abs(vertices) < FARTHEST).all(axis=1))
    alive = sound[triangles].all(axis=1)
    origin = np.flatnonzero(alive)
    safe = np.where(sound[:, None], vertices, 0.0)
    keys = np.round(safe / WELD).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    welded = inverse.reshape(-1)[triangles[origin]]
    points = safe[first]
    _, areas = normals_areas(points, welded)
    large = areas > LEAST_AREA
    welded, origin = welded[large], origin[large]
    _, unique = np.unique(np.sort(welded, axis=1), axis=0, return_index=True)
    unique.sort()
    welded, origin = welded[unique], origin[unique]
    return Soup(points, welded.astype(np.int32), origin, count - len(origin))


def components(soup: Soup) -> list[NDArray[np.intp]]:
    """Triangle numbers of every connected component, by shared vertices; in order."""
    parent = np.arange(len(soup.vertices))
    # Labels sink to the smallest in the neighbourhood, with shortcuts; few rounds suffice.
    tri = soup.triangles
    while True:
        least = parent[tri].min(axis=1)
        new = parent.copy()
        for corner in range(3):
            np.minimum.at(new, tri[:, corner], least)
        new = new[new]
        if np.array_equal(new, parent):
            break
        parent = new
    labels = parent[tri[:, 0]] if len(tri) else np.zeros(0, dtype=np.intp)
    _, first, inverse = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    group = rank[inverse.reshape(-1)]
    order = np.argsort(group, kind="stable")
    cuts = np.flatnonzero(np.diff(group[order])) + 1
    return list(np.split(order, cuts)) if len(order) else []


def convex_polygons(soup: Soup) -> list[tuple[int, tuple[int, ...]]]:
    """Merge coplanar neighbours greedily, longest shared edge first, while the result is convex.

    Neighbours agree on which side is outside. Returns one of its triangles, and the vertex numbers
    of each polygon in order around it, collinear corners dropped.
    """
    normals, _ = normals_areas(soup.vertices, soup.triangles)
    triangles = soup.triangles
    points = [tuple(p) for p in soup.vertices.tolist()]
    rings: list[list[int] | None] = [list(t) for t in triangles.tolist()]
    owner = list(range(len(rings)))

    def find(index: int) -> int:
        while owner[index] != index:
            owner[index] = owner[owner[index]]
            index = owner[index]
        return index

    facing = normals.tolist()
    for one, other, a, b in _joints(soup.vertices, triangles, normals):
        p, q = find(one), find(other)
        if p == q:
            continue
        ring, more = rings[p], rings[q]
        assert ring is not None
        assert more is not None
        merged = _join(ring, more, a, b, points, facing[one])
        if merged is not None:
            rings[p], rings[q] = merged, None
            owner[q] = p
    final = []
    for index, left in enumerate(rings):
        if left is not None:
            corners = _corners(left, points, facing[index])
            if len(corners) >= 3:
                final.append((index, tuple(corners)))
    return final


def _joints(vertices: Array, triangles: Indices, normals: Array) -> list[tuple[int, int, int, int]]:
    """Pairs of coplanar triangles with the edge (a to b in the first) they share; longest first."""
    tri = triangles.astype(np.int64)
    count = len(tri)
    starts = tri.reshape(-1)
    ends = tri[:, [1, 2, 0]].reshape(-1)
    faces = np.repeat(np.arange(count), 3)
    by_edge: dict[tuple[int, int], list[int]] = defaultdict(list)
    for edge, (s, e) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
        by_edge[s, e].append(edge)
    pairs = [
        (edge, twin)
        for (s, e), edges in by_edge.items()
        if s < e
        for edge, twin in zip(edges, by_edge.get((e, s), ()), strict=False)
    ]
    if not pairs:
        return []
    first, second = np.array(pairs).T
    one, other = faces[first], faces[second]
    bend = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
    same = (bend < SAME_NORMAL) & (np.einsum("ij,ij->i", normals[one], normals[other]) > 0)
    offsets = np.einsum(
        "ij,ikj->ik", normals[one], vertices[tri[other]] - vertices[tri[one, 0]][:, None]
    )
    same &= np.abs(offsets).max(axis=1) < SAME_PLANE
    first, one, other = first[same], one[same], other[same]
    length = np.linalg.norm(vertices[starts[first]] - vertices[ends[first]], axis=1)
    order = np.argsort(-np.round(length, 6), kind="stable")
    columns = one[order], other[order], starts[first[order]], ends[first[order]]
    return list(zip(*(column.tolist() for column in columns), strict=True))


def _join(
    ring: list[int],
    more: list[int],
    a: int,
    b: int,
    points: Sequence[tuple[float, ...]],
    normal: Sequence[float],
) -> list[int] | None:
    """One ring out of two that share the edge a-b, None if it were not convex."""
    try:
        start, back = ring.index(a), more.index(b)
    except ValueError:
        return None
    n, m = len(ring), len(more)
    if ring[(start + 1) % n] != b or more[(back + 1) % m] != a:
        return None
    # The shared chain may be longer than one edge.
    head, tail = 0, 1
    while tail < n - 1 and ring[(start + tail + 1) % n] == more[(back - tail) % m]:
        tail += 1
    while head < n - 1 and ring[(start - head - 1) % n] == more[(back + 2 + head) % m]:
        head += 1
    shared = head + tail
    if shared >= n or shared >= m:
        return None
    first = [ring[(start + tail + k) % n] for k in range(n - shared)]
    second = [more[(back + 1 + head + k) % m] for k in range(m - shared)]
    merged = first + second
    seam = len(first)
    size = len(merged)
    if size < 3 or len(set(merged)) != size:
        return None
    for corner in (0, seam % size):
        before, after = merged[corner - 1], merged[(corner + 1) % size]
        if _turn(points[before], points[merged[corner]], points[after], normal) < -BEND:
            return None
    return merged


def _turn(
    p: Sequence[float], q: Sequence[float], r: Sequence[float], normal: Sequence[float]
) -> float:
    """Sine of the angle by which the way p-q-r turns left, seen against the normal."""
    ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    bx, by, bz = r[0] - q[0], r[1] - q[1], r[2] - q[2]
    lengths = math.sqrt((ax * ax + ay * ay + az * az) * (bx * bx + by * by + bz * bz))
    if lengths < 1e-18:
        return 0.0
    cross = (
        (ay * bz - az * by) * normal[0]
        + (az * bx - ax * bz) * normal[1]
        + (ax * by - ay * bx) * normal[2]
    )
    return cross / lengths


def _corners(
    ring: list[int], points: Sequence[tuple[float, ...]], normal: Sequence[float]
) -> list[int]:
    """The ring without corners at which it goes straight on."""
    size = len(ring)
    return [
        ring[i]
        for i in range(size)
        if _turn(points[ring[i - 1]], points[ring[i]], points[ring[(i + 1) % size]], normal) > 1e-5
    ]


class Rays:
    """Triangles (n, 3, 3) that rays can meet."""

    def __init__(self, triangles: Array) -> None:
        self._scene = rtcore_scene.EmbreeScene()
        TriangleMesh(self._scene, np.ascontiguousarray(triangles, dtype=np.float32))

    def cast(
        self, start: Array, ways: Array | tuple[float, float, float] = (0.0, 0.0, -1.0)
    ) -> tuple[NDArray[np.float32], Indices]:
        """Distances and numbers of triangles; infinity and -1 where nothing is met."""
        found = self._scene.run(
            np.ascontiguousarray(start, dtype=np.float32),
            np.ascontiguousarray(np.broadcast_to(ways, start.shape), dtype=np.float32),
            output=1,
        )
        faces = found["primID"]
        return np.where(faces >= 0, found["tfar"], np.float32(np.inf)), faces
