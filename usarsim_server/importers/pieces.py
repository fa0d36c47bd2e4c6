"""Convex pieces that MuJoCo collides: boxes, and hulls of points; how shapes become them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.importers.cells import Cell
from usarsim_server.importers.units import pose_of_matrix
from usarsim_server.simulation.frames import Pose

__all__ = [
    "FLAT",
    "BoxPiece",
    "HullPiece",
    "Piece",
    "bounding_box_piece",
    "box_from_axes",
    "hull_piece",
    "piece_of_cell",
    "volumes",
]

Array = NDArray[np.float64]

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


Piece: TypeAlias = BoxPiece | HullPiece


def piece_of_cell(cell: Cell) -> Piece:
    """A box where six faces are three perpendicular pairs (item 24), else a hull."""
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
    matrix = np.eye(4)
    matrix[:3, :3] = turn
    matrix[:3, 3] = turn @ ((low + high) / 2.0)
    half = np.maximum((high - low) / 2.0, FLAT / 2.0).tolist()
    return BoxPiece(pose_of_matrix(matrix), (half[0], half[1], half[2]))


def bounding_box_piece(points: Array) -> BoxPiece:
    """The axis-parallel box around points."""
    return box_from_axes(points, np.eye(3))


def hull_piece(points: Array) -> Piece:
    """The hull of points with at most `MAX_HULL_POINTS` corners; a plate if they are flat."""
    if len(points) == 8:
        if _is_upright_box(points):
            return bounding_box_piece(points)
        box = _turned_box(points)
        if box is not None:
            return box
    middle = points.mean(axis=0)
    _, _, axes = (
        np.linalg.svd(points - middle, full_matrices=False)
        if len(points) > 2
        else (
            None,
            None,
            np.eye(3),
        )
    )
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
    answer: Array = points[chosen]
    return answer


def volumes(pieces: Sequence[Piece]) -> Array:
    """m^3 of every piece; MuJoCo computes those of hulls.

    Raises:
        ValueError: a hull has no volume.
    """
    found = np.zeros(len(pieces))
    spec = mujoco.MjSpec()
    hulls = []
    for number, piece in enumerate(pieces):
        if isinstance(piece, BoxPiece):
            found[number] = 8.0 * piece.half[0] * piece.half[1] * piece.half[2]
            continue
        middle = piece.points.mean(axis=0)
        spec.add_mesh(
            name=f"h{number}",
            uservert=(piece.points - middle).ravel(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX,
        )
        body = spec.worldbody.add_body(name=f"b{number}")
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"h{number}", density=1.0)
        hulls.append(number)
    if hulls:
        spec.compiler.boundmass = 0.0
        model = spec.compile()
        found[hulls] = [model.body(f"b{number}").mass[0] for number in hulls]
    return found


def moved(piece: Piece, pose: Pose) -> Piece:
    """The piece as seen from the frame in which its own has this pose."""
    if isinstance(piece, BoxPiece):
        return BoxPiece(pose @ piece.pose, piece.half)
    return HullPiece(piece.points @ pose.matrix().T + np.array(pose.position))
