"""Readings of a range finder from anywhere in a world of cells, exact, and drives through it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import cv2
import numpy as np

from usarsim_exploration.environment import Cell, Environment
from usarsim_exploration.localisation import Pose
from usarsim_exploration.planning import Field

FAN = np.linspace(-math.pi / 2, math.pi / 2, 181)


def read(
    world: Environment, pose: Pose, reach: float, robots: Sequence[tuple[float, float]] = ()
) -> np.ndarray:
    """Ranges of `FAN`, m; `reach` where nothing is. robots: middles of posts 0.5 m thick, m."""
    rows, columns = world.shape
    headings = pose[2] + FAN
    along = np.stack([np.cos(headings), np.sin(headings)])
    start, far = np.array(pose[:2]) / world.cell, reach / world.cell
    steps = np.arange(int(far) + 1)
    best = np.full(len(FAN), far)
    for axis in range(2):  # where rays cross the borders of columns, then of rows
        sign = np.sign(along[axis])[:, None]
        first = np.where(sign > 0, np.floor(start[axis]) + 1, np.ceil(start[axis]) - 1)
        border = first + sign * steps
        with np.errstate(divide="ignore", invalid="ignore"):
            way = np.nan_to_num((border - start[axis]) / along[axis][:, None], nan=2 * far)
        way = np.clip(way, 0, 2 * far)
        beyond = (border - (sign < 0)).astype(int)
        across = np.floor(start[1 - axis] + way * along[1 - axis][:, None]).astype(int)
        column, row = (beyond, across) if axis == 0 else (across, beyond)
        inside = (column >= 0) & (column < columns) & (row >= 0) & (row < rows) & (way < far)
        wall = world.walls[np.clip(row, 0, rows - 1), np.clip(column, 0, columns - 1)] != 0
        best = np.minimum(best, np.where(inside & wall, way, far).min(axis=1))
    found = best * world.cell
    for robot in robots:
        off = np.array(robot) - pose[:2]
        ahead, aside = off @ along, off[0] * along[1] - off[1] * along[0]
        front = ahead - np.sqrt(np.maximum(0.25**2 - aside**2, 0))
        found = np.where((front > 0) & (abs(aside) < 0.25), np.minimum(found, front), found)
    return found


def drive(world: Environment, stops: Sequence[Cell], step: float) -> Iterator[Pose]:
    """Poses on a way over some cells, `step` apart, m, or 0.3 rad."""
    clear = cv2.distanceTransform((world.walls == 0).astype(np.uint8), cv2.DIST_L2, 5) > 4
    free = clear.astype(np.uint8)
    cells = [stops[0]]
    for begin, end in pairwise(stops):
        cells += Field(free, [begin], free.size).path(end) or []
    padded = np.pad((np.array(cells) + 0.5) * world.cell, ((4, 4), (0, 0)), mode="edge")
    smooth = np.stack([np.convolve(part, np.full(9, 1 / 9), "valid") for part in padded.T])
    far = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(smooth)))])
    at = np.arange(0, far[-1], step)
    x, y = (np.interp(at, far, part) for part in smooth)
    headings = np.unwrap(np.arctan2(np.gradient(y), np.gradient(x)))
    heading = float(headings[0])
    for here in zip(x.tolist(), y.tolist(), headings.tolist(), strict=True):
        while abs(here[2] - heading) > 0.3:
            heading += math.copysign(0.3, here[2] - heading)
            yield here[0], here[1], heading
        heading = here[2]
        yield here
