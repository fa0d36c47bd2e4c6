"""A robot of a server as the level sees it, where that server is, and names and discs."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.known_map import FELT, SAFE, WALL
from usarsim_exploration.levels.controller import Controller
from usarsim_exploration.levels.driver import Driver
from usarsim_exploration.levels.serving import WorldServer
from usarsim_exploration.levels.swerving import REACH, Swerve
from usarsim_exploration.localisation import Disc, Evidence, Localiser, Pose, compose, relative
from usarsim_exploration.localisation.poses import wrap
from usarsim_exploration.localisation.surfaces import beam_ends

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Body

_CROWD = 1.5
"""m to another robot within which one waits with patience."""
_FEW = 40
"""Beams on known walls: in matches of fewer, one of 300, headings get most of their error."""
_BESIDE = 0.34 * np.array(
    [[math.cos(angle), math.sin(angle)] for angle in np.arange(12) * math.pi / 6]
)
"""Outline of another robot, m around its middle."""
_KNOWN = 0.5
"""m around another robot within which it is, where it told lately where it stands."""
_ROBOTS = 0.08
"""m that what is no wall may come nearer while a robot drives: it may be another one."""
_UNSEEN = 0.03
"""m by which a robot errs about what it only remembers."""
_HALVES = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [0.5, 0.5]])
"""Corners of quarters of a cell."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a server is. control, wireless: ports. own: it was started for this run."""

    host: str = "127.0.0.1"
    control: int = 3000
    wireless: int = 50000
    own: WorldServer | None = None


class Reckoning:
    """Where a robot would be by the motion that it feels alone; the frame keeps still.

    Its INS where it tells one, its wheels between two such readings or if there are none: the
    wheels of a robot that skids, or is held by a wall, turn further than it does. The place that
    an INS tells keeps to the axes of the world, though the heading that it tells drifts; so the
    way between two readings is turned by the heading that the robot believes in.
    """

    def __init__(self) -> None:
        """Nothing is told yet."""
        self._wheels: Pose | None = None
        self._turned: Pose = (0.0, 0.0, 0.0)  # by the wheels alone, corrected for skid
        self._inertial: Pose | None = None
        self._pose: Pose = (0.0, 0.0, 0.0)
        self._then: Pose = (0.0, 0.0, 0.0)  # of the wheels, when `_pose` was

    def update(
        self, wheels: Pose, skid: float, inertial: Pose | None = None, heading: float = 0.0
    ) -> Pose:
        """Where it is now; ask in the order of time.

        Args:
            wheels, inertial: as the sensors tell. skid: how much more its wheels turn it than it
                turns. heading: of the robot at the reading of the INS before this one, rad, as it
                believes.
        """
        x, y, turn = relative(self._wheels or wheels, wheels)
        self._wheels = wheels
        self._turned = compose(self._turned, (x, y, turn / skid))
        if inertial is not None:
            if self._inertial is None:
                self._pose = self._turned
            else:
                x, y, _ = relative((*self._inertial[:2], heading), inertial)
                turn = wrap(inertial[2] - self._inertial[2])
                self._pose = compose(self._pose, (x, y, turn))
            self._inertial, self._then = inertial, self._turned
        return compose(self._pose, relative(self._then, self._turned))


@dataclass(slots=True)
class Rover:
    """A robot in the world.

    Attributes:
        pose, scanned: where it believes to be, and to have been at its newest scan. taken: pose of
            the scan that it took in last. visited: cells of this step. others: where it believes
            the base and other robots to be. reckoning: where it would be by what it feels.
            evidence: of its own scans against walls of its map.
    """

    body: Body
    controller: Controller
    evidence: Evidence
    driver: Driver
    swerve: Swerve
    localiser: Localiser
    pose: Pose
    scanned: Pose
    taken: Pose | None = None
    visited: list[Cell] = field(default_factory=list)
    others: list[Disc] = field(default_factory=list)
    reckoning: Reckoning = field(default_factory=Reckoning)

    @property
    def scanner(self) -> Pose:
        """Where its scanner was at its newest scan."""
        return compose(self.scanned, (self.controller.mount, 0.0, 0.0))

    def steer(self, cell: float) -> tuple[float, float]:
        """m/s and rad/s to the right until the next call. cell: width of one, m."""
        one = self.controller
        mount = compose(relative(self.pose, self.scanned), (one.mount, 0.0, 0.0))
        seen = beam_ends(one.ranges, one.angles, mount)
        crowd = any(math.dist(disc[:2], self.pose[:2]) < _CROWD for disc in self.others)
        matched = self.localiser.mode == "scan-matching"
        vague = matched and self.localiser.beams < _FEW
        speeds = self.driver.steer(self.pose, seen, crowd, vague=vague)
        around = self._around(seen, mount, cell) if any(speeds) else seen[:0]
        return self.swerve.swerve(*speeds, around)

    def _around(self, seen: NDArray[np.float64], mount: Pose, cell: float) -> NDArray[np.float64]:
        """(n, 2) what is near, as the robot sees it: before its scanner by the scan, else as told.

        A cell of a wall counts for four, each by its place next to the robot.
        """
        x, y, heading = self.pose
        cosine, sine = math.cos(heading), math.sin(heading)
        turn, place = np.array([[cosine, sine], [-sine, cosine]]), np.array((x, y))
        bits = self.body.view.known.bits
        low = np.clip(((place - REACH) / cell).astype(np.int64), 0, np.array(bits.shape[::-1]) - 1)
        high = np.maximum(((place + REACH) / cell).astype(np.int64), low) + 1
        part = bits[low[1] : high[1], low[0] : high[0]]
        near = seen[(seen * seen).sum(axis=1) < REACH**2]
        at = np.floor((near @ turn + place) / cell).astype(np.int64) - low
        column, row = np.clip(at, 0, np.array(part.shape[::-1]) - 1).T
        walls = cv2.dilate(part & np.uint8(WALL), np.ones((3, 3), np.uint8)) != 0
        moving = near[~walls[row, column]]
        far = np.hypot(*moving.T)[:, None]
        near[~walls[row, column]] = moving * (1.0 - np.minimum(_ROBOTS / far, 1.0))
        rows, columns = np.nonzero(part & (WALL | SAFE | FELT) == WALL | SAFE)
        corners = (np.column_stack([columns, rows]) + low)[:, None] * cell + _HALVES * cell
        told = [np.clip(place, corners, corners + cell / 2).reshape(-1, 2)]
        told += [disc[:2] + _BESIDE for disc in self.others[1:] if disc[2] < _KNOWN]
        away = (np.vstack(told) - place) @ turn.T
        away *= 1.0 - np.minimum(_UNSEEN / np.maximum(np.hypot(*away.T), 1e-9), 1.0)[:, None]
        away = away[(away * away).sum(axis=1) < REACH**2]
        ahead = (away - mount[:2]) @ (math.cos(mount[2]), math.sin(mount[2]))
        return np.vstack([near, away[ahead < 0.0]])


def wire_name(name: str) -> str:
    """A name as the server takes it."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)[:64]


def disc_cells(radius: float) -> NDArray[np.int64]:
    """(n, 2) cells of a disc around one."""
    reach = int(radius)
    columns, rows = np.meshgrid(range(-reach, reach + 1), range(-reach, reach + 1))
    inside = np.hypot(columns, rows) <= radius
    return np.stack([columns[inside], rows[inside]], axis=1)
