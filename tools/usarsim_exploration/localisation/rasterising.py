"""Readings in metres from a pose between cells, as the scans of cells that maps take in."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usarsim_exploration.localisation.poses import Disc, Pose
from usarsim_exploration.localisation.surfaces import Floats, surfaces
from usarsim_exploration.sensing import NEAR, Scans


def rasterise(
    pose: Pose,
    ranges: ArrayLike,
    angles: ArrayLike,
    reach: float,
    cell: float,
    shape: tuple[int, int],
    robots: Sequence[Disc] = (),
) -> Scans:
    """One scan for `KnownMap.take_in`.

    A beam that hit a wall ends half a cell behind its surface, and is free up to half a cell
    before it; so what lies on the border of two cells is drawn in the wall's.

    Args:
        pose: of the scanner, in the environment's frame. ranges: (n,) m; NaN: nothing is known;
            infinite, or `reach` and more: nothing was hit. angles: (n,) in order, rad, 0 is ahead.
        reach: of the scanner, m. cell: width of one, m. shape: rows and columns of the world;
            beams end at its edge.
        robots: where others are believed to be: beams that end there hit no wall.
    """
    read, turns = np.asarray(ranges, float), np.asarray(angles, float)
    scaled = np.where(np.isnan(read), 0.0, np.clip(read, 0.0, reach)) / cell
    far = reach / cell
    start = np.array(pose[:2]) / cell
    headings = pose[2] + turns
    directions = np.stack([np.cos(headings), np.sin(headings)])
    edge = _edge(start, directions, shape)
    hits = np.isfinite(read) & (scaled < far - 2) & (scaled < edge) & (scaled > 0)
    tips = start + np.minimum(scaled, edge)[:, None] * directions.T
    for x, y, radius in robots:
        hits &= np.hypot(tips[:, 0] - x / cell, tips[:, 1] - y / cell) > radius / cell
    inwards = np.where(hits, _inwards(read, turns, reach, pose[2], directions), 0.0) / 2
    free = np.where(scaled > 0, scaled, 0.0)
    near = np.minimum(free, NEAR * far)
    before = np.where(hits & (free > near), 0.0, inwards)

    def cells(places: Floats) -> NDArray[np.int64]:
        most = np.array([shape[1] - 1, shape[0] - 1])
        found: NDArray[np.int64] = np.clip(np.floor(places).astype(np.int64), 0, most)
        return found

    def at(lengths: Floats) -> Floats:
        places: Floats = start + np.minimum(lengths, edge)[:, None] * directions.T
        return places

    here = cells(start)
    ends = cells(tips + inwards.T)
    away = np.hypot(*(ends - here).T)
    return Scans(
        cells=here[None],
        readings=away[None],
        ends=ends[None],
        free_ends=cells(at(free) - inwards.T)[None],
        near_ends=cells(at(near) - before.T)[None],
        hits=(hits & (away < far - 2))[None],
        directions=directions[None],
    )


def _edge(start: Floats, directions: Floats, shape: tuple[int, int]) -> Floats:
    """How far beams come until they leave the world, cells."""
    size = np.array([shape[1], shape[0]])[:, None] - 1e-6
    with np.errstate(divide="ignore", invalid="ignore"):
        found = np.where(directions > 0, size - start[:, None], -start[:, None]) / directions
    nearest: Floats = np.maximum(np.where(directions == 0, math.inf, found).min(axis=0), 0.0)
    return nearest


def _inwards(read: Floats, turns: Floats, reach: float, heading: float, along: Floats) -> Floats:
    """(2, n) into the surface that each beam hit; along the beam where that is not known."""
    _, normals = surfaces(read, turns, reach)
    cosine, sine = math.cos(heading), math.sin(heading)
    turned = -np.array([[cosine, -sine], [sine, cosine]]) @ normals.T
    found: Floats = np.where(np.isfinite(turned), turned, along)
    return found
