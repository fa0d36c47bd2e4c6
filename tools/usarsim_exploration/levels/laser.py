"""A laser scan in metres as what a map takes in: cells where rays end."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.sensing import NEAR, Scans

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose:
    """Where a robot is: m from the left and the upper edge of the map, rad clockwise from right."""

    x: float
    y: float
    heading: float

    def ahead(self, length: float) -> tuple[float, float]:
        """A place so many m ahead."""
        return self.x + length * math.cos(self.heading), self.y + length * math.sin(self.heading)


@dataclass(frozen=True, slots=True)
class Disc:
    """Something round that is no wall, such as a robot. x, y, radius: m."""

    x: float
    y: float
    radius: float


def hits(pose: Pose, mount: float, ranges: Floats, angles: Floats) -> Floats:
    """(n, 2) places where rays end, m.

    Args:
        mount: how far ahead of the robot's middle the scanner sits, m.
        ranges: (n,) m. angles: (n,) rad, to the right positive.
    """
    turned = pose.heading + angles
    start = np.array(pose.ahead(mount))
    return np.asarray(start + ranges[:, None] * np.stack([np.cos(turned), np.sin(turned)], axis=1))


def rasterise(
    pose: Pose,
    mount: float,
    ranges: Floats,
    angles: Floats,
    reach: int,
    cell: float,
    shape: tuple[int, int],
    others: Iterable[Disc] = (),
) -> Scans:
    """One scan as seen from the robot's middle.

    Args:
        pose, mount, ranges, angles: see `hits`. reach: of rays that count, cells.
        cell: width of one, m. shape: rows and columns of the map.
        others: what rays end at without being a wall.
    """
    turned = pose.heading + angles
    directions = np.stack([np.cos(turned), np.sin(turned)])
    most = reach * cell
    lengths = np.minimum(ranges, most)
    ends = hits(pose, mount, lengths, angles)
    wall = ranges < most - 2 * cell
    for disc in others:
        wall &= np.hypot(ends[:, 0] - disc.x, ends[:, 1] - disc.y) > disc.radius
    start, half = np.array(pose.ahead(mount)), 0.5 * cell
    limits = np.array([shape[1] - 1, shape[0] - 1])

    def cells(along: Floats) -> NDArray[np.int64]:
        places = start + along[:, None] * directions.T
        found: NDArray[np.int64] = np.clip(np.floor(places / cell).astype(np.int64), 0, limits)
        return found

    free = np.maximum(lengths - half, 0.0)
    free_ends, last = cells(free), cells(lengths + half)
    beside = (last == free_ends).all(axis=1) & wall
    last[beside] = cells(lengths + 2 * half)[beside]
    here = np.clip(np.floor(np.array([[pose.x, pose.y]]) / cell).astype(np.int64), 0, limits)
    final = np.where(wall[:, None], last, free_ends)
    near = cells(np.minimum(free, NEAR * most))
    return Scans(
        here, lengths[None] / cell, final[None], free_ends[None], near[None], wall[None],
        directions[None],
    )  # fmt: skip
