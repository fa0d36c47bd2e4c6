"""Where the pictures of a world cut through what is solid: convex sections at one height."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.rays.tessellation import triangles_of_all

__all__ = ["covered", "cut_lines", "sections"]

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

FELT = 3
"""Group of the pieces that only collide."""

CONVEX = {int(mujoco.mjtGeom.mjGEOM_BOX), int(mujoco.mjtGeom.mjGEOM_MESH)}
"""Kinds of pieces; terrain, which is neither, is not cut."""

NARROW = 1e-9
"""m: sections with less between their corners are none."""


def sections(model: mujoco.MjModel, data: mujoco.MjData, level: float) -> Iterator[Array]:
    """Corners (k, 2), in order around it, of the cut through every fixed convex piece.

    Args:
        model: compiled. data: after `mj_forward`.
        level: m, height of the cut.
    """
    chosen = (model.body_weldid[model.geom_bodyid] == 0) & (model.geom_group == FELT)
    chosen &= np.isin(model.geom_type, list(CONVEX))
    chosen &= np.abs(data.geom_xpos[:, 2] - level) <= model.geom_rbound
    faces, owners = triangles_of_all(
        model, np.flatnonzero(chosen).tolist(), data.geom_xpos, data.geom_xmat
    )
    ends, cut = cut_lines(faces, level)
    owners = np.repeat(owners[cut], 2)
    corners = ends.reshape(-1, 2)
    order = np.argsort(owners, kind="stable")
    owners, corners = owners[order], corners[order]
    starts = np.flatnonzero(np.diff(owners, prepend=-1))
    if not len(starts):
        return
    middles = np.minimum.reduceat(corners, starts) + np.maximum.reduceat(corners, starts)
    away = corners - np.repeat(middles / 2.0, np.diff(starts, append=len(owners)), axis=0)
    around = np.lexsort((np.arctan2(away[:, 1], away[:, 0]), owners))
    yield from (part for part in np.split(corners[around], starts[1:]) if len(part) >= 6)


def cut_lines(triangles: Array, level: float) -> tuple[Array, NDArray[np.intp]]:
    """The lines in which triangles (n, 3, 3) meet a height: ends (k, 2, 2), and whose they are."""
    above = triangles[:, :, 2] > level
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    start, end = triangles[cut], np.roll(triangles[cut], -1, axis=1)
    crossed = above[cut] != np.roll(above[cut], -1, axis=1)  # two edges of each
    p, q = start[crossed], end[crossed]
    share = (level - p[:, 2]) / (q[:, 2] - p[:, 2])
    places = p[:, :2] + (q - p)[:, :2] * share[:, None]
    return places.reshape(-1, 2, 2), cut


def covered(x: Array, y: Array, section: Array) -> Mask:
    """Which of some places (any shape, m) lie in a convex section."""
    inside = np.ones(x.shape, dtype=bool)
    for (px, py), (qx, qy) in zip(section, np.roll(section, -1, axis=0), strict=True):
        if abs(qx - px) + abs(qy - py) > NARROW:
            inside &= (qx - px) * (y - py) - (qy - py) * (x - px) >= 0.0
    return inside
