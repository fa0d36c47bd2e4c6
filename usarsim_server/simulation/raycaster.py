"""Casting rays: Embree for the static world, MuJoCo's own rays for everything that moves.

The static scene is built once per world from true triangles; infinite planes are solved by
formula. Robots and movable objects are cast against their exact geometry in a private copy of the
model, and only for fans that can reach them at all.
"""

from __future__ import annotations

import threading
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.simulation.model import SHELF_NAME, CompiledWorld
from usarsim_server.simulation.rays import RayFan, RayHits
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.simulation.tessellation import triangles

__all__ = ["DynamicGeometry", "StaticGeometry", "cast"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    normal: Array
    offset: float


class _TriangleScene:
    """An Embree scene together with the unit normals of its triangles."""

    def __init__(self, parts: Sequence[Array]) -> None:
        faces = np.concatenate(parts) if parts else np.zeros((0, 3, 3))
        self._scene = None
        if len(faces):
            self._scene = rtcore_scene.EmbreeScene()
            TriangleMesh(self._scene, faces.astype(np.float32))
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        self._normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]

    def cast(self, origins: Array, directions: Array, normals: bool) -> tuple[Array, Array | None]:
        count = len(origins)
        if self._scene is None:
            return np.full(count, np.inf), np.zeros((count, 3)) if normals else None
        start, way = origins.astype(np.float32), directions.astype(np.float32)
        answer = self._scene.run(start, way, output=1)
        face = answer["primID"]
        hit = face >= 0
        distances = np.where(hit, answer["tfar"].astype(np.float64), np.inf)
        if not normals:
            return distances, None
        return distances, np.where(hit[:, None], self._normals[np.where(hit, face, 0)], 0.0)


class StaticGeometry:
    """All geometry that never moves, shared by all threads."""

    def __init__(self, world: CompiledWorld) -> None:
        model = world.model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        solid: list[Array] = []
        glass: list[Array] = []
        self._planes: list[_Plane] = []
        for geom in _static_geoms(model):
            pos, mat = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
                self._planes.append(_Plane(mat[:, 2].copy(), float(mat[:, 2] @ pos)))
            else:
                part = triangles(model, geom, pos, mat)
                (glass if _is_glass(model, geom) else solid).append(part)
        self._full = _TriangleScene([*solid, *glass])
        self._clear = _TriangleScene(solid) if glass else self._full

    def cast(
        self, origins: Array, directions: Array, normals: bool, through_glass: bool
    ) -> tuple[Array, Array | None]:
        """Distances (n,) and, if asked for, surface normals (n, 3, unsigned); inf is a miss."""
        scene = self._clear if through_glass else self._full
        distances, surface = scene.cast(origins, directions, normals)
        for plane in self._planes:
            slope = directions @ plane.normal
            with np.errstate(divide="ignore", invalid="ignore"):
                way = (plane.offset - origins @ plane.normal) / slope
            nearer = (way >= 0.0) & (way < distances) & (slope < 0.0)
            distances = np.where(nearer, way, distances)
            if surface is not None:
                surface = np.where(nearer[:, None], plane.normal, surface)
        return distances, surface


class DynamicGeometry:
    """Everything that moves, in a private copy of one model generation; guarded by a lock."""

    def __init__(self, world: CompiledWorld) -> None:
        self.generation = world.generation
        self._lock = threading.Lock()
        self._model = model = _ray_model(world.model)
        self._data = mujoco.MjData(model)
        self._snapshot: Snapshot | None = None
        self._trees, self._radius, self._tree_of_root = _bounding_spheres(model)
        robots = {layout.base for layout in world.layouts}
        self._is_robot = np.array([root in robots for root in self._trees], dtype=bool)
        self._layouts = world.layouts

    def cast(
        self, fans: Sequence[RayFan], snapshot: Snapshot, robot: int | None
    ) -> list[RayHits | None]:
        """Hits on moving geometry per fan (None: nothing in reach), the robot's own hidden."""
        with self._lock:
            self._update(snapshot)
            hidden = np.zeros(0, dtype=np.intp)
            own = -1
            if robot is not None and robot in snapshot.layouts:
                layout = snapshot.layouts[robot]
                hidden, own = layout.geoms, self._tree_of_root[layout.base]
            answers: list[RayHits | None] = [None] * len(fans)
            self._model.geom_rgba[hidden, 3] = 0.0
            try:
                for index in self._reachable(fans, own):
                    answers[index] = self._cast_fan(fans[index])
            finally:
                self._model.geom_rgba[hidden, 3] = 1.0
        return answers

    def _update(self, snapshot: Snapshot) -> None:
        if snapshot is self._snapshot:
            return
        self._data.qpos[:] = snapshot.qpos
        mujoco.mj_kinematics(self._model, self._data)
        self._snapshot = snapshot
        active = {layout.base for layout in snapshot.layouts.values()}
        self._present = ~self._is_robot | np.isin(self._trees, list(active))
        for layout in self._layouts:
            self._model.geom_rgba[layout.geoms, 3] = 1.0 if layout.base in active else 0.0

    def _reachable(self, fans: Sequence[RayFan], own: int) -> list[int]:
        """Fans whose cone and range touch the bounding sphere of something that moves."""
        present = self._present.copy()
        if own >= 0:
            present[own] = False
        trees = np.flatnonzero(present)
        if not len(trees) or not fans:
            return []
        centres, radii = self._data.xpos[self._trees[trees]], self._radius[trees]
        origins = np.array([fan.origin for fan in fans])
        axes, half = _cones(fans)
        ranges = np.array([fan.max_range for fan in fans])
        offset = centres[None] - origins[:, None]
        distance = np.linalg.norm(offset, axis=2)
        within = distance - radii[None] <= ranges[:, None]
        safe = np.maximum(distance, 1e-9)
        cosine = np.einsum("fti,fi->ft", offset, axes) / safe
        spread = np.arcsin(np.minimum(1.0, radii[None] / safe))
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        seen = within & ((angle - spread <= half[:, None]) | (distance <= radii[None]))
        return [int(index) for index in np.flatnonzero(seen.any(axis=1))]

    def _cast_fan(self, fan: RayFan) -> RayHits:
        count = len(fan.directions)
        distances = np.empty(count)
        geoms = np.empty(count, dtype=np.int32)
        normals = np.zeros((count, 3)) if fan.normals else None
        mujoco.mj_multiRay(
            self._model,
            self._data,
            np.ascontiguousarray(fan.origin, dtype=float),
            np.ascontiguousarray(fan.directions, dtype=float).reshape(-1),
            None,
            0,
            -1,
            geoms,
            distances,
            None if normals is None else normals.reshape(-1),
            count,
            fan.max_range,
        )
        return RayHits(np.where(geoms < 0, np.inf, distances), normals)


def cast(
    fans: Sequence[RayFan],
    snapshot: Snapshot,
    robot: int | None,
    static: StaticGeometry,
    dynamic: DynamicGeometry,
) -> list[RayHits]:
    """Answer fans against the whole world as it is in a snapshot, the robot itself left out."""
    moving = dynamic.cast(fans, snapshot, robot)
    return [
        _merge(fan, fixed, moved)
        for fan, fixed, moved in zip(fans, _cast_static(fans, static), moving, strict=True)
    ]


def _cast_static(fans: Sequence[RayFan], static: StaticGeometry) -> list[RayHits]:
    answers: list[RayHits | None] = [None] * len(fans)
    for through in (False, True):
        chosen = [i for i, fan in enumerate(fans) if fan.through_glass is through]
        if not chosen:
            continue
        counts = [len(fans[i].directions) for i in chosen]
        origins = np.repeat(np.array([fans[i].origin for i in chosen]), counts, axis=0)
        directions = np.concatenate([fans[i].directions for i in chosen])
        wanted = any(fans[i].normals for i in chosen)
        distances, normals = static.cast(origins, directions, wanted, through)
        cuts = np.cumsum(counts)[:-1]
        parts = np.split(distances, cuts)
        surfaces = np.split(normals, cuts) if normals is not None else [None] * len(chosen)
        for i, part, surface in zip(chosen, parts, surfaces, strict=True):
            answers[i] = RayHits(part, surface if fans[i].normals else None)
    return [answer for answer in answers if answer is not None]


def _merge(fan: RayFan, fixed: RayHits, moving: RayHits | None) -> RayHits:
    distances, normals = fixed.distances, fixed.normals
    if moving is not None:
        nearer = moving.distances < distances
        distances = np.where(nearer, moving.distances, distances)
        if normals is not None and moving.normals is not None:
            normals = np.where(nearer[:, None], moving.normals, normals)
    missed = distances > fan.max_range
    distances = np.where(missed, np.inf, distances)
    if normals is not None:
        away = np.einsum("ij,ij->i", normals, fan.directions) > 0.0
        normals = np.where(away[:, None], -normals, normals)
        normals = np.where(missed[:, None], 0.0, normals)
    return RayHits(distances, normals)


def _static_geoms(model: mujoco.MjModel) -> list[int]:
    return [
        geom
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] == 0
        and model.geom(geom).name != SHELF_NAME
        and _visible(model, geom)
    ]


def _visible(model: mujoco.MjModel, geom: int) -> bool:
    material = model.geom_matid[geom]
    color = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return bool(color[3] > 0.0)


def _is_glass(model: mujoco.MjModel, geom: int) -> bool:
    material = model.geom_matid[geom]
    names = model.geom(geom).name + (model.mat(material).name if material >= 0 else "")
    return any(word in names.lower() for word in ("glass", "trans"))


def _ray_model(model: mujoco.MjModel) -> mujoco.MjModel:
    """A private copy in which nothing sleeps and every moving geom can be hidden by its colour."""
    copy: mujoco.MjModel = model.__copy__()
    copy.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    moving = copy.body_weldid[copy.geom_bodyid] != 0
    copy.geom_matid[moving] = -1
    copy.geom_rgba[moving, 3] = 1.0
    return copy


def _bounding_spheres(model: mujoco.MjModel) -> tuple[NDArray[np.intp], Array, dict[int, int]]:
    """Root bodies of all moving trees and the radius around each root that holds its geoms."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    radius: dict[int, float] = {}
    for geom in range(model.ngeom):
        body = model.geom_bodyid[geom]
        if model.body_weldid[body] == 0:
            continue
        root = int(model.body_rootid[body])
        reach = float(np.linalg.norm(data.geom_xpos[geom] - data.xpos[root]))
        radius[root] = max(radius.get(root, 0.0), reach + float(model.geom_rbound[geom]))
    roots = np.array(sorted(radius), dtype=np.intp)
    radii = np.array([radius[int(root)] for root in roots])
    return roots, radii, {int(root): index for index, root in enumerate(roots)}


def _cones(fans: Sequence[RayFan]) -> tuple[Array, Array]:
    """Axis (f, 3) and half angle (f,) of a cone around the rays of each fan."""
    axes = np.empty((len(fans), 3))
    half = np.empty(len(fans))
    for index, fan in enumerate(fans):
        mean = fan.directions.mean(axis=0)
        norm = float(np.linalg.norm(mean))
        if norm < 0.1:
            axes[index], half[index] = (1.0, 0.0, 0.0), np.pi
            continue
        axes[index] = mean / norm
        half[index] = np.arccos(np.clip((fan.directions @ axes[index]).min(), -1.0, 1.0))
    return axes, half
