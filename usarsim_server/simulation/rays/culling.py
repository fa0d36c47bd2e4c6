"""Which rays can reach anything that moves: cones of fans, then rays, against bounding spheres."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.rays.query import RayBatch

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
    geoms = np.flatnonzero(model.body_weldid[model.geom_bodyid] != 0)
    bodies = model.geom_bodyid[geoms]
    away = np.linalg.norm(model.geom_pos[geoms], axis=1) + model.geom_rbound[geoms]
    radius = np.full(model.nbody, -np.inf)
    np.maximum.at(radius, model.body_rootid[bodies], reach[bodies] + away)
    roots = np.flatnonzero(radius >= 0.0)
    return roots, radius[roots], {int(root): index for index, root in enumerate(roots)}


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
    near = _near(ahead, away, radii)
    near &= ahead - radii <= reach + SLACK
    return near


def _near(ahead: Array, away: Array, radii: Array) -> NDArray[np.bool_]:
    """Whether centres so far ahead along rays, and so far away squared, are within their radii."""
    limit = (1.0 - ROUNDING) * away - (radii + SLACK) ** 2
    # The way ahead squared, nothing if the centre lies behind; the rest is the distance squared.
    forward = np.maximum(ahead, 0.0)
    forward *= forward
    return forward >= limit


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
    seen = _in_view(batch, reach, spheres, own)
    counts = np.diff(batch.begins)
    large = (counts >= LARGE) & batch.together
    none = np.zeros(0, dtype=np.intp)
    found = [(none, none)]
    for count in set(counts[large].tolist()):
        fans = np.flatnonzero(large & (counts == count) & seen.any(axis=1))
        found += _met_by_large(batch, fans, count, seen, reach, spheres)
    found += _met_by_small(batch, ~large, counts, seen, reach, spheres)
    rays, met = zip(*found, strict=True)
    return np.concatenate(rays), np.concatenate(met)


def _met_by_large(
    batch: RayBatch,
    fans: Numbers,
    count: int,
    seen: NDArray[np.bool_],
    reach: Array,
    spheres: Spheres,
) -> list[tuple[Numbers, Numbers]]:
    """Pairs of fans whose rays, the same number for each, start at one point: matrix products."""
    if not len(fans):
        return []
    chosen = np.flatnonzero(seen[fans].any(axis=0))
    centres, radii = spheres.centres[chosen], spheres.radii[chosen]
    pairs = []
    portions = 1 + len(fans) * count * len(chosen) // PAIRS_AT_ONCE
    for some in np.array_split(fans, min(portions, len(fans))):
        rays = batch.begins[some][:, None] + np.arange(count)
        offset = centres - batch.origins[rays[:, :1]]
        ahead = batch.directions[rays] @ offset.transpose(0, 2, 1)
        away = np.einsum("fti,fti->ft", offset, offset)[:, None]
        near = _near(ahead, away, radii)
        near &= seen[some][:, None, chosen]
        fan, ray, sphere = np.nonzero(near)
        within = ahead[fan, ray, sphere] - radii[sphere] <= reach[rays[fan, ray]] + SLACK
        pairs.append((rays[fan, ray][within], chosen[sphere[within]]))
    return pairs


def _met_by_small(
    batch: RayBatch,
    small: NDArray[np.bool_],
    counts: Numbers,
    seen: NDArray[np.bool_],
    reach: Array,
    spheres: Spheres,
) -> list[tuple[Numbers, Numbers]]:
    """Pairs of all other fans, every ray of a fan with every sphere that its cone touches."""
    fans, found = np.nonzero(seen & small[:, None])
    pairs = []
    for some in _portions(counts[fans]):
        ray, sphere = _spread(batch, fans[some], found[some], counts)
        near = passing(
            batch.origins[ray],
            batch.directions[ray],
            reach[ray],
            spheres.centres[sphere],
            spheres.radii[sphere],
        )
        pairs.append((ray[near], sphere[near]))
    return pairs


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
