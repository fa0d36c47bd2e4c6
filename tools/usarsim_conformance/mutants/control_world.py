"""A world of boxes on wheels, just true enough for the checks of the control port."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

from usarsim_conformance.mutants.ticks import Ticks

RADIUS, SEPARATION, MASS, MAX_SPEED = 0.1, 0.4, 10.0, 5.0
"""Wheels: m, m; kg; rad/s."""
_REST_Z = -0.2
_GRAVITY = 9.8
_STEP = 0.025
_GIRTH = 0.3
"""m; robots are seen by scanners as round."""
_ON_ITS_BACK = 2.0
_INEXACT = 0.05
"""Of the INS, as a part of every step."""


@dataclass(eq=False)
class MiniBody:
    """A skid steered robot: location and angles in the wire frame, wheels in rad/s."""

    name: str
    location: list[float]
    angles: list[float]
    battery: float = 1200.0
    left: float = 0.0
    right: float = 0.0
    fall: float = 0.0
    age: float = 0.0
    rolled: list[float] = field(default_factory=lambda: [0.0, 0.0])
    reckoned: list[float] = field(default_factory=lambda: [0.0, 0.0, 0.0])
    strayed: list[float] = field(default_factory=lambda: [0.0] * 4)
    """Error of the INS in x, y, z and yaw."""
    _told: tuple[float, ...] = ()
    _chance: random.Random = field(default_factory=lambda: random.Random(1))

    def stray(self) -> None:
        """Let the INS go astray by a part of what was moved since its last report."""
        here = (*self.location, self.angles[2])
        before, self._told = self._told or here, here
        step = math.dist(here[:3], before[:3])
        turn = math.remainder(here[3] - before[3], math.tau)
        for axis, size in enumerate((step, step, step, turn)):
            self.strayed[axis] += size * self._chance.gauss(0.0, _INEXACT)

    @property
    def upright(self) -> bool:
        """Whether it can drive."""
        return abs(math.remainder(self.angles[0], math.tau)) < _ON_ITS_BACK

    @property
    def grounded(self) -> bool:
        """Whether it stands."""
        return self.location[2] >= _REST_Z

    @property
    def dead(self) -> bool:
        """Whether its battery is empty."""
        return self.age >= self.battery

    def advance(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(max(1, round(seconds / _STEP))):
            self._step(_STEP)

    def _step(self, dt: float) -> None:
        self.age += dt
        if not self.grounded:
            self.fall += _GRAVITY * dt
            self.location[2] = min(_REST_Z, self.location[2] + self.fall * dt)
            return
        self.location[2], self.fall = _REST_Z, 0.0
        if not self.upright:
            return
        self.angles[:2] = [0.0, 0.0]
        left, right = (0.0, 0.0) if self.dead else (self.left, self.right)
        speed, turn = RADIUS * (left + right) / 2, RADIUS * (left - right) / SEPARATION
        for pose, heading in ((self.location, self.angles[2]), (self.reckoned, self.reckoned[2])):
            pose[0] += math.cos(heading) * speed * dt
            pose[1] += math.sin(heading) * speed * dt
        self.angles[2] = math.remainder(self.angles[2] + turn * dt, math.tau)
        self.reckoned[2] += turn * dt
        self.rolled = [self.rolled[0] + left * dt, self.rolled[1] + right * dt]


class MiniWorld:
    """Simulated time and the robots in it."""

    def __init__(self, ticks: Ticks) -> None:
        self.ticks = ticks
        self.bodies: list[MiniBody] = []
        self.starts = [
            (
                f"RobotStart{number + 1}",
                (4.0 + 2.0 * (number // 6), 2.0 * (number % 6) - 7.0, -0.25),
            )
            for number in range(36)
        ]

    @property
    def time(self) -> float:
        """Simulated s."""
        return self.ticks.time

    def ranges(self, body: MiniBody, fov: float, count: int, limit: float) -> list[float]:
        """What a scanner sees of other robots, from the right to the left."""
        others = [
            (other.location[0] - body.location[0], other.location[1] - body.location[1])
            for other in self.bodies
            if other is not body
        ]
        near = [place for place in others if math.hypot(*place) < limit]
        start = body.angles[2] + fov / 2
        step = fov / (count - 1)
        return [
            min((_hit(start - index * step, *place) for place in near), default=limit)
            for index in range(count)
        ]


def _hit(angle: float, x: float, y: float) -> float:
    """Distance to a round thing along a ray; far away without a hit."""
    along = math.cos(angle) * x + math.sin(angle) * y
    aside = abs(math.cos(angle) * y - math.sin(angle) * x)
    if along <= 0.0 or aside >= _GIRTH:
        return 20.0
    return min(20.0, along - math.sqrt(_GIRTH**2 - aside**2))
