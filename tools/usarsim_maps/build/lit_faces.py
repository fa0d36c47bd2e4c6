"""Large faces cut small where lamps shine on them.

OpenGL as MuJoCo uses it computes light at the corners of triangles, and in between goes from one
to the other. A floor of two triangles has its corners far from the lamp above its middle: it would
stay dark.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Vector

Array = NDArray[np.float64]

STEPS = 6
"""Pieces from a lamp to its reach."""

SHORTEST_LIGHT, LONGEST = 0.25, 2.0
"""m: size of a piece."""

THIN = 1e-3
"""m: a cut this near to a corner is not made."""


@dataclass(frozen=True, slots=True)
class Glow:
    """Where a lamp is, and how far (m) it shines."""

    position: Vector
    reach: float


def cut_for_light(points: Array, glows: Sequence[Glow]) -> list[Array]:
    """Convex pieces of a flat convex face: small ones where a lamp lights it, else the face itself.

    Cuts lie on a grid of the world for each lamp, so that faces that meet are cut at the same
    places.

    Args:
        points: (k, 3) m, counter-clockwise as seen from outside.
        glows: lamps that fade.
    """
    pieces = [points]
    low, high = points.min(axis=0), points.max(axis=0)
    for glow in glows:
        if not _lit(points, low, high, glow):
            continue
        step = min(LONGEST, max(SHORTEST_LIGHT, glow.reach / STEPS))
        for axis in range(3):
            first = max(low[axis], glow.position[axis] - glow.reach)
            last = min(high[axis], glow.position[axis] + glow.reach)
            for number in range(math.ceil(first / step), math.floor(last / step) + 1):
                pieces = [part for piece in pieces for part in _halves(piece, axis, number * step)]
    return pieces


def _lit(points: Array, low: Array, high: Array, glow: Glow) -> bool:
    """Whether a lamp is before a face and within reach of it."""
    place = np.array(glow.position)
    if float(np.linalg.norm(place - np.clip(place, low, high))) > glow.reach:
        return False
    normal = np.zeros(3)
    for p, q in itertools.pairwise(points[1:]):
        normal += np.cross(p - points[0], q - points[0])
    return bool(normal @ (place - points[0]) > 0.0)


def _halves(points: Array, axis: int, at: float) -> list[Array]:
    """The two parts of a convex polygon on either side of a plane, or the whole one."""
    heights = points[:, axis] - at
    if heights.min() > -THIN or heights.max() < THIN:
        return [points]
    below: list[Array] = []
    above: list[Array] = []
    following = np.roll(points, -1, axis=0)
    for p, q, here, there in zip(points, following, heights, np.roll(heights, -1), strict=True):
        if here <= 0.0:
            below.append(p)
        if here >= 0.0:
            above.append(p)
        if (here < 0.0 < there) or (there < 0.0 < here):
            # Always from below to above: neighbours get the same corner, bit for bit.
            a, b, u, v = (p, q, here, there) if here < there else (q, p, there, here)
            middle = a + (b - a) * (u / (u - v))
            middle[axis] = at
            below.append(middle)
            above.append(middle)
    return [np.array(part) for part in (below, above) if len(part) >= 3]
