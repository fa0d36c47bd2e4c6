"""Do the brushes of a level give what the editor has built from them?

Two independent ways to the same answer: the order of the brushes with the winding number of each
about a point, and the tree that is stored in the map (worlds reference 5.2).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.scene import Brush, BrushOperation, Solidity
from usarsim_maps.unreal.brushes import BuiltLevel

__all__ = ["agreement", "inside"]

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

POINTS = 600
"""Points that are looked at in a whole level."""

MAX_BRUSHES = 2_000
"""Levels with more are not compared: it would take seconds."""


def agreement(brushes: Sequence[Brush], built: BuiltLevel, scale: float) -> tuple[int, int]:
    """How many points brushes and tree agree about, and how many were asked.

    Args:
        brushes: of the level, in order, in metres.
        built: the tree, in Unreal units.
        scale: Unreal units per metre.
    """
    solids = [brush for brush in brushes if brush.solidity is not Solidity.NONSOLID]
    if not solids or len(solids) > MAX_BRUSHES:
        return 0, 0
    generator = np.random.default_rng(0)
    share = max(2, POINTS // len(solids))
    points = np.concatenate([_sample(brush, share, generator) for brush in solids])
    told = built.solid(points * [1.0, -1.0, 1.0] * scale)
    return int((told == _program(solids, points, not built.outside)).sum()), len(points)


def _sample(brush: Brush, count: int, generator: np.random.Generator) -> Array:
    """Points in and close to a brush."""
    corners = np.concatenate([polygon.vertices for polygon in brush.polygons])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.05 * (high - low)
    return generator.uniform(low - margin, high + margin, (count, 3))


def _program(brushes: Sequence[Brush], points: Array, filled: bool) -> Bools:
    """Carry out the brushes at some points; semisolid ones act last."""
    solid = np.full(len(points), filled)
    late = [brush for brush in brushes if brush.solidity is Solidity.SEMISOLID]
    early = [brush for brush in brushes if brush.solidity is Solidity.SOLID]
    for brush in (*early, *late):
        corners = np.concatenate([polygon.vertices for polygon in brush.polygons])
        low, high = corners.min(axis=0), corners.max(axis=0)
        near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
        if len(near):
            covered = near[inside(brush, points[near])]
            solid[covered] = brush.operation is BrushOperation.ADD
    return solid


def inside(brush: Brush, points: Array) -> Bools:
    """Whether points (n, 3) are in a brush: its faces wind about them.

    The sum of solid angles (van Oosterom and Strackee 1983) needs neither convex nor closed faces.
    """
    total = np.zeros(len(points))
    for polygon in brush.polygons:
        corners = polygon.vertices
        for k in range(1, len(corners) - 1):
            a, b, c = (corners[i] - points for i in (0, k, k + 1))
            la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
            volume = (a * np.cross(b, c)).sum(axis=1)
            rest = la * lb * lc + (a * b).sum(axis=1) * lc
            rest += (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
            total += 2.0 * np.arctan2(volume, rest)
    answer: Bools = np.abs(total) > 2.0 * np.pi
    return answer
