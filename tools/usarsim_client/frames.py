"""The frame of the wire, and the one that ROS and MuJoCo use; the only place where they meet.

Everything in this package is in the frame of the wire: x forward, y to the right, z **down**,
rotations as roll, pitch, yaw, applied as Rz(yaw) Ry(pitch) Rx(roll); yaw grows clockwise seen from
above. The other frame (REP 103 of ROS) has x forward, y to the left, z up; yaw grows
counter-clockwise. They differ by half a turn about x, so that every conversion undoes itself.
Metres and radians in both.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np

from usarsim_client.segments import Array
from usarsim_server.protocol.values import Vector

Quaternion = tuple[float, float, float, float]

Place = TypeVar("Place", Vector, Array)


def flip(place: Place) -> Place:
    """A point, a velocity, an axis or roll, pitch, yaw in the other frame.

    Args:
        place: three numbers, or an array (..., 3) of such.
    """
    if isinstance(place, np.ndarray):
        return place * (1.0, -1.0, -1.0)
    return place[0], -place[1], -place[2]


def bearings(count: int, fov: float) -> Array:
    """Directions (count,) of the beams of a scan in the frame of the wire, rad.

    A scan begins at the right, at +fov/2, and ends at the left.
    """
    if count == 1:
        return np.zeros(1)
    return np.linspace(fov / 2, -fov / 2, count)


def on_circle(radii: Array, angles: Array) -> Array:
    """Points (n, 2), x forward and y to the right, of ranges (n,) in m and bearings (n,) in rad."""
    return np.stack((radii * np.cos(angles), radii * np.sin(angles)), axis=-1)


def to_world(local: Array, location: Vector, orientation: Vector) -> Array:
    """Points of a robot or sensor in the frame that its pose is told in.

    Args:
        local: points (n, 3), or (n, 2) at the height of the origin, m.
        location: of the origin, m.
        orientation: roll, pitch, yaw, rad.

    Returns:
        Points (n, 3).
    """
    if local.shape[-1] == 2:
        local = np.concatenate((local, np.zeros((*local.shape[:-1], 1))), axis=-1)
    turned: Array = local @ rotation_matrix(orientation).T + np.array(location)
    return turned


def rotation_matrix(orientation: Vector) -> Array:
    """Matrix (3, 3) of roll, pitch, yaw that turns local points into the parent frame."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(orientation), np.sin(orientation)
    return np.array(
        (
            (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
            (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
            (-sp, cp * sr, cp * cr),
        )
    )


def quaternion(orientation: Vector) -> Quaternion:
    """Unit quaternion w, x, y, z of roll, pitch, yaw, in whatever frame they are given.

    For ROS: `quaternion(flip(truth.orientation))`.
    """
    cr, cp, cy = (math.cos(angle / 2) for angle in orientation)
    sr, sp, sy = (math.sin(angle / 2) for angle in orientation)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def signed(angle: float) -> float:
    """The same direction in [-pi, pi)."""
    if -math.pi <= angle < math.pi:
        return angle  # to the last digit
    return (angle + math.pi) % math.tau - math.pi
