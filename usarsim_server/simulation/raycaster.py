"""Casting rays: Embree for the static world, MuJoCo's own rays for everything that moves.

The static scene is built once per world from true triangles; infinite planes are solved by
formula. Robots and movable objects are cast against their exact geometry in a private copy of the
model, and only for fans that can reach them at all.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import mujoco
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.simulation.bundles import cast_some
from usarsim_server.simulation.culling import bounding_spheres, cones, starts, touching
from usarsim_server.simulation.glass import is_glass
from usarsim_server.simulation.model import SHELF_NAME, CompiledWorld
from usarsim_server.simulation.movers import mocap_bodies
from usarsim_server.simulation.objects import Names, Objects, geom_names
from usarsim_server.simulation.rays import RayFan, RayHits, SceneryHit
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.simulation.tessellation import triangles

__all__ = ["DynamicGeometry", "StaticGeometry", "cast", "cast_scenery"]

Array = NDArray[np.float64]

SEEN_GROUPS = 3
"""Geoms of groups 0 to 2 are seen, as by MuJoCo's renderers; the others only collide."""


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    geom: int
    normal: Array
    offset: float


@dataclass(frozen=True, slots=True, eq=False)
class _Surfaces:
    """What rays met: distances (n,), inf for a miss; normals (n, 3) and names (n,) if asked for."""

    distances: Array
    normals: Array | None = None
    names: Names | None = None


@dataclass(frozen=True, slots=True, eq=False)
class _Spheres:
    """Centres (t, 3) and radii (t,), m."""

    centres: Array
    radii: Array


class _TriangleScene:
    """An Embree scene together with the unit normals and the geoms of its triangles."""

    def __init__(self, parts: Sequence[tuple[int, Array]]) -> None:
        faces = np.concatenate([np.zeros((0, 3, 3)), *(part for _, part in parts)])
        self._geoms = np.repeat([geom for geom, _ in parts], [len(part) for _, part in parts])
        self._scene = None
        if len(faces):
            self._scene = rtcore_scene.EmbreeScene()
            TriangleMesh(self._scene, faces.astype(np.float32))
            # The first ray builds the tree; let nobody wait for that later.
            self._scene.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
        normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
        self._normals = normals / np.maximum(np.linalg.norm(normals, axis=1), 1e-12)[:, None]

    def cast(self, origins: Array, directions: Array) -> tuple[Array, NDArray[np.int32]]:
        """Distances (n,) and triangles (n,), -1 for a miss."""
        count = len(origins)
        if self._scene is None:
            return np.full(count, np.inf), np.full(count, -1, dtype=np.int32)
        start, way = origins.astype(np.float32), directions.astype(np.float32)
        answer = self._scene.run(start, way, output=1)
        faces = answer["primID"]
        return np.where(faces >= 0, answer["tfar"].astype(np.float64), np.inf), faces

    def normals(self, faces: NDArray[np.int32]) -> Array:
        """Unit normals (n, 3) of triangles, zero for a miss."""
        hit = faces >= 0
        normals = np.zeros((len(faces), 3))
        normals[hit] = self._normals[faces[hit]]
        return normals

    def geoms(self, faces: NDArray[np.int32]) -> NDArray[np.intp]:
        """Geom ids (n,) of triangles, -1 for a miss."""
        hit = faces >= 0
        geoms = np.full(len(faces), -1, dtype=np.intp)
        geoms[hit] = self._geoms[faces[hit]]
        return geoms


class StaticGeometry:
    """All geometry that never moves, shared by all threads."""

    def __init__(self, world: CompiledWorld) -> None:
        model = world.model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        solid: list[tuple[int, Array]] = []
        glass: list[tuple[int, Array]] = []
        self._names = geom_names(model)
        self._planes: list[_Plane] = []
        for geom in _static_geoms(model):
            pos, mat = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
                self._planes.append(_Plane(geom, mat[:, 2].copy(), float(mat[:, 2] @ pos)))
            else:
                part = (geom, triangles(model, geom, pos, mat))
                (glass if is_glass(model, geom) else solid).append(part)
        self._full = _TriangleScene([*solid, *glass])
        self._clear = _TriangleScene(solid) if glass else self._full

    def cast(
        self,
        origins: Array,
        directions: Array,
        *,
        normals: bool = False,
        identify: bool = False,
        through_glass: bool = False,
    ) -> _Surfaces:
        """Cast rays (n, 3); normals are unsigned."""
        scene = self._clear if through_glass else self._full
        distances, faces = scene.cast(origins, directions)
        surface = scene.normals(faces) if normals else None
        geoms = scene.geoms(faces) if identify else None
        for plane in self._planes:
            slope = directions @ plane.normal
            with np.errstate(divide="ignore", invalid="ignore"):
                way = (plane.offset - origins @ plane.normal) / slope
            nearer = (way >= 0.0) & (way < distances) & (slope < 0.0)
            distances = np.where(nearer, way, distances)
            if surface is not None:
                surface[nearer] = plane.normal
            if geoms is not None:
                geoms[nearer] = plane.geom
        return _Surfaces(distances, surface, None if geoms is None else self._names[geoms])

    def first_hit(self, origin: Array, direction: Array, reach: float) -> SceneryHit | None:
        """What a single ray meets first; None if there is nothing within reach.

        Args:
            origin: (3,) m. direction: (3,) unit vector. reach: m.
        """
        distances, faces = self._full.cast(origin[None], direction[None])
        distance, geom, normal = float(distances[0]), -1, np.zeros(3)
        if faces[0] >= 0:
            geom, normal = int(self._full.geoms(faces)[0]), self._full.normals(faces)[0]
        for plane in self._planes:
            slope = float(direction @ plane.normal)
            if slope < 0.0:
                way = (plane.offset - float(origin @ plane.normal)) / slope
                if 0.0 <= way < distance:
                    distance, geom, normal = way, plane.geom, plane.normal
        if geom < 0 or distance > reach:
            return None
        entering = float(normal @ direction) <= 0.0
        return SceneryHit(distance, geom, self._names[geom], entering)


class DynamicGeometry:
    """Everything that moves, in a private copy of one model generation; guarded by a lock.

    Attributes:
        generation: of the model.
        objects: names and facts of everything in that generation.
    """

    def __init__(self, world: CompiledWorld) -> None:
        self.generation = world.generation
        self.objects = Objects(world)
        self._lock = threading.Lock()
        self._model = model = _ray_model(world.model)
        self._alpha = model.geom_rgba[:, 3].copy()
        self._data = mujoco.MjData(model)
        self._snapshot: Snapshot | None = None
        self._trees, self._radius, self._tree_of_root = bounding_spheres(model)
        robots = {layout.base for layout in world.layouts}
        self._is_robot = np.array([root in robots for root in self._trees], dtype=bool)
        self._layouts = world.layouts
        self._mocap = mocap_bodies(model)
        moving = np.flatnonzero(model.body_weldid[model.geom_bodyid] != 0)
        self._glass = np.array(
            [geom for geom in moving.tolist() if is_glass(world.model, geom)], dtype=np.intp
        )

    def cast(
        self, fans: Sequence[RayFan], snapshot: Snapshot, robot: int | None
    ) -> list[_Surfaces | None]:
        """Hits on moving geometry per fan (None: nothing in reach), the robot's own hidden."""
        with self._lock:
            self._update(snapshot)
            hidden = np.zeros(0, dtype=np.intp)
            own = -1
            if robot is not None and robot in snapshot.layouts:
                layout = snapshot.layouts[robot]
                hidden, own = layout.geoms, self._tree_of_root[layout.base]
            answers: list[_Surfaces | None] = [None] * len(fans)
            self._model.geom_rgba[hidden, 3] = 0.0
            try:
                trees = self._trees_seen(own)
                for index in self._reachable(fans, trees):
                    with self._seen_through(fans[index].through_glass):
                        answers[index] = self._cast_fan(fans[index], trees)
            finally:
                self._model.geom_rgba[hidden, 3] = self._alpha[hidden]
        return answers

    def _update(self, snapshot: Snapshot) -> None:
        if snapshot is self._snapshot:
            return
        self._data.qpos[:] = snapshot.qpos
        self._data.mocap_pos[:] = snapshot.xpos[self._mocap]
        self._data.mocap_quat[:] = snapshot.xquat[self._mocap]
        mujoco.mj_kinematics(self._model, self._data)
        self._snapshot = snapshot
        active = {layout.base for layout in snapshot.layouts.values()}
        self._present = ~self._is_robot | np.isin(self._trees, list(active))
        for layout in self._layouts:
            shown = self._alpha[layout.geoms] if layout.base in active else 0.0
            self._model.geom_rgba[layout.geoms, 3] = shown

    def _trees_seen(self, own: int) -> _Spheres:
        """Bounding spheres of everything that moves and is there, but one tree."""
        present = self._present.copy()
        if own >= 0:
            present[own] = False
        trees = np.flatnonzero(present)
        return _Spheres(self._data.xpos[self._trees[trees]], self._radius[trees])

    def _reachable(self, fans: Sequence[RayFan], trees: _Spheres) -> list[int]:
        """Fans whose cone and range touch a sphere."""
        centres, radii = trees.centres, trees.radii
        if not len(radii) or not fans:
            return []
        origins, spreads = starts(fans)
        axes, half = cones(fans)
        reach = radii[None] + spreads[:, None]
        ranges = np.array([fan.max_range for fan in fans])
        offset = centres[None] - origins[:, None]
        distance = np.linalg.norm(offset, axis=2)
        within = distance - reach <= ranges[:, None]
        safe = np.maximum(distance, 1e-9)
        cosine = np.einsum("fti,fi->ft", offset, axes) / safe
        spread = np.arcsin(np.minimum(1.0, reach / safe))
        angle = np.arccos(np.clip(cosine, -1.0, 1.0))
        seen = within & ((angle - spread <= half[:, None]) | (distance <= reach))
        return [int(index) for index in np.flatnonzero(seen.any(axis=1))]

    @contextmanager
    def _seen_through(self, through: bool) -> Iterator[None]:
        """Inside, moving glass is invisible if it is to be."""
        alpha = self._model.geom_rgba[self._glass, 3]
        if through:
            self._model.geom_rgba[self._glass, 3] = 0.0
        try:
            yield
        finally:
            self._model.geom_rgba[self._glass, 3] = alpha

    def _cast_fan(self, fan: RayFan, trees: _Spheres) -> _Surfaces | None:
        """Hits of those rays that can hit at all, None if there are none."""
        rays = np.flatnonzero(touching(fan, trees.centres, trees.radii))
        if not len(rays):
            return None
        count = len(fan.directions)
        distances = np.full(count, np.inf)
        geoms = np.full(count, -1, dtype=np.int32)
        distances[rays], geoms[rays], facing = cast_some(self._model, self._data, fan, rays)
        normals = None
        if facing is not None:
            normals = np.zeros((count, 3))
            normals[rays] = facing
        names = self.objects.names[geoms] if fan.identify else None
        return _Surfaces(distances, normals, names)


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


def cast_scenery(fans: Sequence[RayFan], static: StaticGeometry) -> list[RayHits]:
    """Answer fans against what never moves."""
    fixed = _cast_static(fans, static)
    return [_merge(fan, surfaces, None) for fan, surfaces in zip(fans, fixed, strict=True)]


def _cast_static(fans: Sequence[RayFan], static: StaticGeometry) -> list[_Surfaces]:
    answers: list[_Surfaces | None] = [None] * len(fans)
    for through in (False, True):
        chosen = [i for i, fan in enumerate(fans) if fan.through_glass is through]
        if not chosen:
            continue
        origins = np.concatenate(
            [np.broadcast_to(fans[i].origin, fans[i].directions.shape) for i in chosen]
        )
        directions = np.concatenate([fans[i].directions for i in chosen])
        answer = static.cast(
            origins,
            directions,
            normals=any(fans[i].normals for i in chosen),
            identify=any(fans[i].identify for i in chosen),
            through_glass=through,
        )
        end = 0
        for i in chosen:
            start, end = end, end + len(fans[i].directions)
            answers[i] = _cut(answer, fans[i], slice(start, end))
    return [answer for answer in answers if answer is not None]


def _cut(answer: _Surfaces, fan: RayFan, part: slice) -> _Surfaces:
    """The rows of a batch that answer one fan, and of them what it asked for."""
    normals = answer.normals[part] if answer.normals is not None and fan.normals else None
    names = answer.names[part] if answer.names is not None and fan.identify else None
    return _Surfaces(answer.distances[part], normals, names)


def _merge(fan: RayFan, fixed: _Surfaces, moving: _Surfaces | None) -> RayHits:
    distances, normals, names = fixed.distances, fixed.normals, fixed.names
    if moving is not None:
        nearer = moving.distances < distances
        distances = np.where(nearer, moving.distances, distances)
        if normals is not None and moving.normals is not None:
            normals = np.where(nearer[:, None], moving.normals, normals)
        if names is not None and moving.names is not None:
            names = np.where(nearer, moving.names, names)
    missed = distances > fan.max_range
    distances = np.where(missed, np.inf, distances)
    if normals is not None:
        away = np.einsum("ij,ij->i", normals, fan.directions) > 0.0
        normals = np.where(away[:, None], -normals, normals)
        normals = np.where(missed[:, None], 0.0, normals)
    if names is None:
        return RayHits(distances, normals)
    names = names.copy()
    names[missed] = None
    return RayHits(distances, normals, tuple(names.tolist()))


def _static_geoms(model: mujoco.MjModel) -> list[int]:
    return [
        geom
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] == 0
        and model.geom(geom).name != SHELF_NAME
        and _visible(model, geom)
    ]


def _visible(model: mujoco.MjModel, geom: int) -> bool:
    if model.geom_group[geom] >= SEEN_GROUPS:
        return False
    material = model.geom_matid[geom]
    color = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return bool(color[3] > 0.0)


def _ray_model(model: mujoco.MjModel) -> mujoco.MjModel:
    """A private copy in which nothing sleeps and every moving geom can be hidden by its colour."""
    copy: mujoco.MjModel = model.__copy__()
    copy.opt.enableflags &= ~int(mujoco.mjtEnableBit.mjENBL_SLEEP)
    for geom in np.flatnonzero(copy.body_weldid[copy.geom_bodyid] != 0).tolist():
        copy.geom_rgba[geom, 3] = 1.0 if _visible(model, geom) else 0.0
        copy.geom_matid[geom] = -1
    return copy
