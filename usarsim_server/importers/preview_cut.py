"""Where the pictures of a world cut through what is solid: convex sections at one height."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.tessellation import triangles

__all__ = ["covered", "cut_line", "sections"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FELT = 3
"""Group of the pieces that only collide."""

CONVEX = {int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)}
"""Kinds of pieces; terrain, which is neither, is not cut."""

NARROW = 1e-9
"""m: sections with less between their corners are none."""


def sections(model: mujoco.MjModel, data: mujoco.MjData, level: float) -> Iterator[Array]:
    """Corners (k, 2), counter-clockwise, of the cut through every fixed convex piece.

    Args:
        model: compiled. data: after `mj_forward`.
        level: m, height of the cut.
    """
    for geom in range(model.ngeom):
        fixed = model.body_weldid[model.geom_bodyid[geom]] == 0
        if not fixed or model.geom_group[geom] != FELT or int(model.geom_type[geom]) not in CONVEX:
            continue
        reach = float(model.geom_rbound[geom])
        if abs(float(data.geom_xpos[geom, 2]) - level) > reach:
            continue
        faces = triangles(model, geom, data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3))
        ends = [end for corners in faces if (end := cut_line(corners, level)) is not None]
        if len(ends) >= 3:
            yield _around(np.concatenate(ends))


def cut_line(corners: Array, level: float) -> Array | None:
    """The ends (2, 2) of the line in which a triangle (3, 3) meets a height, or None."""
    ends = []
    for a, b in ((0, 1), (1, 2), (2, 0)):
        p, q = corners[a], corners[b]
        if (p[2] > level) != (q[2] > level):
            share = (level - p[2]) / (q[2] - p[2])
            ends.append((p + (q - p) * share)[:2])
    return np.array(ends) if len(ends) == 2 else None


def covered(x: Array, y: Array, section: Array) -> Mask:
    """Which of some places (any shape, m) lie in a convex section."""
    inside = np.ones(x.shape, dtype=bool)
    for (px, py), (qx, qy) in zip(section, np.roll(section, -1, axis=0), strict=True):
        if abs(qx - px) + abs(qy - py) > NARROW:
            inside &= (qx - px) * (y - py) - (qy - py) * (x - px) >= 0.0
    return inside


def _around(points: Array) -> Array:
    """Points of a convex outline in their order around the middle."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2.0
    away = points - middle
    return np.asarray(points[np.argsort(np.arctan2(away[:, 1], away[:, 0]))])
