"""Thin convex slabs behind the true surface: contact geometry of triangle soups.

MuJoCo collides a mesh as its convex hull, which would fill every room. Coplanar triangles merged
into convex polygons, each with a thin slab behind it, keep the surface exact (worlds reference
9.2 and 9.3). What may be driven on is exact from above even where nobody can tell which side of it
is outside: there the slab lies below.
"""

from __future__ import annotations

import itertools

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_maps.build.pieces import HullPiece, Piece, box_from_axes
from usarsim_maps.build.soup import convex_polygons
from usarsim_maps.orientation import Oriented

__all__ = ["FLOOR", "THICKNESS", "UNDER", "slabs"]

Array = NDArray[np.float64]

THICKNESS = 0.05
"""m of slab behind a wall: nothing up to 5 m/s tunnels (worlds reference 9.3)."""

FLOOR = 0.1
"""m of slab below a floor."""

UNDER = 0.008
"""m of slab of what looks down: it may be an underside, a ceiling, or a floor that is reversed."""

LEAST = 0.004
"""m: thickness where another surface lies closely behind."""

STEEP = 0.7
"""Upward part of the normal of what counts as a floor."""

WALL = 0.35
"""Upward part of the normal of what nothing can stand on."""

PLATE = 0.3
"""m: what looks down with a surface so near above it is the underside of something."""

RIGHT_ANGLE = 1e-3
"""Cosine of the angles of what counts as a rectangle."""


def slabs(surface: Oriented, up: Array, *, within: bool = False) -> list[Piece]:
    """Slabs of all polygons of a soup.

    Args:
        surface: clean triangles that face outside.
        up: (3,) the vertical in the soup's frame: floors get thicker slabs.
        within: nothing comes out below the lowest point, on which the thing may stand.
    """
    found = convex_polygons(surface.soup)
    if not found:
        return []
    first = np.array([index for index, _ in found])
    closed, known = surface.closed[first], surface.known[first]
    polygons = [surface.soup.vertices[list(ring)] for _, ring in found]
    normals = np.array([_normal(points) for points in polygons])
    rise = normals @ up
    behind, tightest = _room_behind(surface, polygons, normals)
    before, _ = _room_behind(surface, polygons, -normals)
    # A slab of what looks down lies in the solid above it, if there is one, else below it.
    below = (rise < -WALL) & ~closed & (behind > PLATE)
    ways = np.where(below[:, None], normals, -normals)
    # The underside of a wedge must not come out at its thin end.
    room = np.where(below, before, np.where(rise < -WALL, tightest, behind))
    centred = ~known & (np.abs(rise) <= WALL)
    room = np.where(centred, 2.0 * np.minimum(before, behind), room)
    wanted = np.where(rise < -WALL, UNDER, np.where(rise > STEEP, FLOOR, THICKNESS))
    depths = np.maximum(LEAST, np.minimum(wanted, room))
    if within:
        lowest = float((surface.soup.vertices[surface.soup.triangles] @ up).min())
        least = np.array([float((points @ up).min()) for points in polygons])
        down = np.where((rise > WALL) | below, least - lowest, np.inf)
        depths = np.maximum(LEAST, np.minimum(depths, down))
    pieces = []
    for number, points in enumerate(polygons):
        way = ways[number] * depths[number]
        front = points - way / 2.0 if centred[number] else points
        pieces.append(_slab(front, way, up))
    return pieces


def _slab(points: Array, way: Array, up: Array) -> Piece:
    """A polygon extruded: a box if it is a rectangle (item 62).

    Others that may be stood on are extruded downwards, so that they stay below their neighbours.
    """
    solid = np.concatenate([points, points + way])
    depth = float(np.linalg.norm(way))
    if len(points) == 4:
        edges = np.roll(points, -1, axis=0) - points
        lengths = np.linalg.norm(edges, axis=1)
        edges = edges / np.maximum(lengths, 1e-12)[:, None]
        if (np.abs(np.einsum("ij,ij->i", edges, np.roll(edges, -1, axis=0))) < RIGHT_ANGLE).all():
            return box_from_axes(solid, np.array([edges[0], edges[1], way / depth]))
    if float(way @ up) < -WALL * depth:
        solid = np.concatenate([points, points - up * depth])
    return HullPiece(solid)


def _normal(points: Array) -> Array:
    """Unit normal of a polygon (Newell's method)."""
    cross = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
    answer: Array = cross / max(float(np.linalg.norm(cross)), 1e-30)
    return answer


def _room_behind(surface: Oriented, polygons: list[Array], normals: Array) -> tuple[Array, Array]:
    """Distance (m) behind each polygon to the next surface: median and least over points of it."""
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, surface.soup.vertices[surface.soup.triangles].astype(np.float32))
    starts, owners = [], []
    for number, points in enumerate(polygons):
        middle = points.mean(axis=0)
        inner = middle + 0.8 * (points[:8] - middle)
        starts.append(np.concatenate([middle[None], inner]))
        owners.append(np.full(len(inner) + 1, number))
    owner = np.concatenate(owners)
    origin = np.concatenate(starts) - normals[owner] * 1e-3
    answer = scene.run(origin.astype(np.float32), (-normals[owner]).astype(np.float32), output=1)
    ways = np.where(answer["primID"] >= 0, answer["tfar"] + 1e-3, np.inf)
    ends = np.searchsorted(owner, np.arange(len(polygons) + 1))
    each = [ways[a:b] for a, b in itertools.pairwise(ends)]
    return np.array([np.median(some) for some in each]), np.minimum.reduceat(ways, ends[:-1])
