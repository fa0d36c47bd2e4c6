"""Bundles of ray directions: computed once in the sensor's own frame, turned once per reading."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Pose, flip_point
from usarsim_server.simulation.rays.fans import RayFan

__all__ = ["AHEAD", "cone_directions", "fan_at", "wire_directions"]

Array = NDArray[np.float64]

_FLIP = np.array(flip_point((1.0, 1.0, 1.0)))

AHEAD: Array = np.array([[1.0, 0.0, 0.0]])
"""The one direction of a sensor that looks along its mount axis."""


def wire_directions(yaw: Array | float, pitch: Array | float = 0.0) -> Array:
    """Unit vectors (n, 3) in the simulation frame for wire yaw and pitch angles (rad).

    Wire yaw grows to the right, wire pitch grows upward (protocol reference 2.5).
    """
    yaw, pitch = np.broadcast_arrays(np.atleast_1d(yaw), np.atleast_1d(pitch))
    columns = (np.cos(yaw) * np.cos(pitch), np.sin(yaw) * np.cos(pitch), -np.sin(pitch))
    directions: Array = np.column_stack(columns) * _FLIP
    return directions


def cone_directions(half_angle: float, cones: int, rays_per_cone: int) -> Array:
    """Axis and nested cones around it, (1 + cones * rays_per_cone, 3); the axis is row 0.

    Half-angles grow in equal steps up to `half_angle` (rad); the rays of a cone have equal
    distances in azimuth and start sideways, so every cone has rays in the horizontal plane.
    """
    opening = np.repeat(half_angle * np.arange(1, cones + 1) / max(cones, 1), rays_per_cone)
    azimuth = np.tile(math.tau * np.arange(rays_per_cone) / max(rays_per_cone, 1), cones)
    rings = np.column_stack(
        (np.cos(opening), np.sin(opening) * np.cos(azimuth), np.sin(opening) * np.sin(azimuth))
    )
    return np.vstack((AHEAD, rings))


def fan_at(
    pose: Pose,
    directions: Array,
    max_range: float,
    *,
    starts: Array | None = None,
    normals: bool = False,
    through_glass: bool = False,
    identify: bool = False,
) -> RayFan:
    """The fan of a sensor at a world pose.

    Args:
        pose: of the sensor in the world.
        directions: (n, 3) unit vectors in the sensor's frame.
        max_range: m.
        starts: (n, 3) start points in the sensor's frame, m; all in its origin if None.
        normals: also ask for surface normals.
        through_glass: do not see glass.
        identify: also ask what was hit.
    """
    turn = pose.matrix().T
    origin = np.array(pose.position)
    if starts is not None:
        origin = starts @ turn + origin
    return RayFan(origin, directions @ turn, max_range, normals, through_glass, identify)
