"""Rendering with rays on the processor (Embree): for machines without OpenGL.

What never moves is one scene, built once. Every body that moves has a scene in its own frame,
built when it is seen for the first time and shared by all bodies of the same shape; its rays are
those of the part of the picture that its bounding sphere covers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh
from numpy.typing import NDArray

from usarsim_server.cameras.backend import NEAR, SKY, Shot, Wanted, far_plane
from usarsim_server.cameras.posed_model import Stage
from usarsim_server.cameras.shading import Paint, light_up
from usarsim_server.cameras.view import Eye, Plane
from usarsim_server.simulation.frames import Array, rotation_matrix
from usarsim_server.simulation.model import SHELF_NAME
from usarsim_server.simulation.rays.triangles import shape_key, triangles

Numbers = NDArray[np.int32]

SHAPES_KEPT = 512
"""Bodies of different shapes that are kept ready."""
SHELLS = 4
"""Back faces that a ray passes at most: the inside of the housing that a camera sits in."""
BEGIN = np.float32(NEAR)
"""m ahead of the eye at which its rays begin."""
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

    def cast(self, origin: Array, directions: Plane, begin: Plane | np.float32 = BEGIN) -> Hits:
        """What rays from one point meet; depths are in units of the directions' lengths.

        They begin at some depth, a number or (n, 1).
        """
        return self._cast_on(origin, directions, begin)

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
    return triangles(model, geom, model.geom_pos[geom], rotation_matrix(model.geom_quat[geom]))


def is_solid(model: mujoco.MjModel, geom: int) -> bool:
    """Whether a geom is drawn."""
    material = int(model.geom_matid[geom])
    color = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return bool(color[3] >= SOLID)


class RayBackend:
    """Renders with rays; used by one thread."""

    name = "rays"

    def __init__(self) -> None:
        self._fixed: Solid | None = None
        self._solids: dict[bytes, Solid] = {}
        self._generation = -1

    def render(self, stage: Stage, eye: Eye, wanted: Wanted) -> Shot:
        """What an eye sees of a stage as it is now (see `Backend`)."""
        self._prepare(stage)
        canvas = self._cast(stage, eye)
        shape = (eye.height, eye.width)
        albedo = self._albedo(stage, canvas)
        colors = albedo
        if canvas.hit.size:
            colors = albedo.copy()
            colors[canvas.hit] *= canvas.light(stage)
        return Shot(
            _bytes(colors).reshape(*shape, 3),
            canvas.depth.reshape(shape) if wanted.depth else None,
            _bytes(albedo).reshape(*shape, 3) if wanted.albedo else None,
            canvas.geoms.reshape(shape) if wanted.geoms else None,
        )

    def close(self) -> None:
        """Nothing is held that Python does not free."""

    # -- the model ---------------------------------------------------------------------------

    def _prepare(self, stage: Stage) -> None:
        """Look up everything about a model generation; the scenery is that of the first one."""
        if stage.generation == self._generation and self._fixed is not None:
            return
        model = stage.model
        self._paint = Paint(model)
        if self._fixed is None:
            self._fixed = scenery(model, stage.data)
        painted = [g for g in range(model.ngeom) if is_solid(model, g)]
        moving = model.body_weldid[model.geom_bodyid[painted]] != 0
        self._bodies = tuple(np.unique(model.geom_bodyid[painted][moving]).tolist())
        self._geoms_of = {
            body: [int(g) for g in np.flatnonzero(model.geom_bodyid == body)]
            for body in self._bodies
        }
        self._reach = {body: _reach(model, geoms) for body, geoms in self._geoms_of.items()}
        self._planes = _planes(model)
        self._generation = stage.generation

    def _solid_of(self, model: mujoco.MjModel, body: int) -> Solid:
        geoms = self._geoms_of[body]
        frames = np.hstack([model.geom_pos[geoms], model.geom_quat[geoms]])
        key = shape_key(model, geoms, frames, [is_solid(model, geom) for geom in geoms])
        if key not in self._solids:
            if len(self._solids) >= SHAPES_KEPT:
                self._solids.clear()
            self._solids[key] = body_solid(model, geoms)
        return self._solids[key]

    # -- casting -----------------------------------------------------------------------------

    def _cast(self, stage: Stage, eye: Eye) -> _Canvas:
        assert self._fixed is not None
        position = np.array(eye.pose.position)
        canvas = _Canvas(eye)
        if canvas.cut is None:
            canvas.begin(self._fixed.cast_from_inside(position, canvas.directions))
        else:
            canvas.begin(self._fixed.cast(position, canvas.directions, canvas.cut[:, None]))
        for plane in self._planes:
            canvas.meet(*_cast_plane(stage, canvas, plane, position))
        for body in self._bodies:
            self._cast_body(stage, canvas, body, position)
        canvas.end(SKY * far_plane(stage.model))
        return canvas

    def _cast_body(self, stage: Stage, canvas: _Canvas, body: int, position: Array) -> None:
        model, data = stage.model, stage.data
        geoms = self._geoms_of[body]
        if model.geom_group[geoms[0]] > 2:
            return
        turn = data.xmat[body].reshape(3, 3)
        middle, radius = self._reach[body]
        centre = data.xpos[body] + turn @ middle
        rays = canvas.covered(centre, radius)
        if not len(rays):
            return
        solid = self._solid_of(model, body)
        start = (position - data.xpos[body]) @ turn
        directions = canvas.directions[rays] @ turn.astype(np.float32)
        if canvas.cut is not None:
            hits = solid.cast(start, directions, canvas.cut[rays, None])
            canvas.meet(rays, _of_body(hits, geoms, turn))
            return
        within = float(np.linalg.norm(position - centre)) < radius + NEAR
        hits = (
            solid.cast_from_inside(start, directions) if within else solid.cast(start, directions)
        )
        canvas.meet(rays, _of_body(hits, geoms, turn))

    # -- colours -----------------------------------------------------------------------------

    def _albedo(self, stage: Stage, canvas: _Canvas) -> Plane:
        """Colours (n, 3) in white light; the sky is always that bright."""
        albedo: Plane = np.take(self._paint.colors, canvas.geoms, axis=0, mode="wrap")
        counts = np.bincount(canvas.geoms[canvas.hit], minlength=stage.model.ngeom)
        for geom in self._paint.floors():
            if counts[geom]:
                chosen = np.flatnonzero(canvas.geoms == geom)
                turn = stage.data.geom_xmat[geom].reshape(3, 3)[:, :2].astype(np.float32)
                middle = stage.data.geom_xpos[geom].astype(np.float32)
                places = (canvas.points(chosen) - middle) @ turn
                albedo[chosen] = self._paint.texels(geom, places, canvas.widths(chosen))
        sky = np.flatnonzero(canvas.geoms < 0)
        albedo[sky] = self._paint.sky(canvas.directions[sky])
        return albedo


class _Canvas:
    """What has been met so far along every ray of a picture, pixels row by row.

    Attributes:
        directions: (n, 3), of length 1 along the viewing axis.
        depth: (n,) m. geoms: (n,). normals: (n, 3), on either side.
        hit: numbers of the rays that met anything.
        cut: (n,) m at which rays come below the eye's cut, infinity for those that never do; None
            if it cuts nothing off.
    """

    def __init__(self, eye: Eye) -> None:
        self.eye = eye
        self._rays = eye.rays()
        self._rotation = eye.pose.matrix()
        self.directions = self._rays.directions(self._rotation).reshape(-1, 3)
        self.hit = np.zeros(0, np.intp)
        self.cut: Plane | None = None
        if eye.cuts:
            drop = np.float32(eye.pose.position[2] - eye.cut)
            falling = np.minimum(self.directions[:, 2], np.float32(-1e-9))
            self.cut = np.maximum(-drop / falling, np.float32(NEAR))

    def begin(self, hits: Hits) -> None:
        """Take what all rays hit first."""
        self.depth, self.geoms, self.normals = hits.depths, hits.geoms, hits.normals

    def meet(self, rays: NDArray[np.intp], hits: Hits) -> None:
        """Take what some rays hit where it is nearer."""
        nearer = np.flatnonzero(hits.depths < self.depth[rays])
        chosen = rays[nearer]
        self.depth[chosen] = hits.depths[nearer]
        self.geoms[chosen] = hits.geoms[nearer]
        self.normals[chosen] = hits.normals[nearer]

    def end(self, reach: float) -> None:
        """What is farther away than the sky (m) is not seen."""
        limits = np.float32(reach) / self._rays.lengths().reshape(-1)
        beyond = self.depth > limits
        self.depth[beyond], self.geoms[beyond] = np.inf, -1
        self.hit = np.flatnonzero(self.geoms >= 0)

    def points(self, rays: NDArray[np.intp]) -> Plane:
        """Where (k, 3) some rays hit."""
        position = np.array(self.eye.pose.position, np.float32)
        return position + self.depth[rays, None] * self.directions[rays]

    def widths(self, rays: NDArray[np.intp]) -> Plane:
        """Metres (k,) of surface that one pixel covers where some rays hit."""
        slopes = np.einsum("ij,ij->i", self.normals[rays], self.directions[rays])
        step = np.float32(2.0 * self.eye.slope / self.eye.width)
        widths: Plane = step * self.depth[rays] / np.maximum(np.abs(slopes), np.float32(1e-6))
        return widths

    def light(self, stage: Stage) -> Plane:
        """Light (k, 3) where rays hit."""
        return light_up(
            stage.model,
            stage.data,
            self.normals[self.hit],
            self.directions[self.hit],
            self.depth[self.hit],
            np.array(self.eye.pose.position, np.float32),
        )

    def covered(self, centre: Array, radius: float) -> NDArray[np.intp]:
        """Rays of the rectangle of the picture that holds a sphere."""
        eye = self.eye
        x, y, z = (centre - np.array(eye.pose.position)) @ self._rotation
        if x <= -radius:
            return np.zeros(0, np.intp)
        columns = _interval(x, y, radius, self._rays.left[0])
        rows = _interval(x, z, radius, self._rays.up[:, 0])
        grid = np.arange(rows.start, rows.stop)[:, None] * eye.width
        return (grid + np.arange(columns.start, columns.stop)[None]).ravel()


def _of_body(hits: Hits, geoms: Sequence[int], turn: Array) -> Hits:
    """Hits on a body, which is turned (3, 3), in the world; its geoms are numbers of the model."""
    numbers = np.array([*geoms, -1], np.int32)
    return Hits(hits.depths, numbers[hits.geoms], hits.normals @ turn.T.astype(np.float32))


def _interval(x: float, y: float, radius: float, slopes: Plane) -> slice:
    """Indices of falling slopes between the tangents to a disc; all if the eye is inside."""
    square = x * x + y * y - radius * radius
    half = math.asin(min(1.0, radius / math.sqrt(max(square + radius * radius, 1e-12))))
    angle = math.atan2(y, x)
    low, high = angle - half, angle + half
    if square <= 0.0 or high - low >= math.pi / 2 or max(abs(low), abs(high)) > 1.5:
        lowest = -np.inf if square <= 0.0 or low < -1.5 else math.tan(low)
        highest = np.inf if square <= 0.0 or high > 1.5 else math.tan(high)
    else:
        lowest, highest = math.tan(low), math.tan(high)
    rising = slopes[::-1]
    first = int(np.searchsorted(rising, lowest))
    last = int(np.searchsorted(rising, highest, side="right"))
    return slice(len(slopes) - last, len(slopes) - first)


def _planes(model: mujoco.MjModel) -> list[int]:
    kind = mujoco.mjtGeom.mjGEOM_PLANE
    seen = (model.geom_type == kind) & (model.geom_group <= 2)
    return [int(g) for g in np.flatnonzero(seen) if is_solid(model, int(g))]


def _cast_plane(
    stage: Stage, canvas: _Canvas, geom: int, position: Array
) -> tuple[NDArray[np.intp], Hits]:
    """Hits of a plane as large as it is drawn; it is seen from above only."""
    turn = stage.data.geom_xmat[geom].reshape(3, 3)
    middle = stage.data.geom_xpos[geom]
    normal = turn[:, 2].astype(np.float32)
    height = float((position - middle) @ turn[:, 2])
    slope = canvas.directions @ normal
    rays = np.flatnonzero(slope < -1e-9) if height > 0.0 else np.zeros(0, np.intp)
    depths = (np.float32(-height) / slope[rays]).astype(np.float32)
    local = (position - middle) @ turn[:, :2]
    for axis in range(2):
        half = float(stage.model.geom_size[geom, axis])
        if half > 0.0:
            ways = canvas.directions[rays] @ turn[:, axis].astype(np.float32)
            depths[np.abs(local[axis] + depths * ways) > half] = np.inf
    depths[depths < (NEAR if canvas.cut is None else canvas.cut[rays])] = np.inf
    found = np.where(np.isfinite(depths), geom, -1).astype(np.int32)
    return rays, Hits(depths, found, np.broadcast_to(normal, (len(rays), 3)))


def _reach(model: mujoco.MjModel, geoms: Sequence[int]) -> tuple[Array, float]:
    """Middle (3,) and radius of a sphere around the geoms of a body, in its frame."""
    places, radii = model.geom_pos[geoms], model.geom_rbound[geoms]
    middle = (places.min(axis=0) + places.max(axis=0)) / 2.0
    radius = float((np.linalg.norm(places - middle, axis=1) + radii).max())
    return middle, radius


def _bytes(colors: Plane) -> NDArray[np.uint8]:
    return (np.clip(colors, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
