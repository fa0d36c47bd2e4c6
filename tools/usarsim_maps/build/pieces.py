"""Pieces that MuJoCo collides: boxes, hulls of points, balls and cylinders, height fields; how
shapes become them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import mujoco
import numpy as np

from usarsim_maps.build.cells import Cell
from usarsim_maps.geometry import CORNERS, QUADS
from usarsim_maps.scene import Array
from usarsim_maps.units import affine, pose_of_matrix
from usarsim_server.simulation.frames import Pose, rotation_matrix

MAX_HULL_POINTS = 128
"""Corners of a hull that are kept; MuJoCo's cost of a contact grows with them."""

FLAT = 1e-3
"""m: points within so thin a layer have no hull; a plate of this thickness stands for them."""

SQUARE = 1e-3
"""Cosine between the edges of what counts as a box."""

TRUE_CORNER = 1e-4
"""m: how far corners may be from those of the box that stands for them."""


@dataclass(frozen=True, slots=True)
class BoxPiece:
    """A box: the pose of its middle and half of its edges, m."""

    pose: Pose
    half: tuple[float, float, float]


@dataclass(frozen=True, slots=True, eq=False)
class HullPiece:
    """The convex hull of points (k, 3); they span space."""

    points: Array


@dataclass(frozen=True, slots=True)
class RoundPiece:
    """A ball, cylinder or capsule along z."""

    kind: str  # `sphere`, `cylinder`, `capsule`: MuJoCo's name
    size: tuple[float, ...]  # radius and, of the others, half of the length without caps, m
    pose: Pose  # of its middle

    @property
    def volume(self) -> float:
        """m^3."""
        radius = self.size[0]
        ball = 4.0 / 3.0 * math.pi * radius**3
        if self.kind == "sphere":
            return ball
        barrel = 2.0 * math.pi * radius**2 * self.size[1]
        return barrel if self.kind == "cylinder" else barrel + ball


@dataclass(frozen=True, slots=True, eq=False)
class FieldPiece:
    """A height field, solid below."""

    heights: Array  # (rows, columns), m; rows run along y, columns along x
    spacing: tuple[float, float]  # m between columns and between rows
    pose: Pose  # of the corner [0, 0]; z is up

    def triangles(self) -> Array:
        """(n, 3, 3) of its top as MuJoCo collides it: cells are cut from b to d."""
        rows, columns = self.heights.shape
        x, y = np.meshgrid(np.arange(columns) * self.spacing[0], np.arange(rows) * self.spacing[1])
        grid = np.stack([x, y, self.heights], axis=-1)
        a, b, c, d = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
        found = np.concatenate([np.stack([a, b, d], 2), np.stack([b, c, d], 2)]).reshape(-1, 3, 3)
        return np.asarray(found @ self.pose.matrix().T + np.array(self.pose.position))


Convex: TypeAlias = BoxPiece | HullPiece
Piece: TypeAlias = Convex | FieldPiece
Pushed: TypeAlias = Convex | RoundPiece
"""What things that are pushed are made of."""


def piece_of_cell(cell: Cell) -> Convex:
    """A box where six faces are three perpendicular pairs (worlds 24), else a hull."""
    corners = np.array(cell.corners)
    if len(cell.faces) == 6 and len(corners) == 8:
        normals = np.array([face.plane[:3] for face in cell.faces])
        box = _box_of(corners, normals)
        if box is not None:
            return box
    return HullPiece(corners)


def _box_of(corners: Array, normals: Array) -> BoxPiece | None:
    """The box with these eight corners and six normals, None if it is none."""
    axes = [normals[0]]
    for normal in normals[1:]:
        if all(abs(float(normal @ axis)) < SQUARE for axis in axes):
            axes.append(normal)
    if len(axes) != 3:
        return None
    parallel = np.abs(normals @ np.array(axes).T)
    if not (np.sort(parallel, axis=1)[:, :2] < SQUARE).all():
        return None
    return box_from_axes(corners, np.array(axes))


def box_from_axes(points: Array, axes: Array) -> BoxPiece:
    """The box around points whose edges run along three perpendicular unit rows."""
    x = axes[0]
    y = axes[1] - (axes[1] @ x) * x
    y /= np.linalg.norm(y)
    turn = np.column_stack([x, y, np.cross(x, y)])
    inside = points @ turn
    low, high = inside.min(axis=0), inside.max(axis=0)
    matrix = affine(turn, turn @ ((low + high) / 2.0))
    half = np.maximum((high - low) / 2.0, FLAT / 2.0).tolist()
    return BoxPiece(pose_of_matrix(matrix), (half[0], half[1], half[2]))


def bounding_box_piece(points: Array) -> BoxPiece:
    """The axis-parallel box around points."""
    return box_from_axes(points, np.eye(3))


def hull_piece(points: Array) -> Convex:
    """The hull of points with at most `MAX_HULL_POINTS` corners; a plate if they are flat."""
    if len(points) == 8:
        if _is_upright_box(points):
            return bounding_box_piece(points)
        box = _turned_box(points)
        if box is not None:
            return box
    middle = points.mean(axis=0)
    many = len(points) > 2
    axes = np.linalg.svd(points - middle, full_matrices=False)[2] if many else np.eye(3)
    spread = np.ptp((points - middle) @ axes.T, axis=0)
    if len(points) < 4 or len(spread) < 3 or spread.min() < FLAT:
        frame = axes if len(axes) == 3 else np.eye(3)
        return box_from_axes(points, np.array(frame))
    return HullPiece(_extremes(points))


def _is_upright_box(points: Array) -> bool:
    """Whether eight points are all the corners of a box along the axes."""
    low = points.min(axis=0)
    upper = points > low
    exact = np.where(upper, points.max(axis=0), low)
    return bool((exact == points).all()) and len(np.unique(upper, axis=0)) == 8


def _turned_box(points: Array) -> BoxPiece | None:
    """The box whose corners eight points are, whatever way it is turned; None if they are none."""
    ways = points[1:] - points[0]
    lengths = np.linalg.norm(ways, axis=1)
    axes: list[Array] = []
    # Seen from a corner the shortest way is an edge; of those square to it the next one is, too.
    for index in np.argsort(lengths):
        if lengths[index] < FLAT:
            return None
        way: Array = ways[index] / lengths[index]
        if all(abs(float(way @ axis)) < SQUARE for axis in axes):
            axes.append(way)
            if len(axes) == 3:
                break
    if len(axes) < 3:
        return None
    inside = points @ np.array(axes).T
    low, high = inside.min(axis=0), inside.max(axis=0)
    upper = inside > (low + high) / 2.0
    if np.abs(np.where(upper, high, low) - inside).max() > TRUE_CORNER:
        return None
    return box_from_axes(points, np.array(axes)) if len(np.unique(upper, axis=0)) == 8 else None


def _extremes(points: Array) -> Array:
    """At most `MAX_HULL_POINTS` points that lie farthest in directions all around."""
    if len(points) <= MAX_HULL_POINTS:
        return points
    count = MAX_HULL_POINTS - 6
    k = np.arange(count) + 0.5
    polar, turn = np.arccos(1.0 - 2.0 * k / count), math.pi * (1.0 + math.sqrt(5.0)) * k
    ball = np.column_stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)]
    )
    ways = np.concatenate([ball, np.eye(3), -np.eye(3)])
    # Directions are stretched so that flat things get as many corners as round ones.
    size = np.maximum(np.ptp(points, axis=0), FLAT)
    chosen = np.unique(np.argmax((points / size) @ ways.T, axis=0))
    return np.asarray(points[chosen])


def volumes(pieces: Sequence[Pushed]) -> Array:
    """m^3 of every piece; MuJoCo computes those of hulls (`ValueError` if one has none)."""
    found = np.zeros(len(pieces))
    for number, piece in enumerate(pieces):
        if isinstance(piece, BoxPiece):
            found[number] = 8.0 * piece.half[0] * piece.half[1] * piece.half[2]
        elif isinstance(piece, RoundPiece):
            found[number] = piece.volume
    hulls = {n: piece for n, piece in enumerate(pieces) if isinstance(piece, HullPiece)}
    if hulls:
        model = _compiled(hulls)
        found[list(hulls)] = [model.body(f"b{number}").mass[0] for number in hulls]
    return found


def depths_inside(pieces: Sequence[Convex], samples: Sequence[Array]) -> Array:
    """m by which the deepest sample (k, 3) of every piece lies within it.

    MuJoCo makes the hulls (`ValueError` if one has no volume).
    """
    hulls = {n: piece for n, piece in enumerate(pieces) if isinstance(piece, HullPiece)}
    model = _compiled(hulls) if hulls else None
    found = np.zeros(len(pieces))
    for number, (piece, points) in enumerate(zip(pieces, samples, strict=True)):
        if isinstance(piece, BoxPiece):
            inside = (points - np.array(piece.pose.position)) @ piece.pose.matrix()
            found[number] = (piece.half - np.abs(inside)).min(axis=1).max()
            continue
        assert model is not None
        corners = _hull_triangles(model, model.mesh(f"h{number}").id) + piece.points.mean(axis=0)
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        lengths = np.linalg.norm(normals, axis=1)
        normals = normals[lengths > 0.0] / lengths[lengths > 0.0, None]
        offsets = np.einsum("ij,ij->i", normals, corners[lengths > 0.0, 0])
        found[number] = (offsets - points @ normals.T).min(axis=1).max()
    return found


def corners_of(piece: Convex) -> Array:
    """(k, 3) of a box or hull."""
    if isinstance(piece, HullPiece):
        return piece.points
    return np.asarray(CORNERS * piece.half @ piece.pose.matrix().T + np.array(piece.pose.position))


def triangles_of(pieces: Sequence[Convex]) -> Array:
    """(n, 3, 3) of boxes and hulls together."""
    hulls = {n: piece for n, piece in enumerate(pieces) if isinstance(piece, HullPiece)}
    model = _compiled(hulls) if hulls else None
    found = [np.zeros((0, 3, 3))]
    for number, piece in enumerate(pieces):
        if isinstance(piece, BoxPiece):
            corners = corners_of(piece)
            found += [corners[[[a, b, c], [a, c, d]]] for a, b, c, d in QUADS]
        else:
            assert model is not None
            middle = piece.points.mean(axis=0)
            found.append(_hull_triangles(model, model.mesh(f"h{number}").id) + middle)
    return np.concatenate(found)


def _hull_triangles(model: mujoco.MjModel, mesh: int) -> Array:
    """Triangles (n, 3, 3) of a mesh, in the frame in which it was given."""
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[start : start + count].astype(float)
    vertices = vertices @ rotation_matrix(model.mesh_quat[mesh]).T + model.mesh_pos[mesh]
    start, count = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return np.asarray(vertices[model.mesh_face[start : start + count]])


def _compiled(hulls: Mapping[int, HullPiece]) -> mujoco.MjModel:
    """A model with a body `b` and a mesh `h` for each hull, around the mean of its points."""
    spec = mujoco.MjSpec()
    for number, piece in hulls.items():
        spec.add_mesh(
            name=f"h{number}",
            uservert=(piece.points - piece.points.mean(axis=0)).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
        )
        body = spec.worldbody.add_body(name=f"b{number}")
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"h{number}", density=1.0)
    spec.compiler.boundmass = 0.0
    return spec.compile()


def moved(piece: Pushed, pose: Pose) -> Pushed:
    """The piece as seen from the frame in which its own has this pose."""
    if isinstance(piece, BoxPiece):
        return BoxPiece(pose @ piece.pose, piece.half)
    if isinstance(piece, RoundPiece):
        return RoundPiece(piece.kind, piece.size, pose @ piece.pose)
    return HullPiece(piece.points @ pose.matrix().T + np.array(pose.position))
