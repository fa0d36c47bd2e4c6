"""What only robots of a server have: maps that are askew, wheels that slip, others in the way.

Runs on the grid have none of these measures; there cells are exact.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Literal

from usarsim_exploration.environment import Environment
from usarsim_exploration.history import History
from usarsim_exploration.localisation.poses import Pose, compose, relative
from usarsim_exploration.measures.base import OURS, declare
from usarsim_exploration.measures.map_error import map_error
from usarsim_exploration.strategy import View

BALAGUER = (
    "B. Balaguer, S. Balakirsky, S. Carpin, A. Visser, Evaluating maps produced by urban search "
    "and rescue robots, Autonomous Robots 27 (2009)"
)

NEAR = 1.0
"""m between the middles of two robots that are in each other's way."""


def of_map(base: View, world: Environment) -> dict[str, float | None]:
    """The measures of the base's map, for `History.reality`. world: true."""
    found = map_error(base.known.bits, world, base.base)
    return {
        "map_error": found.error,
        "walls_mapped": 100 * found.mapped,
        "aligned_iou": found.overlap,
        "map_shift": found.shift,
    }


def _told(history: History, name: str) -> float | None:
    return history.reality.get(name)


def _declare(
    name: str, title: str, unit: str, text: str, source: str = OURS,
    better: Literal["more", "less", ""] = "less",
) -> None:  # fmt: skip
    declare(name, title, unit, text, source, better, real=True)(partial(_told, name=name))


_declare(
    "map_error", "Map error", "m",
    "Mean distance of the wall cells that the base's map has as measured to the nearest surface of "
    "a true wall, after the turn and shift of the whole map that make it least; none without such "
    "a cell.", BALAGUER,
)  # fmt: skip
_declare(
    "walls_mapped", "Walls mapped", "%",
    "How many of the wall cells beside reachable free cells the base's map has as measured within "
    "one cell, after the same turn and shift.", BALAGUER, "more",
)  # fmt: skip
_declare(
    "aligned_iou", "Overlap of the aligned map with the world", "1",
    "Reachable free cells that the base takes for free after the same turn and shift, by cells "
    "that are free and reachable or that it takes for free.", OURS, "more",
)  # fmt: skip
_declare(
    "map_shift", "Shift of the map", "m",
    "How far the same turn and shift move the middle of the measured walls.",
)  # fmt: skip
_declare(
    "position_error", "Error of position", "m",
    "Mean over robots and steps of the distance between where a robot was and where it believed "
    "to be.",
)  # fmt: skip
_declare(
    "odometry_drift", "Drift of odometry", "%",
    "Mean over robots of the distance between where a robot was at the end and where its odometry "
    "alone had it, by the way that it drove.",
)  # fmt: skip
_declare(
    "slip", "Slip", "%",
    "How much of the way that wheels turned robots did not come: 1 minus the way driven by the way "
    "of the wheels, of all robots together.",
)  # fmt: skip
_declare(
    "stuck_s", "Stuck", "s",
    "Simulated time in which robots were told to drive and did not move, of all robots together.",
)  # fmt: skip
_declare(
    "recoveries", "Recoveries", "1",
    "How often a robot that was stuck drove another way to get free, of all robots together.",
)  # fmt: skip
_declare(
    "near_others", "Near others", "robot s",
    "Simulated time in which a robot had another one within 1 m, of all robots together.",
)  # fmt: skip
_declare(
    "hit_walls", "Collisions with walls", "1",
    "How often a robot came to touch a wall, its bumpers within 1 cm of it, and had been at least "
    "4 cm away since the last time; by where robots truly were at each tick, of all together.",
)  # fmt: skip
_declare(
    "hit_robots", "Collisions of robots", "1",
    "How often two robots came to touch each other, likewise.",
)  # fmt: skip


@dataclass
class _Way:
    """Of one robot: where it was last, by truth and by odometry, and m driven by both."""

    start: Pose
    truth: Pose
    wheels: Pose
    driven: float = 0.0
    rolled: float = 0.0


class Ways:
    """Follows robots of a server, for the measures of what only physics has."""

    def __init__(self) -> None:
        self._ways: dict[int, _Way] = {}
        self._errors = self._seconds = self._near = 0.0

    def note(self, poses: Mapping[int, tuple[Pose, Pose, Pose]], seconds: float) -> None:
        """Tell where robots are, at every tick.

        Args:
            poses: by number of a robot: the true one and what it believes, in the frame of the
                environment, and that of odometry, in its own frame.
            seconds: simulated time since the last tick.
        """
        for robot, (truth, believed, wheels) in poses.items():
            start = compose(truth, relative(wheels, (0.0, 0.0, 0.0)))
            way = self._ways.setdefault(robot, _Way(start, truth, wheels))
            way.driven += math.dist(way.truth[:2], truth[:2])
            way.rolled += math.dist(way.wheels[:2], wheels[:2])
            way.truth, way.wheels = truth, wheels
            self._errors += seconds * math.dist(truth[:2], believed[:2])
            self._seconds += seconds
            others = (other for number, (other, _, _) in poses.items() if number != robot)
            if any(math.dist(other[:2], truth[:2]) < NEAR for other in others):
                self._near += seconds

    def facts(self) -> dict[str, float | None]:
        """The measures, for `History.reality`."""
        drifts = [
            100 * math.dist(way.truth[:2], compose(way.start, way.wheels)[:2]) / way.driven
            for way in self._ways.values()
            if way.driven
        ]
        driven, rolled = (
            sum(getattr(way, name) for way in self._ways.values()) for name in ("driven", "rolled")
        )
        return {
            "position_error": self._errors / self._seconds if self._seconds else None,
            "odometry_drift": sum(drifts) / len(drifts) if drifts else None,
            "slip": 100 * (1 - driven / rolled) if rolled else None,
            "near_others": self._near,
        }
