"""Which fans, and which of their rays, can reach anything that moves: cones and rays against
bounding spheres."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.rays import RayFan

__all__ = ["bounding_spheres", "cones", "starts", "touching"]

Array = NDArray[np.float64]

SLACK = 1e-6
"""m by which spheres are taken larger: rounding must not lose a ray that grazes one."""
ROUNDING = 1e-12
"""Relative error of a square of a distance that is reckoned with, many times the true one."""


def bounding_spheres(model: mujoco.MjModel) -> tuple[NDArray[np.intp], Array, dict[int, int]]:
    """Root bodies of all moving trees and the radius around each root that holds its geoms.

    The radius holds whatever the joints do: it is the length of the stretched chain of bodies.
    """
    reach = np.zeros(model.nbody)
    for body in range(1, model.nbody):
        if model.body_rootid[body] != body:
            reach[body] = reach[model.body_parentid[body]] + _stretch(model, body)
    radius: dict[int, float] = {}
    for geom in range(model.ngeom):
        body = model.geom_bodyid[geom]
        if model.body_weldid[body] == 0:
            continue
        root = int(model.body_rootid[body])
        away = float(np.linalg.norm(model.geom_pos[geom])) + float(model.geom_rbound[geom])
        radius[root] = max(radius.get(root, 0.0), float(reach[body]) + away)
    roots = np.array(sorted(radius), dtype=np.intp)
    radii = np.array([radius[int(root)] for root in roots])
    return roots, radii, {int(root): index for index, root in enumerate(roots)}


def _stretch(model: mujoco.MjModel, body: int) -> float:
    """Largest distance (m) of a body's origin from its parent's, whatever its joints do."""
    length = float(np.linalg.norm(model.body_pos[body]))
    first = model.body_jntadr[body]
    for joint in range(first, first + model.body_jntnum[body]):
        if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE:
            limited = model.jnt_limited[joint]
            length += float(np.abs(model.jnt_range[joint]).max()) if limited else np.inf
        else:  # the origin turns about an anchor that need not be the origin
            length += 2.0 * float(np.linalg.norm(model.jnt_pos[joint]))
    return length


def starts(fans: Sequence[RayFan]) -> tuple[Array, Array]:
    """Middle (f, 3) of the start points of each fan, and how far they are away from it (f,)."""
    if all(fan.origin.ndim == 1 for fan in fans):
        return np.array([fan.origin for fan in fans]), np.zeros(len(fans))
    starts = [np.atleast_2d(fan.origin) for fan in fans]
    middles = [points.mean(axis=0) for points in starts]
    spreads = [
        np.linalg.norm(points - middle, axis=1).max()
        for points, middle in zip(starts, middles, strict=True)
    ]
    return np.array(middles), np.array(spreads)


def cones(fans: Sequence[RayFan]) -> tuple[Array, Array]:
    """Axis (f, 3) and half angle (f,) of a cone around the rays of each fan."""
    axes = np.empty((len(fans), 3))
    half = np.empty(len(fans))
    for index, fan in enumerate(fans):
        mean = fan.directions.mean(axis=0)
        norm = float(np.linalg.norm(mean))
        if norm < 0.1:
            axes[index], half[index] = (1.0, 0.0, 0.0), np.pi
            continue
        axes[index] = mean / norm
        half[index] = np.arccos(np.clip((fan.directions @ axes[index]).min(), -1.0, 1.0))
    return axes, half


def touching(fan: RayFan, centres: Array, radii: Array) -> NDArray[np.bool_]:
    """Which rays (n,) of a fan pass through a sphere, or begin in one.

    Args:
        fan: its range does not matter.
        centres: (t, 3) m.
        radii: (t,) m, infinity included.
    """
    if fan.origin.ndim == 1:
        offset = centres - fan.origin
        ahead = fan.directions @ offset.T
        away = np.einsum("ti,ti->t", offset, offset)
    else:
        offset = centres[None] - fan.origin[:, None]
        ahead = np.einsum("nti,ni->nt", offset, fan.directions)
        away = np.einsum("nti,nti->nt", offset, offset)
    # The square of the distance of a centre from the ray; from its start if it lies behind.
    gap = (1.0 - ROUNDING) * away - np.maximum(ahead, 0.0) ** 2
    touched: NDArray[np.bool_] = (gap <= (radii + SLACK) ** 2).any(axis=1)
    return touched
