"""Turns and shifts a scan until it lies on the walls that are known.

Point-to-line matching (A. Censi, An ICP variant using a point-to-line metric, ICRA 2008) by
Gauss-Newton steps with Tukey's weights, from where odometry says that the robot is. How far
odometry can be trusted counts like one more measurement, so it decides what the scan cannot
tell: how far the robot came along a corridor without doors, and all in an open hall.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from usarsim_exploration.localisation.point_map import PointMap
from usarsim_exploration.localisation.poses import Pose, wrap
from usarsim_exploration.localisation.surfaces import Floats

GATES = (0.6, 0.6, 0.4, 0.3, 0.2, 0.2, 0.15, 0.15, 0.15, 0.15)
"""What is farther away than this from the nearest wall does not count, m; one for each step."""
_SCATTER = 0.02
"""Standard deviation of a beam, m: above its noise, as beams err together. With 0.05 m an INS that
is wrong beats the few beams that come past other robots, with 0.01 m what is no wall beats it."""
_ALIKE = 0.8
"""Cosine of the angle between surfaces that can be the same."""
_STILL = 5e-4
"""Steps below this, m and rad, end it."""
FEWEST = 12
"""Beams on known walls without which odometry alone is right."""

_UNLIKELY = 4.0
"""Standard deviations of odometry beyond which what fits is another wall: none."""
_CERTAIN = 0.03
"""Headings that are known better than this are not searched, rad."""
_APART, _MOST = 0.05, 20
"""Headings that are tried on either side: so far apart, rad, as there are not too many."""


@dataclass(frozen=True, slots=True)
class Match:
    """Where a scan fits.

    Attributes:
        pose: of the scanner; the guess where nothing fits. beams: that lie on known walls.
        error: mean of their distances, m.
    """

    pose: Pose
    beams: int
    error: float


def match(
    walls: PointMap, points: Floats, normals: Floats, guess: Pose, deviation: tuple[float, float]
) -> Match:
    """Fit a scan to walls.

    Args:
        walls: prepared around the guess. points, normals: (n, 2) as the scanner sees them.
        guess: pose of the scanner by odometry. deviation: of its place, m, and heading, rad.
    """
    x, y, heading = guess[0], guess[1], _turned(walls, points, normals, guess, deviation[1])
    trust = np.diag([deviation[0] ** -2, deviation[0] ** -2, deviation[1] ** -2])
    beams, error = 0, 0.0
    for number, gate in enumerate(GATES):
        cosine, sine = math.cos(heading), math.sin(heading)
        turn = np.array([[cosine, sine], [-sine, cosine]])
        arms, facing = points @ turn, normals @ turn
        placed = arms + np.array([x, y])
        nearest, across, found = walls.nearest(placed, facing)
        away = placed - nearest
        found &= ((facing * across).sum(axis=1) > _ALIKE) & ((away * away).sum(axis=1) < gate**2)
        beams = int(np.count_nonzero(found))
        if beams < FEWEST:
            return Match(guess, beams, 0.0)
        arms, across, away = arms[found], across[found], away[found]
        rest = (across * away).sum(axis=1)
        error = float(np.abs(rest).mean())
        weights = (1 - (rest / gate) ** 2) ** 2 / _SCATTER**2
        slope = np.column_stack([across, across[:, 1] * arms[:, 0] - across[:, 0] * arms[:, 1]])
        off = np.array([x - guess[0], y - guess[1], wrap(heading - guess[2])])
        weighted = slope * weights[:, None]
        step = -np.linalg.solve(weighted.T @ slope + trust, weighted.T @ rest + trust @ off)
        x, y, heading = (old + float(more) for old, more in zip((x, y, heading), step, strict=True))
        if number >= 4 and np.abs(step).max() < _STILL:
            break
    shift, turned = math.dist((x, y), guess[:2]), abs(wrap(heading - guess[2]))
    if max(shift / deviation[0], turned / deviation[1]) > _UNLIKELY:
        return Match(guess, 0, 0.0)
    return Match((x, y, wrap(heading)), beams, error)


def _turned(
    walls: PointMap, points: Floats, normals: Floats, guess: Pose, deviation: float
) -> float:
    """The heading, rad, of some around the guess with which most beams lie on known walls."""
    if deviation < _CERTAIN:
        return guess[2]
    count = min(math.ceil(2 * deviation / _APART), _MOST)
    shifts = 2 * deviation * np.arange(-count, count + 1) / count
    headings = guess[2] + shifts[np.argsort(abs(shifts), kind="stable")]  # the first of equals
    cosines, sines = np.cos(headings), np.sin(headings)
    turns = np.array([[cosines, sines], [-sines, cosines]]).transpose(2, 0, 1)
    placed, facing = points @ turns + guess[:2], (normals @ turns).reshape(-1, 2)
    nearest, across, found = walls.nearest(placed.reshape(-1, 2), facing)
    rest = (across * (placed.reshape(-1, 2) - nearest)).sum(axis=1)
    good = found & ((facing * across).sum(axis=1) > _ALIKE)
    fits = np.where(good, np.maximum(1 - (rest / GATES[2]) ** 2, 0.0), 0.0)
    return float(headings[np.argmax(fits.reshape(len(headings), -1).sum(axis=1))])
