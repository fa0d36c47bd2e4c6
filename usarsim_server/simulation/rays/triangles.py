"""Triangles as rays meet them: an Embree scene that knows which geom each triangle is of."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

__all__ = ["RoundPart", "Surfaces", "TriangleScene"]

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]


@dataclass(frozen=True, slots=True, eq=False)
class RoundPart:
    """A sphere or an ellipsoid among the parts of a scene, in the scene's frame.

    Attributes:
        centre: (3,) m. turn: (3, 3) rotation matrix. axes: (3,) semi-axes, m.
    """

    centre: Array
    turn: Array
    axes: Array


@dataclass(frozen=True, slots=True, eq=False)
class Surfaces:
    """What rays met: distances (n,), infinity for a miss; numbers (n,) of geoms, or of the parts of
    a scene, -1 for a miss; normals (n, 3), unit vectors on either side, zero for a miss, None if
    nobody asked."""

    distances: Array
    geoms: Numbers
    normals: Array | None = None


class TriangleScene:
    """An Embree scene of numbered parts; immutable, shared by all threads."""

    def __init__(
        self,
        parts: Sequence[tuple[int, Array]],
        rounds: Sequence[tuple[int, RoundPart]] = (),
    ) -> None:
        """Build the scene and its tree.

        Args:
            parts: number and triangles (n, 3, 3) of each part, m.
            rounds: by number, parts that are really round: their hits are moved from the facets
                to the true surface.
        """
        faces = np.concatenate([np.zeros((0, 3, 3)), *(part for _, part in parts)])
        # One more at the end: that of a miss, whose face is number -1.
        self._parts = np.append(
            np.repeat([part for part, _ in parts], [len(part) for _, part in parts]), -1
        ).astype(np.intp)
        self._rounds = dict(rounds)
        self._is_round = np.zeros(max((part for part, _ in parts), default=0) + 2, dtype=bool)
        self._is_round[list(self._rounds)] = True
        self._scene = None
        if len(faces):
            self._scene = rtcore_scene.EmbreeScene()
            TriangleMesh(self._scene, faces.astype(np.float32))
            # The first ray builds the tree; let nobody wait for that later.
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        self._normals = np.vstack((normals, np.zeros(3)))
        corners = faces.reshape(-1, 3) if len(faces) else np.zeros((1, 3))
        self.centre: Array = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
        """Middle (3,) of a sphere that holds everything, m."""
        self.radius = float(np.linalg.norm(corners - self.centre, axis=1).max())
        """Of that sphere, m."""

    def cast(self, origins: Array, directions: Array, *, normals: bool = False) -> Surfaces:
        """Cast rays from (n, 3) along unit vectors (n, 3), in the scene's frame."""
        if self._scene is None:
            missed = np.full(len(origins), -1, dtype=np.intp)
            return self._hits(np.full(len(origins), np.inf), missed, normals)
        answer = self._scene.run(
            origins.astype(np.float32, order="C"),
            directions.astype(np.float32, order="C"),
            output=1,
        )
        faces = answer["primID"]
        distances = answer["tfar"].astype(np.float64)
        distances[faces < 0] = np.inf
        hits = self._hits(distances, faces, normals)
        if self._rounds:
            self._round_off(hits, origins, directions)
        return hits

    def _round_off(self, hits: Surfaces, origins: Array, directions: Array) -> None:
        # A miss is part -1, the last entry, which is not round.
        touched = np.flatnonzero(self._is_round.take(hits.geoms, mode="wrap"))
        for part in set(hits.geoms[touched].tolist()):
            rays = touched[hits.geoms[touched] == part]
            _round_off(hits, rays, self._rounds[part], origins, directions)

    def _hits(self, distances: Array, faces: NDArray[np.signedinteger], normals: bool) -> Surfaces:
        facing = self._normals.take(faces, axis=0, mode="wrap") if normals else None
        return Surfaces(distances, self._parts.take(faces, mode="wrap"), facing)


def _round_off(
    hits: Surfaces, rays: Numbers, shape: RoundPart, origins: Array, directions: Array
) -> None:
    """Move hits on facets, which lie inside a round surface, out to where the ray meets it."""
    # In a frame where the surface is the unit sphere.
    start = (origins[rays] - shape.centre) @ shape.turn / shape.axes
    way = directions[rays] @ shape.turn / shape.axes
    a = np.einsum("ij,ij->i", way, way)
    b = np.einsum("ij,ij->i", start, way)
    c = np.einsum("ij,ij->i", start, start) - 1.0
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    near, far = (-b - root) / a, (-b + root) / a
    distance = np.where(near >= 0.0, near, far)
    hits.distances[rays] = distance
    if hits.normals is not None:
        outward = (start + distance[:, None] * way) / shape.axes @ shape.turn.T
        hits.normals[rays] = outward / np.linalg.norm(outward, axis=1)[:, None]
