"""Drives one robot along a route: pure pursuit, a look at the laser before each command, recovery.

Knows no socket and no server: poses and scans come in, speeds go out (R. C. Coulter,
"Implementation of the pure pursuit path tracking algorithm", CMU-RI-TR-92-01).
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from usarsim_exploration.localisation.poses import Pose, wrap
from usarsim_exploration.localisation.surfaces import Floats

LENGTH, WIDTH = 0.32, 0.31
"""Half the length and width of a robot with some room, m."""
_LOOKAHEAD = 0.45
"""m on the route to where a robot heads."""
SHARP = 0.7
"""rad beside the heading beyond which it turns on the spot."""
FACING = 0.35
"""rad beside the goal within which a robot that has arrived sees what it came for."""
_NEAR = 0.12
"""m from the end of the route that count as there."""
_SHORT = 0.4
"""m from its end within which a wall ahead ends the route."""
_AFRESH = 1.0
"""m from where a robot backed off first, beyond which it is no longer at the same obstacle."""
_TURN, _VAGUE = 2.0, 0.7
"""rad/s at most, and where few walls tell how far it has turned."""
_BACK, _ARC = 0.2, 0.4
"""m/s and rad/s of a robot that backs off."""
_SPACE = 0.1
"""m ahead that are worth going ahead for, where going back did not help."""
_PATIENCE = 2.0
"""s without any progress after which a robot backs off."""
_TRIES = 3
"""Of backing off on one way, after which it is blocked."""


class Driver:
    """One robot's wheels.

    Attributes:
        top: m/s at most.
        arrived: it is at the end of its way, and looks ahead. blocked: it gets no further.
        stuck: s that it has made no progress though it should, so far. recoveries: times that it
            has backed off.
    """

    def __init__(self, number: int, top: float, period: float) -> None:
        """number: of the robot. top: m/s. period: s between two commands."""
        self._number, self.top, self._period = number, top, period
        self._route: list[tuple[float, float]] = []
        self._facing = 0.0
        self._ends = self._idle = True
        self._past: deque[Pose] = deque(maxlen=max(2, round(_PATIENCE / period)))
        self._retreat = self._waited = self._beside = 0.0
        self._tries, self._began = 0, (0.0, 0.0)
        self._ahead = False
        self.arrived = True
        self.blocked = False
        self.stuck = 0.0
        self.recoveries = 0

    def limit(self, top: float) -> None:
        """The robot is no faster than that, m/s."""
        self.top = min(self.top, top)

    def follow(self, route: list[tuple[float, float]], facing: float, *, ends: bool) -> None:
        """Take a new route, m; facing: rad at its end; ends: it leads to where the robot shall."""
        self._route, self._facing, self._ends = route, facing, ends
        self._idle = self.arrived = self.blocked = False
        self._waited = self._waited if not route and not ends else 0.0

    def rest(self) -> None:
        """There is nowhere to go."""
        self._route, self._idle, self._tries = [], True, 0
        self.arrived, self.blocked = True, False

    def steer(
        self, pose: Pose, points: Floats, crowd: bool, *, vague: bool = False
    ) -> tuple[float, float]:
        """What to do until the next call.

        Args:
            pose: now. points: (n, 2) what the laser sees, m ahead of the robot and to its right.
            crowd: another robot is near, so who waits is not stuck at once.
            vague: few walls tell where it is, so that scans have to overlap.

        Returns:
            m/s ahead, and rad/s to the right.
        """
        speed, turn = self._steer(pose, points, crowd)
        slower = _VAGUE / abs(turn) if vague and abs(turn) > _VAGUE else 1.0
        return slower * speed, slower * turn

    def _steer(self, pose: Pose, points: Floats, crowd: bool) -> tuple[float, float]:
        if self._retreat > 0.0:
            self._retreat -= self._period
            self._past.clear()
            speed = min(_BACK, _room(points)) if self._ahead else -_BACK
            return speed, math.copysign(_ARC, self._beside)
        speed, turn = self._pursue(pose, points)
        if self._idle or self.arrived:
            self._past.clear()
            return speed, turn
        self._past.append(pose)
        first = self._past[0]
        away = math.dist(pose[:2], first[:2])
        turned = abs(wrap(pose[2] - first[2]))
        if away < 0.04 and turned < 0.1 and len(self._past) > 2:
            self.stuck += self._period
            waited = len(self._past) == self._past.maxlen
            if waited and (not crowd or self.stuck % (2.0 * (1 + 1 / self._number)) < self._period):
                self._back_off(pose, _room(points))
        if self._tries and math.dist(self._began, pose[:2]) > _AFRESH:
            self._tries = 0
        return speed, turn

    def _back_off(self, pose: Pose, room: float) -> None:
        """Back, and at each second try ahead, if there is room: as cars turn in narrow places."""
        if not self._tries:
            self._began = pose[:2]
        self._tries += 1
        self._ahead = self._tries % 2 == 0 and room > _SPACE
        self.recoveries += 1
        self._retreat = 1.2 + 0.4 * (self._tries - 1)
        self.blocked = self.blocked or self._tries > _TRIES
        if self._tries > _TRIES:
            self._tries = 0

    def _pursue(self, pose: Pose, points: Floats) -> tuple[float, float]:
        if self._idle:
            return 0.0, 0.0
        while self._route and math.dist(self._route[0], pose[:2]) < _LOOKAHEAD:
            if len(self._route) == 1:
                break
            self._route.pop(0)
        if self._route:
            x, y = self._route[0]
            left = math.hypot(x - pose[0], y - pose[1])
            if len(self._route) == 1 and left < _NEAR:
                self._route = []
            else:
                return self._towards(pose, math.atan2(y - pose[1], x - pose[0]), left, points)
        if not self._ends:  # somebody is in the way, or something that is on no map
            self._waited += self._period
            self.blocked = self.blocked or self._waited > _PATIENCE
            return 0.0, 0.0
        beside = self._beside = wrap(self._facing - pose[2])
        if abs(beside) > FACING:
            return 0.0, float(np.clip(2.0 * beside, -_TURN, _TURN))
        self.arrived = True
        return 0.0, 0.0

    def _towards(
        self, pose: Pose, direction: float, left: float, points: Floats
    ) -> tuple[float, float]:
        beside = self._beside = wrap(direction - pose[2])
        turn = float(np.clip(2.2 * beside, -_TURN, _TURN))
        if abs(beside) > SHARP:
            return 0.0, turn
        last = len(self._route) == 1
        speed = self.top * math.cos(beside) ** 2
        if last:
            speed = min(speed, max(0.1, 1.2 * left))
        allowed = _room(points) / 0.6
        if last and left < _SHORT and allowed < 0.05:
            self._route = []  # it gets no nearer
        return min(speed, allowed), turn


def _room(points: Floats) -> float:
    """m straight ahead of the bumper until something is in the way."""
    ahead = points[(points[:, 0] > 0.0) & (np.abs(points[:, 1]) < WIDTH), 0]
    return max(float(ahead.min()) - LENGTH, 0.0) if len(ahead) else math.inf
