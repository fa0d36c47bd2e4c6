"""Closed shapes cut into few convex pieces: walls with doors, arches, tables, stairs.

Space is cut by planes, first around the whole shape, until every region is simple: nothing solid in
it stands before a face in it by more than `SLACK`. The hull of what is solid in such a region is a
piece. Planes are those of faces, and those that halve the angle of edges where faces look at each
other; they are chosen by how many pairs of faces they part. Regions are cells (`cells.py`), so
nothing has to be capped, and faces need not meet edge by edge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usarsim_maps.build.cells import Cell, Plane, Point, box_cell, plane_of, split, split_polygon
from usarsim_maps.build.orientation import Oriented
from usarsim_maps.build.pieces import FLAT, Convex, hull_piece
from usarsim_maps.build.soup import SAME_NORMAL, Soup, convex_polygons
from usarsim_maps.geometry import normals_areas
from usarsim_maps.scene import Array, Mask

SLACK = 0.004
"""m by which a piece may stand before a face."""

MOST_FACES = 1_000
"""Convex faces of a shape that is cut; time grows with their square."""

REGIONS = 4
"""Regions that are looked at for each piece that is allowed."""

CANDIDATES = 20
"""Planes of faces, and as many of edges, that are compared for one cut."""

PAIRS = 3_000
"""Pairs of faces in each other's way that planes are compared by."""

HALF_PARTED = 0.5
"""What a pair counts if the plane cuts one of its faces."""

CUT_COST = 0.5
"""What it costs to cut all faces of a region, in parts of all pairs."""

ASIDE = 2e-4
"""m beside a face at which it is asked what is solid there."""

SOLID = 0.05
"""How far winding numbers may be from 0 before a face and from 1 behind it."""

ASKED = 60
"""Triangles of a shape at which that is asked."""

CHUNK = 400_000
"""Pairs of points and triangles whose solid angles are computed at once."""


def convex_parts(surface: Oriented, most: int) -> list[Convex] | None:
    """At most so many pieces that fill a shape; None if it is not closed or needs more.

    The shape is closed if it encloses space, though edges may not fit; its faces look outside.
    """
    soup = surface.soup
    inside = _Inside(soup)
    if not _is_solid(soup, inside):
        return None
    found = convex_polygons(soup)
    if not 4 <= len(found) <= MOST_FACES:
        return None
    faces: list[_FlatFace] = []
    for _, ring in found:
        points = tuple((x, y, z) for x, y, z in soup.vertices[list(ring)].tolist())
        plane = plane_of(points)
        if plane is not None:
            faces.append(_FlatFace(points, plane))
    notches = _notches(soup)
    used = soup.vertices[np.unique(soup.triangles)]
    low, high = (used.min(axis=0) - 0.1).tolist(), (used.max(axis=0) + 0.1).tolist()
    whole = box_cell((low[0], low[1], low[2]), (high[0], high[1], high[2]))
    todo: list[tuple[Cell, list[_FlatFace]]] = [(whole, faces)]
    pieces: list[Convex] = []
    for _ in range(REGIONS * most):
        # Regions of many faces come first: it shows early that there will be too many.
        if not todo or len(pieces) + sum(bool(within) for _, within in todo) > most:
            break
        cell, within = todo.pop(max(range(len(todo)), key=lambda k: len(todo[k][1])))
        region = _Region(cell, within, inside)
        if region.is_simple:
            pieces += region.piece()
            continue
        for plane in region.cuts(notches):
            back, front = split(cell, plane, 0, 0)
            if back is not None and front is not None:
                behind, before = _divided(within, plane)
                todo += [(front, before), (back, behind)]
                break
        else:
            return None
    return pieces if not todo and 0 < len(pieces) <= most else None


@dataclass(frozen=True, slots=True)
class _FlatFace:
    points: tuple[Point, ...]
    plane: Plane


def _divided(faces: list[_FlatFace], plane: Plane) -> tuple[list[_FlatFace], list[_FlatFace]]:
    """Faces behind and before a plane; those in it bound the regions from now on."""
    behind, before = [], []
    for face in faces:
        inner, outer = split_polygon(face.points, plane)
        if inner:
            behind.append(_FlatFace(inner, face.plane))
        if outer:
            before.append(_FlatFace(outer, face.plane))
    return behind, before


class _Region:
    """A cell with the faces in it."""

    def __init__(self, cell: Cell, faces: list[_FlatFace], inside: _Inside) -> None:
        corners = np.array(cell.corners)
        middle = corners.mean(axis=0)
        if not faces:
            self._points = corners if bool(inside(middle[None])[0]) else corners[:0]
            self._pairs = np.zeros((2, 0), dtype=np.intp)
            return
        way = middle - corners
        way /= np.maximum(np.linalg.norm(way, axis=1), 1e-12)[:, None]
        filled = corners[inside(corners + ASIDE * way)]
        rings = [*(face.points for face in faces), *([p] for p in filled.tolist())]
        self._points = np.array([p for ring in rings for p in ring])
        self._starts = np.cumsum([0, *map(len, rings[:-1])])
        self._planes = np.array([face.plane for face in faces])
        heights = self._points @ self._planes[:, :3].T - self._planes[:, 3]
        tall = np.maximum.reduceat(heights, self._starts, axis=0).T  # of ring j before face i
        one, other = np.nonzero(tall > SLACK)
        self._pairs = np.array([one, other])
        self._cell, self._faces = cell, faces

    @property
    def is_simple(self) -> bool:
        """Whether nothing solid stands before a face."""
        return self._pairs.shape[1] == 0

    def piece(self) -> list[Convex]:
        """The hull of what is solid, if it has a volume."""
        if len(self._points) < 4:
            return []
        first = np.unique(np.round(self._points, 6), axis=0, return_index=True)[1]
        points = self._points[np.sort(first)]
        axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
        if np.ptp(points @ axes.T, axis=0).min() < FLAT / 2.0:
            return []
        return [hull_piece(points)]

    def cuts(self, notches: Array) -> list[Plane]:
        """Planes that may part what stands in each other's way, the best first."""
        pairs = self._pairs
        if pairs.shape[1] > PAIRS:
            chosen = np.linspace(0, pairs.shape[1] - 1, PAIRS).astype(np.intp)
            pairs = pairs[:, chosen]
        counts = np.bincount(pairs[0], minlength=len(self._faces))
        own = _distinct(self._planes, counts.astype(float))
        inner = np.ones(len(notches), dtype=bool)
        for face in self._cell.faces:
            inner &= notches[:, 4:7] @ np.array(face.plane[:3]) < face.plane.offset - 1e-6
        others = _distinct(notches[inner, :4], notches[inner, 7])
        planes = np.concatenate([own, others])
        heights = self._points @ planes[:, :3].T - planes[:, 3]
        low = np.minimum.reduceat(heights, self._starts, axis=0)
        high = np.maximum.reduceat(heights, self._starts, axis=0)
        behind, before = high <= ASIDE, low >= -ASIDE
        cut = ~behind & ~before
        flat = behind & before
        side = before.astype(np.int8) - behind.astype(np.int8)
        one, other = pairs
        apart = side[one] * side[other] < 0
        apart |= flat[one] | flat[other]
        some = (cut[one] | cut[other]) & ~apart
        parted = apart.mean(axis=0) + HALF_PARTED * some.mean(axis=0)
        score = parted - CUT_COST * cut.mean(axis=0)
        order = np.argsort(-np.round(score, 9), kind="stable")
        return [Plane(*planes[k].tolist()) for k in order.tolist()]


def _distinct(planes: Array, weights: Array) -> Array:
    """Some of the planes (n, 4), each once whichever way it faces: those of the largest weight."""
    if not len(planes):
        return planes
    lead = planes[np.arange(len(planes)), np.argmax(np.abs(planes[:, :3]), axis=1)]
    keys = np.round(planes * np.sign(lead)[:, None], 4) + 0.0
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    sums = np.bincount(inverse.reshape(-1), weights)
    order = np.lexsort((first, -np.round(sums, 9)))[:CANDIDATES]
    kept = first[order][sums[order] > 0.0]
    return np.asarray(planes[kept])


def _notches(soup: Soup) -> Array:
    """Edges at which two triangles look at each other (n, 8): a plane, the middle, the length.

    The plane halves the angle between them.
    """
    triangles = soup.triangles.astype(np.int64)
    normals, _ = normals_areas(soup.vertices, soup.triangles)
    starts, ends = triangles.reshape(-1), triangles[:, [1, 2, 0]].reshape(-1)
    faces = np.repeat(np.arange(len(triangles)), 3)
    count = len(soup.vertices) + 1
    order = np.argsort(starts * count + ends, kind="stable")
    keys = (starts * count + ends)[order]
    twins = ends * count + starts
    place = np.minimum(np.searchsorted(keys, twins), len(keys) - 1)
    pair = order[place]
    real = (keys[place] == twins) & (starts < ends)
    one, other = faces[real], faces[pair[real]]
    a, b = soup.vertices[starts[real]], soup.vertices[ends[real]]
    tip = soup.vertices[triangles[other]].sum(axis=1) - a - b
    rises = np.einsum("ij,ij->i", normals[one], tip - a)
    bend = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
    along = b - a
    normal = np.cross(along, normals[one] + normals[other])
    length = np.linalg.norm(normal, axis=1)
    good = (rises > 0.0) & (bend > SAME_NORMAL) & (length > 1e-9)
    normal = normal[good] / length[good, None]
    middle = (a[good] + b[good]) / 2.0
    offset = np.einsum("ij,ij->i", normal, middle)
    size = np.linalg.norm(along[good], axis=1)
    return np.column_stack([normal, offset, middle, size])


class _Inside:
    """Tells whether points are within a shape, by the solid angles of its triangles."""

    def __init__(self, soup: Soup) -> None:
        self._corners = soup.vertices[soup.triangles]

    def turns(self, points: Array) -> Array:
        """Winding numbers (n,): 1 inside, 0 outside."""
        step = max(1, CHUNK // len(self._corners))
        parts = [self._some(points[k : k + step]) for k in range(0, len(points), step)]
        return np.concatenate([np.zeros(0), *parts])

    def _some(self, points: Array) -> Array:
        a, b, c = (self._corners[None, :, k] - points[:, None] for k in range(3))
        sizes = [np.linalg.norm(way, axis=2) for way in (a, b, c)]
        volume = np.einsum("ijk,ijk->ij", a, np.cross(b, c))
        base = sizes[0] * sizes[1] * sizes[2]
        base += np.einsum("ijk,ijk->ij", a, b) * sizes[2]
        base += np.einsum("ijk,ijk->ij", b, c) * sizes[0]
        base += np.einsum("ijk,ijk->ij", c, a) * sizes[1]
        return np.asarray(np.arctan2(volume, base).sum(axis=1) / math.tau)

    def __call__(self, points: Array) -> Mask:
        return np.asarray(self.turns(points) > 0.5)


def _is_solid(soup: Soup, inside: _Inside) -> bool:
    """Whether there is nothing before the triangles and something behind them."""
    count = len(soup.triangles)
    chosen = np.unique(np.linspace(0, count - 1, min(ASKED, count)).astype(np.intp))
    triangles = soup.triangles[chosen]
    normals, _ = normals_areas(soup.vertices, triangles)
    middles = soup.vertices[triangles].mean(axis=1)
    before, behind = (inside.turns(middles + sign * ASIDE * normals) for sign in (1.0, -1.0))
    return bool((np.abs(before) < SOLID).all() and (np.abs(behind - 1.0) < SOLID).all())
