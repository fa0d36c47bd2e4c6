"""Triangles of geoms as things that rays hit: what never moves, and bodies in their own frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.cameras.backend import NEAR
from usarsim_server.simulation.model import SHELF_NAME
from usarsim_server.simulation.rays.tessellation import triangles

__all__ = ["Hits", "Solid", "body_solid", "is_solid", "scenery"]

Array = NDArray[np.float64]
Plane = NDArray[np.float32]
Numbers = NDArray[np.int32]

SHELLS = 4
"""Back faces that a ray passes at most: the inside of the housing that a camera sits in."""
SAMPLES = 64
"""Rays of a picture that tell whether its eye is inside something."""
SOLID = 0.5
"""Opacity from which on a geom is drawn; what is more transparent is not there, unlike in OpenGL,
which tints what is behind it."""
STEP = 1e-4
"""m behind a back face at which its ray goes on."""


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Depths (n,), infinity for a miss; geoms (n,), -1 for a miss; outward normals (n, 3)."""

    depths: Plane
    geoms: Numbers
    normals: Plane


class Solid:
    """Triangles of some geoms in one frame, with outward normals where shapes have an outside."""

    def __init__(self, parts: Sequence[tuple[int, Array]], closed: Sequence[bool]) -> None:
        """Build the scene.

        Args:
            parts: number and triangles (n, 3, 3) of each geom.
            closed: whether it is convex, so that it has an outside.
        """
        faces = np.concatenate([np.zeros((0, 3, 3)), *(part for _, part in parts)])
        counts = [len(part) for _, part in parts]
        geoms = np.repeat([geom for geom, _ in parts], counts)
        self._geoms = np.append(geoms, -1).astype(np.int32)
        self._closed = np.zeros(max((geom for geom, _ in parts), default=0) + 1, dtype=bool)
        self._closed[[geom for geom, _ in parts]] = closed
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]
        for (_, part), start in zip(parts, np.cumsum([0, *counts]).tolist(), strict=False):
            if len(part):
                # Outwards is away from the middle.
                span = slice(start, start + len(part))
                middle = part.reshape(-1, 3).mean(axis=0)
                out = np.einsum("ij,ij->i", normals[span], part.mean(axis=1) - middle)
                normals[span][out < 0.0] *= -1.0
        self._normals = np.vstack([normals, np.zeros(3)]).astype(np.float32)
        self._scene = None
        if len(faces):
            self._scene = rtcore_scene.EmbreeScene()
            TriangleMesh(self._scene, faces.astype(np.float32))

    def cast(self, origin: Array, directions: Plane) -> Hits:
        """What rays from one point meet; depths are in units of the directions' lengths."""
        return self._cast_on(origin, directions, np.float32(NEAR))

    def cast_from_inside(self, origin: Array, directions: Plane) -> Hits:
        """The same for a point that may be inside: closed shapes are seen from outside only."""
        hits = self.cast(origin, directions)
        # Whoever is inside a convex shape sees its back face, or what sticks into it, all around.
        if len(directions) > SAMPLES:
            some = np.linspace(0, len(directions) - 1, SAMPLES).astype(np.intp)
            if not len(self._backs(hits, some, directions)):
                return hits
        rays = self._backs(hits, np.arange(len(directions)), directions)
        for _ in range(SHELLS):
            if not len(rays):
                break
            further = self._cast_on(
                origin, directions[rays], (hits.depths[rays] + np.float32(STEP))[:, None]
            )
            hits.depths[rays], hits.geoms[rays] = further.depths, further.geoms
            hits.normals[rays] = further.normals
            rays = self._backs(hits, rays, directions)
        return hits

    def _cast_on(self, origin: Array, directions: Plane, begin: Plane | np.float32) -> Hits:
        """Hits beyond some depth."""
        count = len(directions)
        if self._scene is None:
            nothing = np.full(count, -1, np.int32)
            return Hits(np.full(count, np.inf, np.float32), nothing, np.zeros_like(directions))
        starts = origin.astype(np.float32) + begin * directions
        answer = self._scene.run(starts, directions, output=1)
        faces, depths = answer["primID"], answer["tfar"]
        depths += np.ravel(begin)
        depths[faces < 0] = np.inf
        # The last entry is that of a miss.
        geoms = np.take(self._geoms, faces, mode="wrap")
        return Hits(depths, geoms, np.take(self._normals, faces, axis=0, mode="wrap"))

    def _backs(self, hits: Hits, rays: NDArray[np.intp], directions: Plane) -> NDArray[np.intp]:
        """Those of some rays that hit the inside of a closed shape."""
        along = np.einsum("ij,ij->i", hits.normals[rays], directions[rays])
        closed = self._closed[hits.geoms[rays]]
        backs: NDArray[np.intp] = rays[closed & (along > 0.0) & (hits.geoms[rays] >= 0)]
        return backs


def scenery(model: mujoco.MjModel, data: mujoco.MjData) -> Solid:
    fixed = [
        geom
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] == 0
        and model.geom(geom).name != SHELF_NAME
        and model.geom_group[geom] <= 2
        and is_solid(model, geom)
        and model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE
    ]
    parts = [
        (geom, triangles(model, geom, data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)))
        for geom in fixed
    ]
    # As plain numbers: no enumerator equals one of NumPy's, and `in` would find none.
    open_ = {int(mujoco.mjtGeom.mjGEOM_MESH), int(mujoco.mjtGeom.mjGEOM_HFIELD)}
    return Solid(parts, [int(model.geom_type[geom]) not in open_ for geom in fixed])


def body_solid(model: mujoco.MjModel, geoms: Sequence[int]) -> Solid:
    """The geoms of one body, numbered from 0, in its frame."""
    return Solid(
        [(number, _local(model, geom)) for number, geom in enumerate(geoms)],
        [model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH for geom in geoms],
    )


def _local(model: mujoco.MjModel, geom: int) -> Array:
    """Triangles of a geom in the frame of its body."""
    if not is_solid(model, geom):
        return np.zeros((0, 3, 3))
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
    return triangles(model, geom, model.geom_pos[geom], turn.reshape(3, 3))


def is_solid(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom is drawn."""
    material = int(model.geom_matid[geom])
    color = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return bool(color[3] >= SOLID)
