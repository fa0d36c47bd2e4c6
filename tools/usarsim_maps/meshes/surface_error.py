"""How far what is felt lies from what is seen, on everything that may be driven on.

Rays go straight down through all storeys of what is seen. Where they meet a surface that is not too
steep, and free above it, another ray asks for the height at which something is felt there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

__all__ = ["MEDIAN", "MOST", "SurfaceError", "drivable_points", "surface_error"]

Array = NDArray[np.float64]

MEDIAN, MOST = 0.01, 0.02
"""m between felt and seen that are borne: in the median, and at 95 % of all places."""

LEVEL = 0.64
"""Least upward part of the normal of what may be driven on: 50 degrees."""

HEADROOM = 0.3
"""m of free height that a robot needs."""

STOREYS = 16
"""Surfaces above each other that are looked for."""

REACH = 1.0
"""m above and below a seen surface within which the felt one is looked for."""

PAST = 1e-3
"""m behind a surface where the look for the next one begins."""


@dataclass(frozen=True, slots=True)
class SurfaceError:
    """Distances of felt from seen surface.

    Attributes:
        places: how many were compared.
        median, most: m in the median and at 95 % of the places.
        lost: part of the places where nothing is felt.
    """

    places: int
    median: float
    most: float
    lost: float

    @classmethod
    def of(cls, errors: Array) -> SurfaceError:
        """Of signed distances (n,), m; infinite where nothing is felt."""
        if not len(errors):
            return cls(0, 0.0, 0.0, 0.0)
        size = np.sort(np.abs(errors))
        return cls(
            len(size),
            float(size[len(size) // 2]),
            float(size[int(0.95 * (len(size) - 1))]),
            float(np.isinf(size).mean()),
        )

    @property
    def is_small(self) -> bool:
        """Within `MEDIAN` and `MOST`."""
        return self.median <= MEDIAN and self.most <= MOST


def drivable_points(seen: Array, places: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """What may be driven on below or above some places.

    Args:
        seen: (n, 3, 3) triangles; of those that look down only the first from above counts.
        places: (k, 2) x and y, m.

    Returns:
        Points (m, 3), the free height above each, and which triangle each lies on.
    """
    nothing = np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.intp)
    if not len(seen) or not len(places):
        return nothing
    scene = _scene(seen)
    sides = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
    rise = sides[:, 2] / np.maximum(np.linalg.norm(sides, axis=1), 1e-30)
    rays = np.arange(len(places))
    top = np.full(len(places), float(seen[:, :, 2].max()) + REACH)
    above = np.full(len(places), np.inf)
    points, rooms, owners = [], [], []
    for storey in range(STOREYS):
        start = np.column_stack([places[rays], top[rays]])
        ways, faces = _down(scene, start)
        hit = faces >= 0
        rays, heights, faces = rays[hit], (start[:, 2] - ways)[hit], faces[hit]
        if not len(rays):
            break
        room = above[rays] - heights
        good = (room > HEADROOM) & (rise[faces] > LEVEL)
        if not storey:
            good |= rise[faces] < -LEVEL
        points.append(np.column_stack([places[rays], heights])[good])
        rooms.append(room[good])
        owners.append(faces[good].astype(np.intp))
        above[rays] = heights
        top[rays] = heights - PAST
    if not points:
        return nothing
    return np.concatenate(points), np.concatenate(rooms), np.concatenate(owners)


def surface_error(points: Array, rooms: Array, felt: Array) -> Array:
    """m by which what is felt lies above points (n, 3); infinite where it is not within `REACH`.

    Args:
        points: of what is seen.
        rooms: free height above each.
        felt: (n, 3, 3) triangles of what is felt.
    """
    if not len(points) or not len(felt):
        return np.full(len(points), np.inf)
    start = points.copy()
    start[:, 2] += np.minimum(rooms - HEADROOM / 2.0, REACH)
    ways, faces = _down(_scene(felt), start)
    errors: Array = start[:, 2] - ways - points[:, 2]
    errors[(faces < 0) | (errors < -REACH)] = np.inf
    return errors


def _scene(triangles: Array) -> rtcore_scene.EmbreeScene:
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, np.ascontiguousarray(triangles, dtype=np.float32))
    return scene


def _down(scene: rtcore_scene.EmbreeScene, start: Array) -> tuple[Array, NDArray[np.int32]]:
    """Distances and triangles below some points; -1 for none."""
    ways = np.tile(np.array([[0.0, 0.0, -1.0]], np.float32), (len(start), 1))
    found = scene.run(np.ascontiguousarray(start, dtype=np.float32), ways, output=1)
    return found["tfar"].astype(float), found["primID"]
