"""Which rays can reach anything that moves: cones of fans, then rays, against bounding spheres."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.ray_batch import RayBatch

__all__ = ["Spheres", "bounding_spheres", "meetings", "passing"]

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]

SLACK = 1e-6
"""m by which spheres are taken larger: rounding must not lose a ray that grazes one."""
ROUNDING = 1e-12
"""Relative error of a square of a distance that is reckoned with, many times the true one."""
LARGE = 32
"""Rays from one point from which on a fan is worth a matrix product of its own."""
PAIRS_AT_ONCE = 200_000
"""Pairs of ray and sphere that are looked at together, which bounds the memory."""


@dataclass(frozen=True, slots=True, eq=False)
class Spheres:
    """Centres (t, 3) and radii (t,), infinity included, m."""

    centres: Array
    radii: Array


def bounding_spheres(model: mujoco.MjModel) -> tuple[Numbers, Array, dict[int, int]]:
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


def passing(
    origins: Array, directions: Array, reach: Array, centres: Array, radii: Array
) -> NDArray[np.bool_]:
    """Which rays pass through a sphere within their reach, or begin in it; all given in pairs.

    Args:
        origins: (n, 3) m. directions: (n, 3) unit vectors. reach: (n,) m, infinity included.
        centres: (n, 3) m. radii: (n,) m, infinity included.
    """
    offset = centres - origins
    ahead = np.einsum("ij,ij->i", offset, directions)
    away = np.einsum("ij,ij->i", offset, offset)
    return _near(ahead, away, reach, radii)


def _near(ahead: Array, away: Array, reach: Array, radii: Array) -> NDArray[np.bool_]:
    # The square of the distance of a centre from the ray; from its start if it lies behind.
    gap = (1.0 - ROUNDING) * away - np.maximum(ahead, 0.0) ** 2
    touched: NDArray[np.bool_] = (gap <= (radii + SLACK) ** 2) & (ahead - radii <= reach + SLACK)
    return touched


def meetings(
    batch: RayBatch, reach: Array, spheres: Spheres, own: Numbers
) -> tuple[Numbers, Numbers]:
    """All pairs of a ray and a sphere that it may meet within its reach.

    Args:
        batch: the rays.
        reach: (n,) how far each of them goes, m.
        spheres: what they may meet.
        own: (f,) the sphere that a fan does not see; -1 for none.

    Returns:
        Rays (k,) and spheres (k,).
    """
    fans, found = np.nonzero(_in_view(batch, reach, spheres, own))
    rays: list[Numbers] = []
    met: list[Numbers] = []
    counts = np.diff(batch.begins)
    large = (counts >= LARGE) & batch.together
    for fan in np.unique(fans[large[fans]]).tolist():
        span = slice(batch.begins[fan], batch.begins[fan + 1])
        chosen = found[fans == fan]
        for part in np.array_split(chosen, 1 + len(chosen) * counts[fan] // PAIRS_AT_ONCE):
            sphere, ray = _through(batch, span, reach[span], spheres, part)
            rays.append(ray + span.start)
            met.append(part[sphere])
    rest = ~large[fans]
    fans, found = fans[rest], found[rest]
    for some in _portions(counts[fans]):
        ray, sphere = _spread(batch, fans[some], found[some], counts)
        near = passing(
            batch.origins[ray],
            batch.directions[ray],
            reach[ray],
            spheres.centres[sphere],
            spheres.radii[sphere],
        )
        rays.append(ray[near])
        met.append(sphere[near])
    none = np.zeros(0, dtype=np.intp)
    return np.concatenate([none, *rays]), np.concatenate([none, *met])


def _in_view(batch: RayBatch, reach: Array, spheres: Spheres, own: Numbers) -> NDArray[np.bool_]:
    """Which fans' cones (f) touch which spheres (t) within the reach of their longest ray."""
    origins, spreads = batch.starts
    axes, half = batch.cones
    farthest = np.maximum.reduceat(reach, batch.begins[:-1])
    radii = spheres.radii[None] + spreads[:, None]
    offset = spheres.centres[None] - origins[:, None]
    distance = np.linalg.norm(offset, axis=2)
    safe = np.maximum(distance, 1e-9)
    cosine = np.einsum("fti,fi->ft", offset, axes) / safe
    spread = np.arcsin(np.minimum(1.0, radii / safe))
    angle = np.arccos(np.clip(cosine, -1.0, 1.0))
    seen: NDArray[np.bool_] = (angle - spread <= half[:, None] + SLACK) | (distance <= radii)
    seen &= distance - radii <= farthest[:, None]
    looking = np.flatnonzero(own >= 0)
    seen[looking, own[looking]] = False
    return seen


def _through(
    batch: RayBatch, span: slice, reach: Array, spheres: Spheres, chosen: Numbers
) -> tuple[Numbers, Numbers]:
    """Pairs of sphere and ray of one fan whose rays start at one point, each counted from 0."""
    offset = spheres.centres[chosen] - batch.origins[span.start]
    ahead = offset @ batch.directions[span].T
    away = np.einsum("ti,ti->t", offset, offset)[:, None]
    near = _near(ahead, away, reach[None], spheres.radii[chosen][:, None])
    sphere, ray = np.nonzero(near)
    return sphere, ray


def _spread(
    batch: RayBatch, fans: Numbers, spheres: Numbers, counts: Numbers
) -> tuple[Numbers, Numbers]:
    """Every ray of each fan with the sphere that goes with the fan."""
    each = counts[fans]
    before = np.cumsum(each) - each
    ray = np.repeat(batch.begins[fans] - before, each) + np.arange(int(each.sum()))
    return ray, np.repeat(spheres, each)


def _portions(sizes: Numbers) -> list[slice]:
    """Parts of a list whose sizes add up to no more than `PAIRS_AT_ONCE`, but for single ones."""
    if not len(sizes):
        return []
    number = np.cumsum(sizes) // PAIRS_AT_ONCE
    cuts = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(sizes)]
    return [slice(a, b) for a, b in pairwise(cuts)]
