"""From the frames and units of other programs into the simulation frame (worlds reference 2).

Unreal: x forward, y right, z up (left-handed), lengths in Unreal units, angles in 65536ths of a
turn. All functions return float64 arrays; lengths come out in metres.

Whatever the format: matrices taken apart into a pose and what is baked into a mesh, and a whole
scene as a mirror shows it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from usarsim_maps.scene import Array, Heightfield, Polygon, Scene
from usarsim_server.simulation.frames import Pose, Vector

UU_PER_METRE = 250.0
"""Unreal units per metre in USARSim maps (worlds reference 2.2)."""

ROTATION_UNIT = math.tau / 65536.0
"""rad per Unreal rotation unit."""

MIRROR = np.diag([1.0, -1.0, 1.0])


def unreal_points(
    points: Sequence[float] | Sequence[Sequence[float]] | Array, scale: float = UU_PER_METRE
) -> Array:
    """Points (n, 3) or one point (3,): (X, Y, Z) becomes (X, -Y, Z) / scale (worlds 1).

    This is a reflection: whoever uses it on faces reverses their vertex order once.
    """
    return np.asarray(np.asarray(points, dtype=float) * np.array([1.0, -1.0, 1.0]) / scale)


def unreal_rotation(pitch: float, yaw: float, roll: float) -> Array:
    """Rotation (3, 3) in the simulation frame of a rotator in rotation units, unwrapped or not.

    Rz(-yaw) Ry(-pitch) Rx(roll) (worlds reference 2.3; items 2 to 6).
    """
    cp, sp = _cos_sin(pitch)
    cy, sy = _cos_sin(yaw)
    cr, sr = _cos_sin(roll)
    turn_z = np.array([[cy, sy, 0.0], [-sy, cy, 0.0], [0.0, 0.0, 1.0]])
    turn_y = np.array([[cp, 0.0, -sp], [0.0, 1.0, 0.0], [sp, 0.0, cp]])
    turn_x = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    return np.asarray(turn_z @ turn_y @ turn_x)


def unreal_pose(
    location: Sequence[float], rotator: Sequence[float], scale: float = UU_PER_METRE
) -> Pose:
    """Pose of an actor; the rotator is (pitch, yaw, roll) in rotation units."""
    return pose_of_matrix(affine(unreal_rotation(*rotator), unreal_points(location, scale)))


def unreal_matrix(
    location: Sequence[float] = (0.0, 0.0, 0.0),
    rotator: Sequence[float] = (0.0, 0.0, 0.0),
    scale3d: Sequence[float] = (1.0, 1.0, 1.0),
    pivot: Sequence[float] = (0.0, 0.0, 0.0),
    scale: float = UU_PER_METRE,
    main_scale: Sequence[float] = (1.0, 1.0, 1.0),
    post_scale: Sequence[float] = (1.0, 1.0, 1.0),
) -> Array:
    """Matrix (4, 4) from an actor's local frame (already mirrored, in metres) into the world.

    T(location) diag(post) R diag(main DrawScale DrawScale3D) T(-pivot), worlds 11 and 12. Diagonal
    scales are the same in the mirrored frame. `main_scale` and `post_scale` are those of UE1 and
    UE2 brushes.
    """
    linear = (
        np.diag(np.asarray(post_scale, dtype=float))
        @ unreal_rotation(*rotator)
        @ np.diag(np.asarray(scale3d, dtype=float) * np.asarray(main_scale, dtype=float))
    )
    offset = unreal_points(location, scale) - linear @ unreal_points(pivot, scale)
    return affine(linear, offset)


def axis_matrix(up: str) -> Array:
    """Rotation (3, 3) that takes a right-handed file with this axis up into the simulation frame.

    Z: as it is; Y: (x, -z, y); X: (-y, -z, x) (worlds reference 2.4).

    Raises:
        ValueError: the axis is not one of X, Y and Z.
    """
    match up.upper():
        case "Z":
            return np.eye(3)
        case "Y":
            return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
        case "X":
            return np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    raise ValueError(f"up axis {up!r} is not one of X, Y, Z")


def pose_of_matrix(matrix: Array) -> Pose:
    """The rigid part of a matrix (4, 4): place, and the rotation nearest to its upper left."""
    left, _, right = np.linalg.svd(matrix[:3, :3])
    if np.linalg.det(left @ right) < 0.0:
        left[:, 2] *= -1.0
    turn = left @ right
    x, y, z = (float(value) for value in matrix[:3, 3])
    return Pose((x, y, z), _quaternion(turn))


def _cos_sin(units: float) -> tuple[float, float]:
    # Quarter turns are exact: walls of rotated rooms stay axis-parallel boxes.
    quarter, rest = divmod(units, 16384)
    if rest == 0:
        return ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[int(quarter) % 4]
    return math.cos(units * ROTATION_UNIT), math.sin(units * ROTATION_UNIT)


def _quaternion(turn: Array) -> tuple[float, float, float, float]:
    """Unit quaternion w, x, y, z of a rotation matrix; the largest component is found first."""
    m = turn
    trace = float(m[0, 0] + m[1, 1] + m[2, 2])
    squares = np.array([1.0 + trace, *(1.0 + 2.0 * np.diag(m) - trace)])
    largest = int(np.argmax(squares))
    w, x, y, z = (
        (squares[0], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]),
        (m[2, 1] - m[1, 2], squares[1], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]),
        (m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], squares[2], m[1, 2] + m[2, 1]),
        (m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], squares[3]),
    )[largest]
    length = math.sqrt(w * w + x * x + y * y + z * z)
    sign = -1.0 if w < 0.0 else 1.0
    return (
        float(sign * w / length),
        float(sign * x / length),
        float(sign * y / length),
        float(sign * z / length),
    )


def take_apart(matrix: Array) -> tuple[Pose, Array]:
    """A pose and a linear map (3, 3), so that the matrix is the map followed by the pose.

    The map is symmetric and holds scale, shear and reflection; it is exact for axis scales.
    """
    linear = matrix[:3, :3]
    left, scales, right = np.linalg.svd(linear)
    turn = left @ right
    stretch = right.T @ np.diag(scales) @ right
    if np.linalg.det(turn) < 0.0:
        turn, stretch = -turn, -stretch
    return pose_of_matrix(affine(turn, matrix[:3, 3])), np.round(stretch, 9) + 0.0


def axis_turn(axis: Array, angle: float) -> Array:
    """Rotation (3, 3) about an axis of any length by rad, Rodrigues' formula."""
    length = float(np.linalg.norm(axis))
    if length < 1e-12:
        return np.eye(3)
    x, y, z = axis / length
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    # Quarter turns come out exact, so that walls stay parallel to the axes.
    s, c = np.round(np.sin(angle), 15), np.round(np.cos(angle), 15)
    return np.asarray(np.eye(3) + s * cross + (1.0 - c) * (cross @ cross))


def affine(linear: Array | None = None, offset: Sequence[float] | Array = (0.0, 0.0, 0.0)) -> Array:
    """Matrix (4, 4) of a linear map (3, 3), if there is one, and a way (3,) after it."""
    matrix = np.eye(4)
    if linear is not None:
        matrix[:3, :3] = linear
    matrix[:3, 3] = offset
    return matrix


def matrix_of_pose(pose: Pose) -> Array:
    """(4, 4)."""
    return affine(pose.matrix(), pose.position)


def srgb(value: float) -> float:
    """A linear part of a colour, from 0 to 1, as screens show it."""
    if value <= 0.0031308:
        return 12.92 * value
    return float(1.055 * value ** (1.0 / 2.4) - 0.055)


def shown(values: Array) -> Array:
    """Linear parts of colours, each from 0 to 1, as screens show them (`srgb`)."""
    return np.asarray(
        np.where(values <= 0.0031308, 12.92 * values, 1.055 * values ** (1.0 / 2.4) - 0.055)
    )


def reflect(scene: Scene) -> Scene:
    """The mirror image of a scene: y becomes -y, for maps whose handedness was lost on the way.

    Faces still look outwards, headings turn the other way.
    """
    smoke = scene.smoke
    mirror = np.diag([1.0, -1.0, 1.0, 1.0])
    return replace(
        scene,
        source=replace(scene.source, mirrored=not scene.source.mirrored),
        objects=tuple(
            # S (pose matrix) = (S pose S) (S matrix); the builder turns faces round.
            replace(
                thing,
                pose=_reflected(thing.pose),
                parts=tuple(replace(part, matrix=mirror @ part.matrix) for part in thing.parts),
            )
            for thing in scene.objects
        ),
        brushes=tuple(
            replace(brush, polygons=tuple(map(_reflected_polygon, brush.polygons)))
            for brush in scene.brushes
        ),
        heightfields=tuple(map(_reflected_field, scene.heightfields)),
        starts=tuple(replace(s, pose=_reflected(s.pose), turns=-s.turns) for s in scene.starts),
        path_nodes=tuple(replace(n, position=_point(n.position)) for n in scene.path_nodes),
        victims=tuple(replace(victim, pose=_reflected(victim.pose)) for victim in scene.victims),
        lights=tuple(
            replace(light, position=_point(light.position), direction=_point(light.direction))
            for light in scene.lights
        ),
        smoke=replace(
            smoke,
            volumes=tuple(replace(v, pose=_reflected(v.pose)) for v in smoke.volumes),
            puffs=tuple(replace(p, position=_point(p.position)) for p in smoke.puffs),
        ),
    )


def _point(point: Vector) -> Vector:
    x, y, z = point
    return x, -y, z


def _reflected(pose: Pose) -> Pose:
    """S R S: turns about z and x change their sense."""
    w, i, j, k = pose.quaternion
    return Pose(_point(pose.position), (w, -i, j, -k))


def _reflected_polygon(polygon: Polygon) -> Polygon:
    vertices: Array = (polygon.vertices @ MIRROR)[::-1]
    uvs = None if polygon.uvs is None else polygon.uvs[::-1]
    return replace(polygon, vertices=vertices, uvs=uvs)


def _reflected_field(field: Heightfield) -> Heightfield:
    """Rows run along +y again, from what was the last one."""
    length = (len(field.heights) - 1) * field.spacing[1]
    pose = _reflected(field.pose) @ Pose((0.0, -length, 0.0))
    return replace(field, heights=field.heights[::-1], pose=pose)
