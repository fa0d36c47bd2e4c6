"""Thin convex slabs behind the true surface: contact geometry of triangle soups.

MuJoCo collides a mesh as its convex hull, which would fill every room. Coplanar triangles merged
into convex polygons, each with a thin slab behind it, keep the surface exact (worlds reference
9.2 and 9.3).
"""

from __future__ import annotations

import itertools

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.importers.pieces import HullPiece, Piece, box_from_axes
from usarsim_server.importers.soup import Soup, convex_polygons, is_consistent

__all__ = ["FLOOR", "THICKNESS", "slabs"]

Array = NDArray[np.float64]

THICKNESS = 0.05
"""m of slab behind a wall: nothing up to 5 m/s tunnels (worlds reference 9.3)."""

FLOOR = 0.1
"""m of slab below a floor."""

LEAST = 0.004
"""m: thickness where another surface lies closely behind."""

STEEP = 0.7
"""Upward part of the normal of what counts as a floor."""

RIGHT_ANGLE = 1e-3
"""Cosine of the angles of what counts as a rectangle."""


def slabs(soup: Soup, up: Array) -> list[Piece]:
    """Slabs of all polygons of a soup.

    Args:
        soup: clean triangles.
        up: (3,) the vertical in the soup's frame: floors get thicker slabs.
    """
    consistent = is_consistent(soup)
    rings = convex_polygons(soup, oriented=consistent)
    polygons = [soup.vertices[list(ring)] for ring in rings]
    normals = np.array([_normal(points) for points in polygons]).reshape(-1, 3)
    wanted = np.where(normals @ up > STEEP, FLOOR, THICKNESS)
    room = _room_behind(soup, polygons, normals)
    if not consistent:
        room = np.minimum(room, _room_behind(soup, polygons, -normals)) * 2.0
    depths = np.maximum(LEAST, np.minimum(wanted, room))
    pieces = []
    for points, normal, depth in zip(polygons, normals, depths.tolist(), strict=True):
        front = points if consistent else points + normal * (depth / 2.0)
        pieces.append(_slab(front, normal, depth))
    return pieces


def _slab(points: Array, normal: Array, depth: float) -> Piece:
    """A polygon extruded backwards: a box if it is a rectangle (item 62)."""
    solid = np.concatenate([points, points - normal * depth])
    if len(points) == 4:
        edges = np.roll(points, -1, axis=0) - points
        lengths = np.linalg.norm(edges, axis=1)
        edges = edges / np.maximum(lengths, 1e-12)[:, None]
        if (np.abs(np.einsum("ij,ij->i", edges, np.roll(edges, -1, axis=0))) < RIGHT_ANGLE).all():
            return box_from_axes(solid, np.array([edges[0], edges[1], normal]))
    return HullPiece(solid)


def _normal(points: Array) -> Array:
    """Unit normal of a polygon (Newell's method)."""
    cross = np.cross(points - points[0], np.roll(points, -1, axis=0) - points[0]).sum(axis=0)
    answer: Array = cross / max(float(np.linalg.norm(cross)), 1e-30)
    return answer


def _room_behind(soup: Soup, polygons: list[Array], normals: Array) -> Array:
    """Distance (m) behind each polygon to the next surface: the median over points of it."""
    if not polygons:
        return np.zeros(0)
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, soup.vertices[soup.triangles].astype(np.float32))
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
    return np.array([float(np.median(ways[a:b])) for a, b in itertools.pairwise(ends)])
