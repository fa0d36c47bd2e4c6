"""Meshes that are terrain: rolling ground with one height above every place.

Such a mesh has no coplanar neighbours to merge, so slabs would be as many as triangles; a height
field costs next to nothing instead (worlds reference 9.2 and 9.4).
"""

from __future__ import annotations

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.importers.soup import Soup, normals_areas
from usarsim_server.simulation.frames import Pose

__all__ = ["as_terrain"]

Array = NDArray[np.float64]
Indices = NDArray[np.int32]

SOME = 4_000
"""Triangles from which on a mesh may be terrain, if a height field is true to it."""

MANY = 20_000
"""Triangles from which on it may be terrain whose finest detail is lost."""

TRUE = 0.005
"""m: how far a height field may be from the middles and corners of the triangles to be true."""

STEEPEST = 0.1
"""Least upward part of the normals."""

LARGEST = 1500
"""Rows and columns of a height field at most."""

COVERED = 0.98
"""Part of the outline's rectangle that has ground; holes would be filled wrongly."""


def as_terrain(soup: Soup, pose: Pose) -> tuple[Array, tuple[float, float], Pose] | None:
    """Heights (rows, columns), spacing and corner pose of a terrain mesh; None if it is none.

    Args:
        soup: clean triangles.
        pose: of its frame in the world; the grid is level in the world.
    """
    if len(soup.triangles) < SOME:
        return None
    points = soup.vertices @ pose.matrix().T + np.array(pose.position)
    normals, areas = normals_areas(points, soup.triangles)
    if (np.abs(normals[:, 2]) < STEEPEST).mean() > 0.001 or _coplanar_share(soup, normals) > 0.5:
        return None
    low, high = points.min(axis=0), points.max(axis=0)
    size = high[:2] - low[:2]
    # As fine as the triangles, of which two make a square.
    flat_area = float((areas * np.abs(normals[:, 2])).sum())
    if flat_area > 1.05 * size[0] * size[1]:
        return None  # one floor above another
    step = float(np.sqrt(2.0 * flat_area / len(soup.triangles)))
    columns, rows = (int(min(LARGEST, max(2, round(extent / step) + 1))) for extent in size)
    x, y = np.linspace(low[0], high[0], columns), np.linspace(low[1], high[1], rows)
    inset = 1e-4 * size
    grid_x, grid_y = np.meshgrid(
        np.clip(x, low[0] + inset[0], high[0] - inset[0]),
        np.clip(y, low[1] + inset[1], high[1] - inset[1]),
    )
    heights = _heights(points[soup.triangles], grid_x, grid_y, float(high[2]) + 1.0)
    found = np.isfinite(heights)
    if found.mean() < COVERED:
        return None
    heights = np.where(found, heights, low[2])
    spacing = (float(size[0] / (columns - 1)), float(size[1] / (rows - 1)))
    if len(soup.triangles) < MANY and _error(points, soup.triangles, heights, spacing) > TRUE:
        return None
    return heights, spacing, Pose((float(low[0]), float(low[1]), 0.0))


def _error(
    points: Array, triangles: Indices, heights: Array, spacing: tuple[float, float]
) -> float:
    """Largest distance (m, vertical) of a height field from corners and middles of triangles."""
    corners = points[np.unique(triangles)]
    probes = np.concatenate([corners, points[triangles].mean(axis=1)])
    rows, columns = heights.shape
    place = (probes[:, :2] - corners[:, :2].min(axis=0)) / np.array(spacing)
    cell = np.clip(np.floor(place), 0, [columns - 2, rows - 2]).astype(np.int64)
    u, v = (place - cell).T
    i, j = cell.T
    lower = heights[j, i] * (1.0 - u) + heights[j, i + 1] * u
    upper = heights[j + 1, i] * (1.0 - u) + heights[j + 1, i + 1] * u
    return float(np.abs(lower * (1.0 - v) + upper * v - probes[:, 2]).max())


def _coplanar_share(soup: Soup, normals: Array) -> float:
    """Part of the inner edges with no bend."""
    tri = soup.triangles.astype(np.int64)
    edges = np.sort(np.concatenate([tri[:, [0, 1]], tri[:, [1, 2]], tri[:, [2, 0]]]), axis=1)
    faces = np.tile(np.arange(len(tri)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, faces = edges[order], faces[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    one, other = faces[:-1][same], faces[1:][same]
    if not len(one):
        return 0.0
    bend = np.linalg.norm(np.cross(normals[one], normals[other]), axis=1)
    return float((bend < 1e-3).mean())


def _heights(triangles: Array, x: Array, y: Array, top: float) -> Array:
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, triangles.astype(np.float32))
    start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, top)]).astype(np.float32)
    down = np.tile(np.array([0.0, 0.0, -1.0], np.float32), (len(start), 1))
    answer = scene.run(start, down, output=1)
    ways = np.where(answer["primID"] >= 0, answer["tfar"], np.inf)
    return (top - ways).reshape(x.shape)
