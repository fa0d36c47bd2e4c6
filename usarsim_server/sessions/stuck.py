"""Whether a robot that is told to move does not: one rule for the log and for the console."""

from __future__ import annotations

import math

from usarsim_server.simulation.frames import Pose

LEAST_SPEED = 0.05
"""m/s that a robot is told to go at least; below, its way within `PATIENCE` says little."""
LEAST_WAY, LEAST_TURN = 0.02, 0.05
"""m and rad within `PATIENCE` that count as a motion."""
PATIENCE = 3.0
"""Simulated s without a motion after which a robot counts as stuck."""
PAUSE = 60.0
"""Simulated s between two log lines about one robot."""


class StuckWatch:
    """Watches one robot.

    Attributes:
        stuck: it is told to move and has neither moved nor turned for `PATIENCE`.
    """

    def __init__(self) -> None:
        self.stuck = False
        self._from: tuple[Pose, float] | None = None
        self._told = -math.inf

    def see(self, speed: float, pose: Pose, time: float) -> bool:
        """Take note of a moment; returns whether it is time to tell that the robot is stuck.

        Args:
            speed: m/s that it is told to go, see `DriveController.wanted_speed`.
            pose: of its reference point.
            time: simulated s.
        """
        if speed < LEAST_SPEED:
            self._from, self.stuck = None, False
            return False
        if self._from is None or _has_moved(self._from[0], pose):
            self._from, self.stuck = (pose, time), False
            return False
        self.stuck = time - self._from[1] >= PATIENCE
        if not self.stuck or time - self._told < PAUSE:
            return False
        self._told = time
        return True


def _dot(one: Pose, other: Pose) -> float:
    return sum(a * b for a, b in zip(one.quaternion, other.quaternion, strict=True))


def _has_moved(one: Pose, other: Pose) -> bool:
    turn = 2.0 * math.acos(min(1.0, abs(_dot(one, other))))
    return math.dist(one.position, other.position) >= LEAST_WAY or turn >= LEAST_TURN
