"""Triangles of MuJoCo geometry, and an Embree scene that knows which geom each of them is of.

Flat shapes and meshes are exact. Round shapes are tessellated so finely that a facet lies less
than a tolerance inside the true surface, up to a radius of some metres (`MAX_SEGMENTS`); a scene
moves hits on facets out to where the ray meets the round surface.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from embreex import rtcore_scene
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.rays.embree import add_mesh, device, handle
from usarsim_server.simulation.rays.records import SceneRecord

TOLERANCE = 5e-4
"""m between a tessellated and the true surface."""
MAX_SEGMENTS = 256
"""Of a full circle: enough for 6 m of radius, 3 m where a surface is curved both ways."""
ROUNDED = 1e-6
"""Part by which rays go on beyond their reach: more than single precision may cut off."""
FAR = 1e37
"""m at which a ray ends for Embree that has no end."""
EDGE = 1e-5
"""m by which boxes around scenes are taken larger, which are of single precision."""
_ASKEW: Array = np.array([[2.0, -6.0, 3.0], [6.0, 3.0, 2.0], [-3.0, 2.0, 6.0]]) / 7.0
"""A turn of balls, by which no corner lies on an axis (see `_revolve`)."""
_PHASE = 0.123
"""rad by which the corners of rings are off the axes, for the same reason."""
_QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Faces of a box whose corners are numbered by the signs of x, y, z (z fastest)."""


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

    def put(self, rays: Numbers, other: Surfaces) -> None:
        """Set what some rays met."""
        self.distances[rays], self.geoms[rays] = other.distances, other.geoms
        if self.normals is not None and other.normals is not None:
            self.normals[rays] = other.normals


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
        self._shapes = [shape for _, shape in rounds]
        # The shape that each part really has, -1 if it has none; one more at the end, for a miss.
        self._rounds = np.full(max((part for part, _ in parts), default=0) + 2, -1, dtype=np.intp)
        self._rounds[[part for part, _ in rounds]] = np.arange(len(rounds))
        self.embree: rtcore_scene.EmbreeScene | None = None
        """Embree's scene; None if there is no surface at all."""
        if len(faces):
            self.embree = rtcore_scene.EmbreeScene(device())
            add_mesh(self.embree, faces.astype(np.float32))
            # The first ray builds the tree; let nobody wait for that later.
            self.embree.run(np.zeros((1, 3), np.float32), np.ones((1, 3), np.float32))
        self._normals = _normals(faces)
        corners = faces.reshape(-1, 3).T if len(faces) else np.zeros((3, 1))
        self._box = np.array([[one.min() for one in corners], [one.max() for one in corners]])
        self.centre: Array = (self._box[0] + self._box[1]) / 2.0
        """Middle (3,) of a sphere that holds everything, m."""
        off = [one - middle for one, middle in zip(corners, self.centre, strict=True)]
        self.radius = math.sqrt(float((off[0] ** 2 + off[1] ** 2 + off[2] ** 2).max()))
        """Of that sphere, m."""

    def cast(
        self,
        origins: Array,
        directions: Array,
        *,
        normals: bool = False,
        reach: Array | None = None,
    ) -> Surfaces:
        """Cast rays from (n, 3) along unit vectors (n, 3), in the scene's frame.

        What is further away than `reach` (n,), m, may be left out, which is faster.
        """
        if self.embree is None:
            missed = np.full(len(origins), -1, dtype=np.intp)
            return self._hits(np.full(len(origins), np.inf), missed, normals)
        ends = None
        if reach is not None:
            ends = np.minimum(reach * (1.0 + ROUNDED), FAR).astype(np.float32)
        answer = self.embree.run(
            origins.astype(np.float32, order="C"),
            directions.astype(np.float32, order="C"),
            dists=ends,
            output=1,
        )
        faces = answer["primID"]
        distances = answer["tfar"].astype(np.float64)
        distances[faces < 0] = np.inf
        hits = self._hits(distances, faces, normals)
        if self._shapes:
            shapes = self._rounds.take(hits.geoms, mode="wrap")
            for number in np.unique(shapes[shapes >= 0]).tolist():
                rays = np.flatnonzero(shapes == number)
                _round_off(hits, rays, self._shapes[number], origins, directions)
        return hits

    @cached_property
    def record(self) -> SceneRecord:
        """The same for compiled code."""
        shapes = [[*one.centre, *one.turn.ravel(), *one.axes] for one in self._shapes]
        return SceneRecord(
            embree=None if self.embree is None else handle(self.embree),
            parts=self._parts,
            normals=self._normals,
            rounds=self._rounds,
            shapes=np.array(shapes) if shapes else None,
            box=self._box + np.array([[-EDGE], [EDGE]]),
        )

    def _hits(self, distances: Array, faces: NDArray[np.signedinteger], normals: bool) -> Surfaces:
        facing = self._normals.take(faces, axis=0, mode="wrap") if normals else None
        return Surfaces(distances, self._parts.take(faces, mode="wrap"), facing)


def _normals(faces: Array) -> Array:
    """Unit normals of triangles (n, 3, 3), and zeros: those of a miss."""
    # Column by column: that is how scenes of 300,000 triangles are there at once.
    a, b, c = faces.transpose(1, 2, 0)
    (ux, uy, uz), (vx, vy, vz) = b - a, c - a
    x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = np.maximum(np.sqrt(x * x + y * y + z * z), 1e-12)
    found = np.zeros((len(faces) + 1, 3))
    for column, part in enumerate((x, y, z)):
        np.divide(part, length, out=found[:-1, column])
    return found


def _round_off(
    hits: Surfaces, rays: Numbers, shape: RoundPart, origins: Array, directions: Array
) -> None:
    """Move hits on facets, which lie inside a round surface, out to where the ray meets it."""
    # In a frame where the surface is the unit sphere.
    start = turned_back(shape.turn, origins[rays] - shape.centre) / shape.axes
    way = turned_back(shape.turn, directions[rays]) / shape.axes
    a, b, c = products(way, way), products(start, way), products(start, start) - 1.0
    root = np.sqrt(np.maximum(b * b - a * c, 0.0))
    near, far = (-b - root) / a, (-b + root) / a
    distance = np.where(near >= 0.0, near, far)
    hits.distances[rays] = distance
    if hits.normals is not None:
        outward = turned_back(shape.turn.T, (start + distance[:, None] * way) / shape.axes)
        hits.normals[rays] = outward / np.sqrt(products(outward, outward))[:, None]


def products(vectors: Array, others: Array) -> Array:
    """Scalar products (k,) of vectors (k, 3) with as many others, or with one (3,).

    Unlike those of a matrix they are rounded alike in every batch, and on every processor.
    """
    (x, y, z), (a, b, c) = vectors.T, others.T
    answer: Array = x * a + y * b + z * c
    return answer


def turned_back(turn: Array, vectors: Array) -> Array:
    """Vectors (k, 3) in frames that are turned by a matrix (3, 3), or by as many (3, 3, k)."""
    # Column by column, which is several times as fast as by rows of three.
    found = np.empty_like(vectors)
    for axis in range(3):
        found[:, axis] = products(vectors, turn[:, axis].T)
    return found


def triangles(
    model: mujoco.MjModel, geom: int, pos: Array, mat: Array, tolerance: float = TOLERANCE
) -> Array:
    """Triangles (n, 3, 3) of a geom in the world frame, m.

    Args:
        model: the compiled model.
        geom: geom id; planes have no finite triangles and give an empty array.
        pos: (3,) geom position. mat: (3, 3) geom orientation.
        tolerance: of round shapes, m.
    """
    local = _local_triangles(model, geom, tolerance)
    return local @ mat.T + pos if len(local) else np.zeros((0, 3, 3))


def triangles_of_all(
    model: mujoco.MjModel, geoms: Sequence[int], positions: Array, turns: Array
) -> tuple[Array, NDArray[np.intp]]:
    """Triangles (n, 3, 3) of many geoms in the world frame, and which geom each belongs to.

    Positions (ngeom, 3) and turns (ngeom, 9 or 3, 3) are those of all geoms.
    """
    chosen = np.asarray(geoms, dtype=np.intp)
    turns = turns.reshape(-1, 3, 3)
    boxes = chosen[model.geom_type[chosen] == int(mujoco.mjtGeom.mjGEOM_BOX)]
    unit = _box(np.ones(3)).reshape(-1, 3)
    corners = np.einsum("gij,gkj->gki", turns[boxes], unit * model.geom_size[boxes][:, None])
    corners += positions[boxes][:, None]
    found = [corners.reshape(-1, 3, 3)]
    owners = [np.repeat(boxes, len(unit) // 3)]
    local: dict[int, Array] = {}
    for geom in chosen[model.geom_type[chosen] != int(mujoco.mjtGeom.mjGEOM_BOX)].tolist():
        data = int(model.geom_dataid[geom])
        if data >= 0 and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_MESH:
            if data not in local:
                local[data] = _mesh(model, data)
            part = local[data] @ turns[geom].T + positions[geom]
        else:
            part = triangles(model, geom, positions[geom], turns[geom])
        if len(part):
            found.append(part)
            owners.append(np.full(len(part), geom, dtype=np.intp))
    return np.concatenate(found), np.concatenate(owners)


def shape_key(
    model: mujoco.MjModel, geoms: Sequence[int], frames: Array, shown: Sequence[bool]
) -> bytes:
    """Equal for things that look the same in their own frames, in any model.

    Args:
        model: the compiled model.
        geoms: of one thing, g in number.
        frames: (g, any) where each is in the frame of the thing, in numbers.
        shown: which of them are there to be seen.
    """
    arrays = (model.geom_type, model.geom_size)
    key = b"".join(array[list(geoms)].tobytes() for array in arrays)
    key += frames.tobytes() + bytes(shown)
    return key + b"".join(_mesh_content(model, geom) for geom in geoms)


def _mesh_content(model: mujoco.MjModel, geom: int) -> bytes:
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return b""
    return _mesh(model, int(model.geom_dataid[geom])).tobytes()


def _local_triangles(model: mujoco.MjModel, geom: int, tolerance: float) -> Array:
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    types = mujoco.mjtGeom
    if kind == types.mjGEOM_BOX:
        return _box(size)
    if kind == types.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    if kind == types.mjGEOM_HFIELD:
        return _heightfield(model, int(model.geom_dataid[geom]))
    if kind == types.mjGEOM_SPHERE:
        return _ellipsoid(np.full(3, size[0]), tolerance)
    if kind == types.mjGEOM_ELLIPSOID:
        return _ellipsoid(size, tolerance)
    if kind == types.mjGEOM_CAPSULE:
        radius = float(size[0])
        segments = _segments(radius, tolerance / 2)
        return _revolve(_capsule_profile(radius, float(size[1]), segments), segments)
    if kind == types.mjGEOM_CYLINDER:
        radius, half = float(size[0]), float(size[1])
        profile = np.array([[radius, -half], [radius, half]])
        return _revolve(profile, _segments(radius, tolerance))
    return np.zeros((0, 3, 3))


def _segments(radius: float, tolerance: float) -> int:
    """Segments of a full circle that keep the chord error below a tolerance."""
    if radius <= tolerance:
        return 8
    needed = math.ceil(math.pi / math.acos(1.0 - tolerance / radius))
    return max(12, min(MAX_SEGMENTS, needed))


def _box(size: Array) -> Array:
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * size
    faces = [(a, b, c) for a, b, c, _ in _QUADS] + [(a, c, d) for a, _, c, d in _QUADS]
    answer: Array = corners[np.array(faces)]
    return answer


def _mesh(model: mujoco.MjModel, mesh: int) -> Array:
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[start : start + count].astype(float)
    start, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    answer: Array = vertices[model.mesh_face[start : start + count]]
    return answer


def _heightfield(model: mujoco.MjModel, field: int) -> Array:
    """The hills, and the sides and bottom of the block under them.

    MuJoCo cuts each cell of the grid from its first corner to the one opposite, for rays and for
    contacts.
    """
    rows, columns = int(model.hfield_nrow[field]), int(model.hfield_ncol[field])
    start = model.hfield_adr[field]
    sx, sy, top, base = model.hfield_size[field]
    height = model.hfield_data[start : start + rows * columns].reshape(rows, columns) * top
    x, y = np.meshgrid(np.linspace(-sx, sx, columns), np.linspace(-sy, sy, rows))
    grid = np.stack([x, y, height], axis=-1)
    a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    hills = np.concatenate([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)
    rim = np.concatenate([grid[0, :-1], grid[:-1, -1], grid[-1, :0:-1], grid[:0:-1, 0]])
    foot = rim * [1.0, 1.0, 0.0] - [0.0, 0.0, base]
    after, below = np.roll(rim, -1, axis=0), np.roll(foot, -1, axis=0)
    sides = np.concatenate([np.stack([rim, foot, below], 1), np.stack([rim, below, after], 1)])
    corners = np.array([[-sx, -sy, -base], [-sx, sy, -base], [sx, sy, -base], [sx, -sy, -base]])
    return np.concatenate([hills, sides, corners[[[0, 1, 2], [0, 2, 3]]]])


def _ellipsoid(semi_axes: Array, tolerance: float) -> Array:
    # Curved both ways: the errors along and across add up.
    count = _segments(float(semi_axes.max()), tolerance / 2)
    angles = _latitudes(count)
    angles = np.concatenate([-angles[::-1], angles])
    unit = _revolve(np.stack([np.cos(angles), np.sin(angles)], axis=1), count)
    return unit @ _ASKEW * semi_axes


def _latitudes(count: int) -> Array:
    """Rings of the upper half of a ball with so many segments, from the equator up; the last one
    is so near to the pole that a flat lid closes it as well as any facet."""
    steps = math.ceil(count / 4)
    middles = np.arange(steps, dtype=np.float64) + 0.5
    return middles * (math.pi / 2 / steps)


def _capsule_profile(radius: float, half: float, segments: int) -> Array:
    angles = np.append(0.0, _latitudes(segments))
    upper = np.stack([radius * np.cos(angles), half + radius * np.sin(angles)], axis=1)
    lower = upper[::-1] * np.array([1.0, -1.0])
    return np.concatenate([lower, upper])


def _revolve(profile: Array, count: int) -> Array:
    """Surface of revolution about z of a profile (n, 2) of radius and height, closed by flat lids.

    No corner and no edge lies on the axis, along which people like to look: where many triangles
    meet a ray may slip through between them. Hence the odd number of segments, at the least as many
    as asked for, and lids without a corner in their middle.
    """
    count |= 1
    angles = _PHASE + np.linspace(0.0, math.tau, count, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    rings = np.concatenate(
        [profile[:, None, :1] * ring[None], np.repeat(profile[:, None, 1:], count, 1)], axis=2
    )
    a, b = rings[:-1], np.roll(rings[:-1], -1, axis=1)
    d, c = rings[1:], np.roll(rings[1:], -1, axis=1)
    sides = np.concatenate([np.stack([a, b, c], 2), np.stack([a, c, d], 2)]).reshape(-1, 3, 3)
    return np.concatenate([sides, _lid(rings[0])[:, ::-1], _lid(rings[-1])])


def _lid(ring: Array) -> Array:
    """Triangles (k, 3, 3) that fill a ring of corners (n, 3)."""
    first = np.broadcast_to(ring[0], (len(ring) - 2, 3))
    return np.stack([first, ring[1:-1], ring[2:]], axis=1)
