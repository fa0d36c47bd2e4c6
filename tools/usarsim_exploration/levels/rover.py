"""A robot of a server as the level sees it, where that server is, and names and discs."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from usarsim_exploration.environment import Cell
from usarsim_exploration.levels.controller import Controller
from usarsim_exploration.levels.driver import Driver
from usarsim_exploration.levels.serving import OwnServer
from usarsim_exploration.localisation import Disc, Localiser, Pose, compose, relative

if TYPE_CHECKING:
    from usarsim_exploration.cycle import Body


@dataclass(frozen=True, slots=True)
class Place:
    """Where a server is. control, wireless: ports. own: it was started for this run."""

    host: str = "127.0.0.1"
    control: int = 3000
    wireless: int = 50000
    own: OwnServer | None = None


@dataclass(slots=True)
class Rover:
    """A robot in the world.

    Attributes:
        pose, scanned: where it believes to be, and to have been at its newest scan. taken: pose of
            the scan that it took in last. visited: cells of this step. others: where it believes
            the base and other robots to be. wheels, turned: newest odometry, as it was told and
            as it should be.
    """

    body: Body
    controller: Controller
    driver: Driver
    localiser: Localiser
    pose: Pose
    scanned: Pose
    taken: Pose | None = None
    visited: list[Cell] = field(default_factory=list)
    others: list[Disc] = field(default_factory=list)
    wheels: Pose | None = None
    turned: Pose = (0.0, 0.0, 0.0)

    def calibrated(self, wheels: Pose, skid: float) -> Pose:
        """What odometry would tell of a robot that does not skid; ask in the order of time."""
        x, y, turn = relative(self.wheels or wheels, wheels)
        self.wheels = wheels
        self.turned = compose(self.turned, (x, y, turn / skid))
        return self.turned


def wire_name(name: str) -> str:
    """A name as the server takes it."""
    return re.sub(r"\W", "_", name, flags=re.ASCII)[:64]


def disc_cells(radius: float) -> NDArray[np.int64]:
    """(n, 2) cells of a disc around one."""
    reach = int(radius)
    columns, rows = np.meshgrid(range(-reach, reach + 1), range(-reach, reach + 1))
    inside = np.hypot(columns, rows) <= radius
    return np.stack([columns[inside], rows[inside]], axis=1)
