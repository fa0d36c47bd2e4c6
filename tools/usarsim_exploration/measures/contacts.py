"""How often robots of a server run into walls and into each other, by where they truly are."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Environment
from usarsim_exploration.localisation.poses import Pose, relative

Floats = NDArray[np.float64]
HALF = 0.306, 0.287
"""Half the length and width of P3AT over its bumpers, m."""
_TOUCH, _APART = 0.01, 0.04
"""m between two bodies up to which they touch, and up to which they have not come apart again."""
_SPACING = 0.02
"""m between places of an outline that are looked at."""


class Contacts:
    """Counts robots that begin to touch something.

    Attributes:
        walls, robots: how often one met a wall, and two met each other.
    """

    def __init__(self) -> None:
        """Nothing has met yet."""
        self.walls = self.robots = 0
        self._touching: set[tuple[int, int]] = set()  # of two numbers; equal ones: a wall
        self._outlines = {gap: _outline(gap) for gap in (_TOUCH, _APART)}

    def note(self, poses: Mapping[int, Pose], world: Environment) -> None:
        """Tell where robots truly are, at every tick; what is over until the next is not seen.

        Args:
            poses: by number, in the frame of the environment. world: true.
        """
        before, self._touching = self._touching, set()
        for robot, pose in poses.items():
            outline = self._outlines[_APART if (robot, robot) in before else _TOUCH]
            if _meets_wall(outline, pose, world):
                self._touching.add((robot, robot))
                self.walls += (robot, robot) not in before
        for one, other in itertools.combinations(sorted(poses), 2):
            if math.dist(poses[one][:2], poses[other][:2]) > 2 * math.hypot(*HALF) + _APART:
                continue
            outline = self._outlines[_APART if (one, other) in before else _TOUCH]
            seen = relative(poses[one], poses[other])
            if _meets(outline, seen) or _meets(outline, relative(seen, (0.0, 0.0, 0.0))):
                self._touching.add((one, other))
                self.robots += (one, other) not in before

    def facts(self) -> dict[str, float | None]:
        """The measures, for `History.reality`."""
        return {"hit_walls": float(self.walls), "hit_robots": float(self.robots)}


def _outline(gap: float) -> Floats:
    """(n, 2) places around a robot, so far from its bumpers, m."""
    long, wide = HALF[0] + gap, HALF[1] + gap
    ahead = np.linspace(-long, long, math.ceil(2 * long / _SPACING) + 1)
    across = np.linspace(-wide, wide, math.ceil(2 * wide / _SPACING) + 1)
    sides = [np.column_stack([ahead, np.full(len(ahead), side)]) for side in (-wide, wide)]
    ends = [np.column_stack([np.full(len(across), end), across]) for end in (-long, long)]
    return np.vstack(sides + ends)


def _placed(outline: Floats, pose: Pose) -> Floats:
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    found: Floats = outline @ np.array([[cosine, sine], [-sine, cosine]]) + pose[:2]
    return found


def _meets(outline: Floats, other: Pose) -> bool:
    """Whether an outline around a robot reaches into another one, whose pose that robot sees."""
    seen = _placed(outline, relative(other, (0.0, 0.0, 0.0)))
    return bool((np.abs(seen) < HALF).all(axis=1).any())


def _meets_wall(outline: Floats, pose: Pose, world: Environment) -> bool:
    cells = np.floor(_placed(outline, pose) / world.cell).astype(np.int64)
    rows, columns = world.shape
    inside = ((cells >= 0) & (cells < (columns, rows))).all(axis=1)
    column, row = cells[inside].T
    return bool(world.walls[row, column].any())
