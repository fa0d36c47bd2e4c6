"""Geoms as triangles with normals, as OpenGL draws them, round shapes no finer than one sees.

The shapes and their slices are those of MuJoCo's own renderer, but the sides of cylinders and
capsules are one facet high, which looks the same and is half of the triangles.
"""

from __future__ import annotations

import functools
import math

import mujoco
import numpy as np
from numpy.typing import NDArray

Facets = NDArray[np.float32]
"""(n, 2, 3): corners of triangles, three in a row, counterclockwise from outside; with normals."""

EDGE = np.float32(0.8)
"""Cosine between a facet and the normal of its corner below which the facet is not smoothed."""

PIECE, NEARBY = 8.0, 64.0
"""m: edge of the pieces of an endless plane, which is what MuJoCo has, and how far they go."""

_TYPES = mujoco.mjtGeom
_SIDES = ((0, 1, 2), (1, 2, 0), (2, 0, 1))


def facets(model: mujoco.MjModel, geom: int, slices: int, stacks: int) -> Facets:
    """Triangles of a geom in its own frame.

    Args:
        model: with the geom, which is a box, a mesh, round or an endless plane.
        geom: its number.
        slices, stacks: of round shapes, around and along the axis.
    """
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    if kind == _TYPES.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == _TYPES.mjGEOM_PLANE:
        return _endless()
    if kind == _TYPES.mjGEOM_BOX:
        return _scaled(_box(), size)
    if kind == _TYPES.mjGEOM_CYLINDER:
        return _scaled(_cylinder(slices), np.array([size[0], size[0], size[1]]))
    if kind == _TYPES.mjGEOM_CAPSULE:
        ends = _scaled(_ball(slices, stacks, halved=True), np.full(3, size[0]))
        ends[:, 0, 2] += size[1] * _ends(slices, stacks)
        return ends
    axes = size if kind == _TYPES.mjGEOM_ELLIPSOID else np.full(3, size[0])
    return _scaled(_ball(slices, stacks, halved=False), axes)


def _scaled(unit: Facets, axes: NDArray[np.float64]) -> Facets:
    normals = unit[:, 1] / axes
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return np.stack([unit[:, 0] * axes, normals], axis=1).astype(np.float32)


def _mesh(model: mujoco.MjModel, mesh: int) -> Facets:
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    corners = model.mesh_vertadr[mesh] + model.mesh_face[faces].ravel()
    places = model.mesh_vert[corners]
    normals = model.mesh_normal[model.mesh_normaladr[mesh] + model.mesh_facenormal[faces].ravel()]
    one, other, third = places[::3], places[1::3], places[2::3]
    flat = np.cross(other - one, third - one)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), np.float32(1e-12))
    flat = np.repeat(flat, 3, axis=0)
    sharp = np.einsum("ij,ij->i", flat, normals) < EDGE
    return np.stack([places, np.where(sharp[:, None], flat, normals)], axis=1)


@functools.cache
def _endless() -> Facets:
    """A plane without end, in pieces, for its gloss is reckoned at corners: small ones up to
    `NEARBY` m, then larger and larger ones. MuJoCo itself makes 80 000 equal ones of it."""
    near = np.arange(0.0, NEARBY + PIECE, PIECE)
    half = np.concatenate([near, near[-1] * 2.0 ** np.arange(1, 9)])
    marks = np.concatenate([-half[:0:-1], half])
    x, y = np.meshgrid(marks, marks, indexing="ij")
    grid = np.stack([x, y, np.zeros_like(x)], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    places = np.stack([a, b, c, a, c, d], axis=2).reshape(-1, 3)
    normals = np.broadcast_to((0.0, 0.0, 1.0), places.shape)
    return np.stack([places, normals], axis=1).astype(np.float32)


@functools.cache
def _box() -> Facets:
    found = []
    for x, y, z in _SIDES:
        for sign in (1.0, -1.0):
            corners = np.zeros((4, 2, 3), np.float32)
            corners[:, :, z] = sign
            corners[:, 0, x] = (-1.0, 1.0, 1.0, -1.0)
            corners[:, 0, y] = (-sign, -sign, sign, sign)
            found.append(corners[[0, 1, 2, 0, 2, 3]])
    return np.concatenate(found)


@functools.cache
def _cylinder(slices: int) -> Facets:
    rows = [(0, -1, 0, -1), (1, -1, 0, -1), (1, -1, 1, 0), (1, 1, 1, 0), (1, 1, 0, 1), (0, 1, 0, 1)]
    rings = np.array(rows, np.float64)
    return _turned(rings[::2], rings[1::2], slices)


@functools.cache
def _ball(slices: int, stacks: int, *, halved: bool) -> Facets:
    rings = _rings(stacks, halved=halved)
    return _turned(rings[:-1], rings[1:], slices)


def _rings(stacks: int, *, halved: bool) -> NDArray[np.float64]:
    """Of a ball from the south to the north pole; the equator is there twice if it is halved."""
    heights = np.linspace(-math.pi / 2.0, math.pi / 2.0, stacks + 1)
    if halved:
        heights = np.insert(heights, stacks // 2, 0.0)
    ring = np.stack([np.cos(heights), np.sin(heights)], axis=1)
    ring[[0, -1], 0] = 0.0
    return np.hstack([ring, ring])


@functools.cache
def _ends(slices: int, stacks: int) -> NDArray[np.float64]:
    """To which end of a capsule each corner of a halved ball belongs, -1 or 1."""
    rings = _rings(stacks, halved=True)
    rings[:, 3] = np.repeat((-1.0, 1.0), len(rings) // 2)
    return _turned(rings[:-1], rings[1:], slices)[:, 1, 2].astype(np.float64)


def _turned(lower: NDArray[np.float64], upper: NDArray[np.float64], slices: int) -> Facets:
    """Bands around z between pairs of rings (n, 4): radius and height, and those of the normal."""
    angles = np.arange(slices + 1) * (2.0 * math.pi / slices)
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    around[-1] = around[0]

    def corners(rings: NDArray[np.float64]) -> NDArray[np.float64]:
        """(band, slice, 2, 3)."""
        pairs = rings.reshape(-1, 1, 2, 2)
        flat = pairs[..., :1] * around[None, :, None, :]
        return np.concatenate([flat, np.broadcast_to(pairs[..., 1:], (*flat.shape[:3], 1))], axis=3)

    low, high = corners(lower), corners(upper)
    a, b, c, d = low[:, :-1], low[:, 1:], high[:, 1:], high[:, :-1]
    pieces = []
    for one, *others in (((lower[:, 0] > 0.0), a, b, c), ((upper[:, 0] > 0.0), a, c, d)):
        pieces.append(np.stack([corner[one] for corner in others], axis=2).reshape(-1, 2, 3))
    return np.concatenate(pieces).astype(np.float32)
