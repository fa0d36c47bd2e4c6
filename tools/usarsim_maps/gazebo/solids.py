"""Meshes for shapes of SDF that are none of the scene's own: ellipsoids, cones, prisms."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.meshes.polygons import triangulate_one
from usarsim_maps.scene import Mesh

Array = NDArray[np.float64]

AROUND, RINGS = 24, 12


def ball_mesh(radii: Sequence[float]) -> Mesh:
    """An ellipsoid around the origin; its hull is what collides."""
    turn = np.linspace(0.0, math.tau, AROUND, endpoint=False)
    round_about = np.column_stack([np.cos(turn), np.sin(turn)])
    tilt = np.linspace(0.0, math.pi, RINGS + 1)[1:-1]
    rings = [np.column_stack([np.sin(t) * round_about, np.full(AROUND, np.cos(t))]) for t in tilt]
    points = np.concatenate([*rings, [[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]]) * np.array(radii)
    top, bottom = len(points) - 2, len(points) - 1
    faces = []
    for k in range(AROUND):
        after = (k + 1) % AROUND
        faces.append((top, k, after))
        last = (len(tilt) - 1) * AROUND
        faces.append((bottom, last + after, last + k))
        for ring in range(len(tilt) - 1):
            a, b = ring * AROUND + k, ring * AROUND + after
            faces += [(a, a + AROUND, b), (b, a + AROUND, b + AROUND)]
    return Mesh("ellipsoid", points, np.array(faces, dtype=np.int32), hulls=(points,))


def cone_mesh(radius: float, length: float) -> Mesh:
    """A cone along z, centred, its tip upwards; its hull is what collides."""
    turn = np.linspace(0.0, math.tau, AROUND, endpoint=False)
    ring = np.column_stack(
        [radius * np.cos(turn), radius * np.sin(turn), np.full(AROUND, -length / 2.0)]
    )
    points = np.concatenate([ring, [[0.0, 0.0, length / 2.0]]])
    around = range(AROUND)
    faces = [(k, (k + 1) % AROUND, AROUND) for k in around]
    faces += [(0, k + 1, k) for k in range(1, AROUND - 1)]
    return Mesh("cone", points, np.array(faces, dtype=np.int32), hulls=(points,))


def prism_mesh(outline: Array, height: float) -> Mesh:
    """A polygon (n, 2) in the ground plane, extruded upwards."""
    count = len(outline)
    area = float(np.cross(
        np.column_stack([outline, np.zeros(count)]),
        np.column_stack([np.roll(outline, -1, axis=0), np.zeros(count)]),
    )[:, 2].sum())  # fmt: skip
    if area < 0.0:
        outline = outline[::-1]
    low = np.column_stack([outline, np.zeros(count)])
    high = np.column_stack([outline, np.full(count, height)])
    top = triangulate_one(high)
    faces = [(a + count, b + count, c + count) for a, b, c in top]
    faces += [(c, b, a) for a, b, c in top]
    for k in range(count):
        after = (k + 1) % count
        faces += [(k, after, after + count), (k, after + count, k + count)]
    points = np.concatenate([low, high])
    return Mesh("polyline", points, np.array(faces, dtype=np.int32).reshape(-1, 3))
