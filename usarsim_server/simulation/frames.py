"""Poses, and the one place where the wire frame meets the simulation frame.

Simulation frame (MuJoCo, ROS): x forward, y left, z up. Wire frame (USARSim): x forward, y right,
z down; rotations are roll, pitch, yaw applied as Rz(yaw) Ry(pitch) Rx(roll), all in radians.
The two frames differ by half a turn about x, so every conversion is its own inverse
(protocol reference 2.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Array = NDArray[np.float64]
Numbers = NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class Pose:
    """Position (m) and orientation (unit quaternion w, x, y, z) in the simulation frame."""

    position: Vector = (0.0, 0.0, 0.0)
    quaternion: Quaternion = (1.0, 0.0, 0.0, 0.0)

    def matrix(self) -> Array:
        """Rotation matrix (3, 3) that turns local vectors into the parent frame."""
        return _matrix_of(self.quaternion)

    def rotate(self, vector: Vector) -> Vector:
        """Turn a local vector into the parent frame."""
        w, x, y, z = self.quaternion
        vx, vy, vz = vector
        tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
        return (
            vx + w * tx + y * tz - z * ty,
            vy + w * ty + z * tx - x * tz,
            vz + w * tz + x * ty - y * tx,
        )

    def __matmul__(self, other: Pose) -> Pose:
        """Compose: `parent @ local` is the pose of `local` seen from outside."""
        rx, ry, rz = self.rotate(other.position)
        px, py, pz = self.position
        return Pose((px + rx, py + ry, pz + rz), _multiply(self.quaternion, other.quaternion))

    def inverse(self) -> Pose:
        """The pose that undoes this one."""
        w, x, y, z = self.quaternion
        back = Pose((0.0, 0.0, 0.0), (w, -x, -y, -z))
        px, py, pz = back.rotate(self.position)
        return Pose((-px, -py, -pz), back.quaternion)


IDENTITY = Pose()

Number = TypeVar("Number", float, Array)


def axes_of(
    w: Number, x: Number, y: Number, z: Number
) -> tuple[tuple[Number, Number, Number], ...]:
    """Axes (ahead, to the left, up) of a frame in its parent, from its unit quaternion.

    They are the columns of the rotation matrix. Plain numbers are far faster than arrays here.
    """
    return (
        (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)),
        (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)),
        (2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)),
    )


def _matrix_of(quaternion: Quaternion) -> Array:
    (a, b, c), (d, e, f), (g, h, i) = axes_of(*quaternion)
    return np.array(((a, d, g), (b, e, h), (c, f, i)))


def rotation_matrices(quaternions: Array) -> Array:
    """Rotation matrices (n, 3, 3) of unit quaternions (n, 4), w x y z; see `Pose.matrix`."""
    rows = list(zip(*axes_of(*quaternions.T), strict=True))
    return np.moveaxis(np.array(rows), 2, 0)


def rotation_matrix(quaternion: Array) -> Array:
    """Rotation matrix (3, 3) of a unit quaternion (4,), w x y z; see `Pose.matrix`."""
    w, x, y, z = quaternion.tolist()
    return _matrix_of((w, x, y, z))


def pose_of(position: Array, quaternion: Array) -> Pose:
    """Pose from a position (3,) and a unit quaternion (4,), such as MuJoCo has for each body."""
    x, y, z = position.tolist()
    w, i, j, k = quaternion.tolist()
    return Pose((x, y, z), (w, i, j, k))


def _multiply(a: Quaternion, b: Quaternion) -> Quaternion:
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


def quaternion_from_rpy(roll: float, pitch: float, yaw: float) -> Quaternion:
    """Unit quaternion of Rz(yaw) Ry(pitch) Rx(roll), in whatever frame the angles are given."""
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    cp, sp = math.cos(pitch / 2), math.sin(pitch / 2)
    cy, sy = math.cos(yaw / 2), math.sin(yaw / 2)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def rpy_from_quaternion(quaternion: Quaternion) -> Vector:
    """Roll, pitch, yaw (rad) with roll and yaw in (-pi, pi], pitch in [-pi/2, pi/2].

    Half the sum and half the difference of roll and yaw are found separately, each from a pair of
    numbers that are not both small unless the other pair holds the whole rotation. So the angles
    give the rotation back to rounding even where the nose points straight up or down (formula
    derived from the product of the three half-angle quaternions; compare Bernardes and Viollet,
    PLoS ONE 17(11), 2022).
    """
    w, x, y, z = quaternion
    half_sum = math.atan2(x + z, w - y)
    half_difference = math.atan2(x - z, w + y)
    pitch = 2 * math.atan2(math.hypot(x - z, w + y), math.hypot(x + z, w - y)) - math.pi / 2
    return _wrap_once(half_sum + half_difference), pitch, _wrap_once(half_sum - half_difference)


def _wrap_once(angle: float) -> float:
    """An angle in [-2 pi, 2 pi] brought into (-pi, pi]."""
    if angle > math.pi:
        return angle - math.tau
    return angle + math.tau if angle <= -math.pi else angle


def flip_point(point: Vector) -> Vector:
    """Convert a point, velocity or any other vector between wire and simulation frame."""
    x, y, z = point
    return x, -y, -z


def flip_quaternion(quaternion: Quaternion) -> Quaternion:
    """Convert an orientation between wire and simulation frame."""
    w, x, y, z = quaternion
    return w, x, -y, -z


def pose_from_wire(location: Vector, rotation: Vector = (0.0, 0.0, 0.0)) -> Pose:
    """Pose in the simulation frame of a wire location (m) and roll, pitch, yaw (rad)."""
    return Pose(flip_point(location), flip_quaternion(quaternion_from_rpy(*rotation)))


def wire_from_pose(pose: Pose) -> tuple[Vector, Vector]:
    """Wire location (m) and signed roll, pitch, yaw (rad) of a pose."""
    return flip_point(pose.position), rpy_from_quaternion(flip_quaternion(pose.quaternion))


def wrap_turn(angle: float) -> float:
    """The same angle in [0, 2 pi)."""
    wrapped = math.fmod(angle, math.tau)
    if wrapped < 0.0:
        wrapped += math.tau
    return wrapped if wrapped < math.tau else 0.0


def wrap_signed(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    wrapped = wrap_turn(angle)
    return wrapped - math.tau if wrapped > math.pi else wrapped


def around(place: Vector, radii: Sequence[float], directions: int) -> Iterator[Vector]:
    """Places on circles around one, level with it, in so many directions; itself for radius 0."""
    x, y, z = place
    for radius in radii:
        for turn in range(directions if radius else 1):
            angle = math.tau * turn / directions
            yield x + radius * math.cos(angle), y + radius * math.sin(angle), z
