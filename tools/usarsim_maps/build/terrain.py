"""Ground that becomes a height field: one height above every place, and many bends.

Such a mesh has no coplanar neighbours to merge, so slabs would be as many as triangles; a height
field costs next to nothing instead (worlds reference 9.2 and 9.4). It is taken if it is true to the
mesh, at the coarsest grid that is.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from usarsim_maps.build.mesh_error import SurfaceError
from usarsim_maps.build.orientation import Oriented
from usarsim_maps.build.pieces import FieldPiece
from usarsim_maps.build.soup import SAME_NORMAL, Rays, Soup
from usarsim_maps.geometry import normals_areas
from usarsim_maps.scene import Array, Indices
from usarsim_maps.units import affine, pose_of_matrix

SOME = 4_000
"""Triangles from which on a mesh may be rolling ground."""

BENT = 0.5
"""Part of the inner edges that bend in rolling ground; slabs do better with what is flat."""

STEEPEST = 0.1
"""Least upward part of the normals of ground."""

WALLS = 0.02
"""Part of the area that may be steeper or look down, beside a block's sides and bottom."""

FINEST = 0.04
"""m between the points of a height field at the least: a robot's belly meets hundreds of cells."""

FINER = (1, 2, 3, 4)
"""Points of the grid per edge of a triangle that are tried."""

LARGEST = 1500
"""Rows and columns of a height field at most."""

COVERED = 0.98
"""Part of the outline's rectangle that has ground; holes would be filled wrongly."""

PROBES = 4_000
"""Places at which a height field is compared with the mesh."""


def as_terrain(surface: Oriented, up: Array) -> FieldPiece | None:
    """The height field that is as true to a mesh as robots need; None if there is none.

    Its triangles face outside; `up` (3,) is the vertical in their frame.
    """
    ways = [way for turn in _frames(up) if (way := _way_of(surface, turn)) is not None]
    for times in FINER:
        # Cells are cut from corner to corner: which frame is truer depends on how the mesh is.
        found = [one for way in ways if (one := _field(way, times)) is not None]
        if not found:
            return None
        error, field = min(found, key=lambda one: one[0].median + one[0].most)
        if error.is_small:
            return field
    return None


@dataclass(frozen=True, slots=True, eq=False)
class _Way:
    """Ground in a frame whose z is up."""

    turn: Array  # (3, 3) of the frame
    low: Array  # corners of the ground in it
    high: Array
    scene: Rays  # its triangles
    probes: Array  # (k, 3) places on it
    columns: int  # of the grid that is as fine as its triangles
    rows: int


def _way_of(surface: Oriented, turn: Array) -> _Way | None:
    points, triangles = surface.soup.vertices @ turn, surface.soup.triangles
    used = points[np.unique(triangles)]
    low, high = used.min(axis=0), used.max(axis=0)
    ground = _ground(points, triangles, low, high)
    if ground is None:
        return None
    scene = Rays(points[ground])
    columns, rows = _own_grid(points[np.unique(ground)], low, high, len(ground))
    return _Way(turn, low, high, scene, _probes(points, ground), columns, rows)


def _field(way: _Way, times: int) -> tuple[SurfaceError, FieldPiece] | None:
    """The height field of a grid that is so many times finer than the triangles."""
    size = way.high[:2] - way.low[:2]
    most = np.minimum(LARGEST, np.maximum(2, size // FINEST + 1)).astype(int).tolist()
    columns = min((way.columns - 1) * times + 1, most[0])
    rows = min((way.rows - 1) * times + 1, most[1])
    heights = _heights(way.scene, way.low, way.high, columns, rows)
    if heights is None:
        return None
    spacing = size / [columns - 1, rows - 1]
    felt = _interpolated(heights, (way.probes[:, :2] - way.low[:2]) / spacing)
    matrix = affine(way.turn, way.turn @ np.array([way.low[0], way.low[1], 0.0]))
    steps = (float(spacing[0]), float(spacing[1]))
    field = FieldPiece(heights, steps, pose_of_matrix(matrix))
    return SurfaceError.of(felt - way.probes[:, 2]), field


def is_rolling(soup: Soup) -> bool:
    """Whether a mesh is large and has few coplanar neighbours."""
    if len(soup.triangles) < SOME:
        return False
    normals, _ = normals_areas(soup.vertices, soup.triangles)
    tri = soup.triangles.astype(np.int64)
    edges = np.sort(np.concatenate([tri[:, [0, 1]], tri[:, [1, 2]], tri[:, [2, 0]]]), axis=1)
    faces = np.tile(np.arange(len(tri)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, faces = edges[order], faces[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    bend = np.linalg.norm(np.cross(normals[faces[:-1][same]], normals[faces[1:][same]]), axis=1)
    return bool(len(bend)) and float((bend > SAME_NORMAL).mean()) > BENT


def _frames(up: Array) -> Iterator[Array]:
    """Two frames whose z is up, along the axes of the mesh as far as they are level."""
    x = np.eye(3)[int(np.argmin(np.abs(up)))]
    x = x - (x @ up) * up
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    yield np.column_stack([x, y, up])
    yield np.column_stack([y, -x, up])


def _ground(points: Array, triangles: Indices, low: Array, high: Array) -> Indices | None:
    """The triangles that look up, if nothing else but sides and a bottom is there."""
    normals, areas = normals_areas(points, triangles)
    flat = areas * normals[:, 2]
    size = high - low
    if size[0] < 2.0 * FINEST or size[1] < 2.0 * FINEST:
        return None
    looks_up = normals[:, 2] > STEEPEST
    if not COVERED < float(flat[looks_up].sum()) / float(size[0] * size[1]) < 1.05:
        return None  # holes, or one floor above another
    corners = points[triangles]
    edge = 1e-3 * float(size[:2].max())
    side = np.zeros(len(triangles), dtype=bool)
    for axis in (0, 1):
        along = corners[:, :, axis]
        side |= (along < low[axis] + edge).all(axis=1) | (along > high[axis] - edge).all(axis=1)
    bottom = (normals[:, 2] < -STEEPEST) & (corners[:, :, 2] < low[2] + edge).all(axis=1)
    other = float(areas[~looks_up & ~side & ~bottom].sum())
    return triangles[looks_up] if other < WALLS * float(areas[looks_up].sum()) else None


def _probes(points: Array, triangles: Indices) -> Array:
    """Places all over the ground, spread by its area."""
    _, areas = normals_areas(points, triangles)
    dice = np.random.default_rng(0)
    chosen = triangles[dice.choice(len(triangles), PROBES, p=areas / areas.sum())]
    shares = dice.dirichlet(np.ones(3), PROBES)
    return np.asarray(np.einsum("ij,ijk->ik", shares, points[chosen]))


def _own_grid(used: Array, low: Array, high: Array, count: int) -> tuple[int, int]:
    """Columns and rows of the mesh if it is a grid itself, else as many as fit its triangles."""
    size = high[:2] - low[:2]
    columns, rows = (len(np.unique(np.round(used[:, axis] - low[axis], 4))) for axis in (0, 1))
    if columns * rows <= 1.1 * len(used):
        return columns, rows
    step = float(np.sqrt(2.0 * size[0] * size[1] / count))  # two triangles make a square
    return max(2, round(float(size[0]) / step) + 1), max(2, round(float(size[1]) / step) + 1)


def _heights(scene: Rays, low: Array, high: Array, columns: int, rows: int) -> Array | None:
    """Heights (rows, columns) above a grid; None if much of it has no ground."""
    inset = 1e-4 * (high - low)
    x, y = np.meshgrid(
        np.clip(np.linspace(low[0], high[0], columns), low[0] + inset[0], high[0] - inset[0]),
        np.clip(np.linspace(low[1], high[1], rows), low[1] + inset[1], high[1] - inset[1]),
    )
    top = float(high[2]) + 1.0
    start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, top)])
    ways, faces = scene.cast(start)
    found = faces >= 0
    if found.mean() < COVERED:
        return None
    heights: Array = np.where(found, top - ways.astype(float), low[2])
    return heights.reshape(x.shape)


def _interpolated(heights: Array, places: Array) -> Array:
    """Heights between the points of a grid, in whose steps places (n, 2) are counted.

    MuJoCo cuts every cell in two, from its first corner to the one opposite.
    """
    rows, columns = heights.shape
    cell = np.clip(np.floor(places), 0, [columns - 2, rows - 2]).astype(np.int64)
    u, v = (places - cell).T
    i, j = cell.T
    a, b = heights[j, i], heights[j, i + 1]
    d, c = heights[j + 1, i], heights[j + 1, i + 1]
    right = a + u * (b - a) + v * (c - b)
    left = a + v * (d - a) + u * (c - d)
    return np.asarray(np.where(u > v, right, left))
