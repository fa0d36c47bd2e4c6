"""Where the beams of a scan end, and how the surfaces that they hit are turned."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.localisation.poses import Pose

Floats = NDArray[np.float64]
_BESIDE = 4, 2
"""Beams on either side that tell how a surface is turned; fewer where it is too short for more."""
_THICK = 0.03
"""Standard deviation of points from their line, m; what is thicker is no surface."""
_SURE = 0.1
"""Standard deviation of how a surface is turned, rad; what is less certain is no surface."""
_APART = 0.05
"""Beams side by side that end farther apart than this and a tenth of the range see different
surfaces, m: lines through both would be walls that nobody has built."""


def beam_ends(ranges: Floats, angles: Floats, pose: Pose) -> Floats:
    """(n, 2) places where rays end, m.

    Args:
        ranges: (n,) m. angles: (n,) rad, to the right positive. pose: of the scanner.
    """
    turned = pose[2] + angles
    along = np.stack([np.cos(turned), np.sin(turned)], axis=1)
    return np.asarray(np.array(pose[:2]) + ranges[:, None] * along)


def surfaces(ranges: Floats, angles: Floats, reach: float) -> tuple[Floats, Floats]:
    """Ends of beams that hit something, and normals of what they hit.

    Args:
        ranges: (n,) m; what is not finite or not below `reach` hit nothing. angles: (n,) rad,
            in order. reach: m.

    Returns:
        Points (n, 2) as the scanner sees them, m; NaN where nothing was hit. Normals (n, 2)
        of length 1 towards the scanner; NaN where no line fits through a point and its
        neighbours.
    """
    hit = np.isfinite(ranges) & (ranges > 0) & (ranges < reach)
    lengths = np.where(hit, ranges, np.nan)
    points = np.stack([lengths * np.cos(angles), lengths * np.sin(angles)], axis=1)
    normals = np.full(points.shape, np.nan)
    for beside in _BESIDE:
        bare = np.isnan(normals[:, 0])
        normals[bare] = _normals(points, lengths, beside)[bare]
    return points, normals


def _normals(points: Floats, lengths: Floats, beside: int) -> Floats:
    """Normals by so many beams on either side; NaN where they tell none."""
    padded = np.pad(points, ((beside, beside), (0, 0)), constant_values=np.nan)
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * beside + 1, axis=0)
    away = around - points[:, :, None]  # (n, 2, window)
    joined = np.hypot(*np.diff(points, axis=0).T) < _APART + 0.1 * lengths[1:]
    runs = np.concatenate([[0], np.cumsum(~joined)])  # NaN begins a new one
    runs[np.isnan(lengths)] = -1
    windows = np.lib.stride_tricks.sliding_window_view(
        np.pad(runs, beside, constant_values=-1), 2 * beside + 1
    )
    near = (windows == runs[:, None]) & (windows >= 0)
    away = np.where(near[:, None], away, 0.0)
    count = np.maximum(near.sum(axis=1), 1)
    x, y = (away - away.sum(axis=2)[:, :, None] / count[:, None, None]).swapaxes(0, 1)
    xx = np.where(near, x * x, 0).sum(axis=1) / count
    yy = np.where(near, y * y, 0).sum(axis=1) / count
    xy = np.where(near, x * y, 0).sum(axis=1) / count
    spread = np.hypot(xx - yy, 2 * xy)
    thick, long = (xx + yy - spread) / 2, (xx + yy + spread) / 2
    thin = (thick < _THICK**2) & (thick < _SURE**2 * count * long)
    across = np.arctan2(2 * xy, xx - yy) / 2 + np.pi / 2
    normals = np.stack([np.cos(across), np.sin(across)], axis=1)
    normals *= -np.sign((normals * points).sum(axis=1))[:, None]
    normals[~(thin & (count >= 3))] = np.nan
    return normals
