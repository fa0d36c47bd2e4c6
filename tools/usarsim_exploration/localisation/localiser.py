"""Follows a robot: by the truth, by odometry alone, or by odometry and its scans."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from usarsim_exploration.localisation.matching import FEWEST, match
from usarsim_exploration.localisation.point_map import PointMap
from usarsim_exploration.localisation.poses import Disc, Pose, compose, relative
from usarsim_exploration.localisation.surfaces import Floats, surfaces

Mode = Literal["truth", "odometry", "scan-matching"]
MODES: tuple[Mode, ...] = get_args(Mode)
_KEEP_WAY, _KEEP_TURN = 0.25, 0.2
"""Way, m, and turn, rad, after which a scan becomes part of the map."""
_RELY_WAY, _RELY_TURN = 0.25, 0.05
"""Way, m, and turn, rad, for which odometry alone is good enough: its error stays below 4 cm."""
_NEAR = 15.0
"""Walls are matched as far from the robot as this, m."""
_AROUND = 2.0
"""Around what the last scan of the map saw, walls are matched, too, m."""
_VAGUE = 1.0
"""Robots whose places are less certain are not taken out of scans, m: too much would go. What is
seen there finds no wall to be matched with, since it never becomes one."""
_BLIND = 2.0
"""Way without a match after which the surroundings are taken for new ones, m."""


class Motion(NamedTuple):
    """How far motion that a robot feels can be trusted: standard deviations of a pose by it.

    Attributes:
        place: m while it stands, by m of way, and by rad of turn. heading: rad, likewise.
    """

    place: tuple[float, float, float]
    heading: tuple[float, float, float]


WHEELS = Motion((0.005, 0.15, 0.05), (0.003, 0.05, 0.35))
"""Wheels that skid count turns half as long again."""
INERTIAL = Motion((0.01, 0.05, 0.02), (0.02, 0.04, 0.16))
"""An INS with the noise of shipped robots, rounded to 1 cm and 0.01 rad. Headings are trusted half
as far as that noise would allow: scans of walls tell them better, wherever there are walls."""


class Localiser:
    """Where a robot is. The same calls give the same poses.

    Attributes:
        mode: how. pose: where the robot is now.
        beams: of the last scan that lay on known walls; 0 unless scans are matched.
    """

    def __init__(
        self,
        mode: Mode,
        start: Pose,
        size: tuple[float, float],
        reach: float,
        mount: Pose = (0.0, 0.0, 0.0),
        motion: Motion = WHEELS,
    ) -> None:
        """Args:
        mode: `truth` and `odometry` need no scans. start: where the robot stands at first.
        size: of the world, x and y, m. reach: of the scanner, m; readings from there on hit
            nothing. mount: pose of the scanner on the robot. motion: how good odometry is.
        """
        self.mode, self.pose, self.beams = mode, start, 0
        self._reach, self._mount, self._motion = reach, mount, motion
        self._odometry: Pose | None = None
        self._seen: Pose | None = None  # by odometry, at the last scan
        self._way = self._turn = 0.0  # since the last match
        self._kept: Pose | None = None
        self._walls = PointMap(size)

    @property
    def scanner(self) -> Pose:
        """Where the scanner is now."""
        return compose(self.pose, self._mount)

    def update(
        self,
        odometry: Pose,
        ranges: ArrayLike = (),
        angles: ArrayLike = (),
        robots: Sequence[Disc] = (),
    ) -> Pose:
        """Where the robot is now.

        Args:
            odometry: pose in any frame that keeps still, such as the sensor's own, m and rad from
                x towards y; with `truth` that of the robot itself.
            ranges: (n,) of a scan, m; NaN is ignored. It has to be of the same time as odometry:
                leave out a scan that was told before. Without one odometry goes on.
            angles: (n,) in order, rad; 0 is ahead of the scanner, positive towards y.
            robots: where others are believed to be, and how far around; what is seen there never
                becomes a wall.
        """
        motion = relative(self._odometry or odometry, odometry)
        self._odometry = odometry
        if self.mode == "truth":
            self.pose = odometry
            return self.pose
        self.pose = compose(self.pose, motion)
        beams, turns = np.asarray(ranges, float), np.asarray(angles, float)
        if self.mode == "scan-matching" and len(beams):
            x, y, turn = relative(self._seen or odometry, odometry)
            self._seen = odometry
            self._way += math.hypot(x, y)
            self._turn += abs(turn)
            if turns[0] > turns[-1]:
                beams, turns = beams[::-1], turns[::-1]
            known = self._kept is not None
            if not (known and self._way < _RELY_WAY and self._turn < _RELY_TURN):
                self._look(beams, turns, robots)
        return self.pose

    def _look(self, ranges: Floats, angles: Floats, robots: Sequence[Disc]) -> None:
        points, normals = surfaces(ranges, angles, min(self._reach, _NEAR))
        good: NDArray[np.bool_] = np.logical_and.reduce(np.isfinite(normals), axis=1)
        still = good.copy()  # of what does not move: only that becomes part of the map
        for x, y, radius in robots:
            seen = relative(self.scanner, (x, y, 0.0))
            away = np.hypot(*(points - seen[:2]).T) > radius
            still &= away
            if radius <= _VAGUE:
                good &= away
        lasting = still[good]
        points, normals = points[good], normals[good]
        if self._kept is not None:
            found = match(self._walls, points, normals, self.scanner, self._doubt())
            self.beams = found.beams
            self.pose = compose(found.pose, relative(self._mount, (0.0, 0.0, 0.0)))
            if found.beams >= FEWEST:
                self._way = self._turn = 0.0
            elif self._way < _BLIND:
                return  # what was seen from a doubtful place would spoil the map
            x, y, turn = relative(self._kept, self.pose)
            if math.hypot(x, y) < _KEEP_WAY and abs(turn) < _KEEP_TURN:
                return
        self._kept = self.pose
        x, y, heading = scanner = self.scanner
        cosine, sine = math.cos(heading), math.sin(heading)
        matrix = np.array([[cosine, sine], [-sine, cosine]])
        free = np.where(np.isfinite(ranges), np.clip(ranges, 0.0, _NEAR), 0.0)
        self._walls.forget(scanner, free, angles)
        seen = points @ matrix + (x, y)
        self._walls.add(seen[lasting], (normals @ matrix)[lasting])
        around = np.vstack([seen, (x, y)])
        self._walls.prepare(around.min(axis=0) - _AROUND, around.max(axis=0) + _AROUND)

    def _doubt(self) -> tuple[float, float]:
        """Standard deviation of odometry since the last match: place, m, and heading, rad."""
        place, heading = (
            still + by_way * self._way + by_turn * self._turn
            for still, by_way, by_turn in self._motion
        )
        return place, heading
