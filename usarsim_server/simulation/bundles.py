"""Rays against a model by MuJoCo itself: bundles from one point at once, others one by one."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.rays import RayFan

__all__ = ["cast_some"]

Array = NDArray[np.float64]
Hits = tuple[Array, NDArray[np.int32], Array | None]


def cast_some(
    model: mujoco.MjModel, data: mujoco.MjData, fan: RayFan, rays: NDArray[np.intp]
) -> Hits:
    """Cast some rays of a fan against the visible geoms that are not static.

    Returns:
        Distances (k,), infinity for a miss; geoms (k,), -1 for a miss; unit normals (k, 3) if the
        fan asks for them. Hits beyond the fan's range may be among them.
    """
    directions = np.ascontiguousarray(fan.directions[rays], dtype=float)
    distances, geoms = np.empty(len(rays)), np.empty(len(rays), dtype=np.int32)
    normals = np.zeros((len(rays), 3)) if fan.normals else None
    if fan.origin.ndim == 1:
        start = np.ascontiguousarray(fan.origin, dtype=float)
        mujoco.mj_multiRay(
            model,
            data,
            start,
            directions.reshape(-1),
            None,
            0,
            -1,
            geoms,
            distances,
            None if normals is None else normals.reshape(-1),
            len(rays),
            fan.max_range,
        )
    else:
        starts = np.ascontiguousarray(np.broadcast_to(fan.origin, fan.directions.shape)[rays])
        # A bundle prepares itself by a look at all geoms of the model; for a single ray that is
        # most of the work, so a ray that shares its start with no other is better cast alone.
        for row in range(len(rays)):
            distances[row] = mujoco.mj_ray(
                model,
                data,
                starts[row],
                directions[row],
                None,
                0,
                -1,
                geoms[row : row + 1],
                None if normals is None else normals[row],
            )
    return np.where(geoms < 0, np.inf, distances), geoms, normals
