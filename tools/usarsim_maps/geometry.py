"""Sizes of things: normals and areas of triangles, points of shapes, what MuJoCo calls them."""

from __future__ import annotations

import itertools
import math

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.scene import Array, Box, Capsule, Cylinder, Mesh, Part, Plane, Sphere

FARTHEST = 1e7
"""m: a vertex beyond is a bad number, as one that is not finite is; MuJoCo refuses such meshes."""

LEAST_AREA = 1e-8
"""m^2: smaller triangles are dropped."""

CORNERS = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
"""(8, 3) of a box of 2 m around the origin; z changes fastest."""

QUADS = ((0, 2, 6, 4), (0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (1, 5, 7, 3))
"""Numbers of the corners of each side, counter-clockwise from outside; the bottom is the first."""


def normals_areas(vertices: Array, triangles: NDArray[np.integer]) -> tuple[Array, Array]:
    """Unit normals (m, 3), zero where there is no area, and areas (m,) of triangles."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-30)[:, None], length / 2.0


def size_of(shape: object, linear: Array) -> tuple[str, tuple[float, ...]]:
    """MuJoCo's name and sizes of a shape, scaled by a linear map (3, 3)."""
    scale = np.abs(np.diag(linear))
    even = float(abs(np.linalg.det(linear))) ** (1.0 / 3.0)
    match shape:
        case Box(size):
            half = np.array(size) * scale / 2.0
            return "box", tuple(np.maximum(half, 1e-4).tolist())
        case Sphere(radius):
            return "sphere", (max(radius * even, 1e-4),)
        case Cylinder(radius, length):
            return "cylinder", _round(radius, length, scale)
        case Capsule(radius, length):
            return "capsule", _round(radius, length, scale)
        case Plane(size):
            return "plane", (size[0] / 2.0, size[1] / 2.0, 1.0)
    raise TypeError(f"{shape!r} is no shape")


def _round(radius: float, length: float, scale: Array) -> tuple[float, float]:
    across = math.sqrt(float(scale[0] * scale[1]))
    return max(radius * across, 1e-4), max(length * float(scale[2]) / 2.0, 1e-4)


def outline_of(shape: object, linear: Array) -> Array:
    """Points around a shape other than a mesh or plane."""
    kind, size = size_of(shape, linear)
    turn = np.linspace(0.0, math.tau, 16, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn)])
    match kind:
        case "box":
            return np.asarray(CORNERS * size)
        case "sphere":
            levels = np.linspace(-1.0, 1.0, 9)
            radius, half = size[0], size[0]
        case _:
            levels = np.array([-1.0, 1.0])
            radius, half = size[0], size[1] + (size[0] if kind == "capsule" else 0.0)
    widths = np.sqrt(1.0 - levels**2) if kind == "sphere" else np.ones(len(levels))
    return np.concatenate(
        [
            np.column_stack([ring * radius * width, np.full(16, half * level)])
            for level, width in zip(levels, widths, strict=True)
        ]
    )


def points_of(part: Part) -> Array:
    """Points of a part in the frame of its object; of meshes those that triangles with area use."""
    if isinstance(part.shape, Plane):
        return np.zeros((0, 3))
    if not isinstance(part.shape, Mesh):
        return _placed(outline_of(part.shape, np.eye(3)), part.matrix)
    mesh = part.shape
    with np.errstate(all="ignore"):
        points = _placed(mesh.vertices, part.matrix)
        sound = np.asarray((np.abs(points) < FARTHEST).all(axis=1))
        triangles = mesh.triangles[sound[mesh.triangles].all(axis=1)]
        _, areas = normals_areas(points, triangles)
    large = triangles[areas > LEAST_AREA]
    return points[np.unique(large if len(large) else triangles)]


def box_around(part: Part, matrix: Array) -> tuple[Array, Array] | None:
    """Lower and upper corner of a part whose object has this matrix (4, 4); None if it has none.

    Those of balls, cylinders and capsules are exact.
    """
    shape, whole = part.shape, matrix @ part.matrix
    if not isinstance(shape, Sphere | Cylinder | Capsule):
        points = _placed(points_of(part), matrix)
        return (points.min(axis=0), points.max(axis=0)) if len(points) else None
    linear, middle = whole[:3, :3], whole[:3, 3]
    ball, disc = np.linalg.norm(linear, axis=1), np.linalg.norm(linear[:, :2], axis=1)
    match shape:
        case Sphere(radius):
            half = radius * ball
        case Capsule(radius, length):
            half = radius * ball + length / 2.0 * np.abs(linear[:, 2])
        case Cylinder(radius, length):
            half = radius * disc + length / 2.0 * np.abs(linear[:, 2])
    return middle - half, middle + half


def _placed(points: Array, matrix: Array) -> Array:
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
