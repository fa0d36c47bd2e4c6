"""Obstacles that go their way: functions of time, unless they wait for whoever is in front.

`operators_of` gathers those who run all machinery of a world.
"""

from __future__ import annotations

import bisect
import itertools
import math
from dataclasses import dataclass

from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.simulation.machines import Machine, Presence, Zone
from usarsim_server.simulation.movers import Mover
from usarsim_server.worlds.machinery.doors import DoorOperator
from usarsim_server.worlds.machinery.lifts import LiftOperator
from usarsim_server.worlds.machinery.machinery import Drive, Machinery, Obstacle

SOON = 0.05
"""s: how far ahead an obstacle looks to learn where it goes."""
AROUND = 0.02
"""m that it keeps free to its sides."""


@dataclass(frozen=True, slots=True)
class _Leg:
    """From one point to the next: times (s) of leaving, arriving, and being ready to go on."""

    start: Vector
    end: Vector
    leaves: float
    arrives: float
    ready: float
    heading: float
    turn: float


class _Route:
    """The way of an obstacle as a function of the time it has been going."""

    def __init__(self, obstacle: Obstacle) -> None:
        self._once = obstacle.way == "once"
        self._ahead, self._yaw = obstacle.ahead, obstacle.yaw
        legs = list(zip(itertools.pairwise(obstacle.points), obstacle.speeds, strict=False))
        if obstacle.way == "ring":
            legs.append(((obstacle.points[-1], obstacle.points[0]), obstacle.speeds[-1]))
        if obstacle.way == "back and forth":
            legs += [((end, start), speed) for (start, end), speed in reversed(legs)]
        headings = _headings([pair for pair, _ in legs])
        self._legs: list[_Leg] = []
        leaves = 0.0
        for number, ((start, end), speed) in enumerate(legs):
            arrives = leaves + math.dist(start, end) / speed
            ready = arrives + obstacle.pause
            following = headings[(number + 1) % len(legs)]
            turn = math.remainder(following - headings[number], math.tau)
            self._legs.append(_Leg(start, end, leaves, arrives, ready, headings[number], turn))
            leaves = ready
        self._ends = [leg.ready for leg in self._legs]

    def pose(self, going: float) -> Pose:
        """Where it is after it has been going so long (s)."""
        if self._once:
            going = min(going, self._legs[-1].arrives)
        else:
            going %= self._ends[-1]
        leg = self._legs[min(bisect.bisect_right(self._ends, going), len(self._legs) - 1)]
        share = min(1.0, (going - leg.leaves) / (leg.arrives - leg.leaves))
        x, y, z = (a + share * (b - a) for a, b in zip(leg.start, leg.end, strict=True))
        yaw = self._yaw
        if self._ahead:
            rest = leg.ready - leg.arrives
            turned = max(0.0, going - leg.arrives) / rest if rest > 0.0 else 0.0
            yaw = leg.heading + leg.turn * turned
        return Pose((x, y, z), quaternion_from_rpy(0.0, 0.0, yaw))


def _headings(legs: list[tuple[Vector, Vector]]) -> list[float]:
    """Directions of travel; straight up or down: as before."""
    headings: list[float] = []
    for start, end in legs:
        dx, dy = end[0] - start[0], end[1] - start[1]
        level = math.hypot(dx, dy) > 1e-6
        headings.append(math.atan2(dy, dx) if level else (headings or [0.0])[-1])
    return headings


def travelling(obstacle: Obstacle) -> Mover:
    """The mover of an obstacle that waits for nobody."""
    route, delay = _Route(obstacle), obstacle.delay
    return Mover(obstacle.name, lambda time: route.pose(max(0.0, time - delay)))


@dataclass(frozen=True, slots=True)
class _Decision:
    """How long it has been going (s) at a simulated time, and whether it is going since."""

    since: float
    going: float
    moves: bool

    def at(self, time: float) -> float:
        return self.going + (max(0.0, time - self.since) if self.moves else 0.0)


class ObstacleDriver(Machine):
    """Drives an obstacle that waits for whoever is before it; doors open for it."""

    building = False
    _decision: _Decision

    def __init__(self, obstacle: Obstacle) -> None:
        self._route = _Route(obstacle)
        self._size, self._distance = obstacle.size, obstacle.distance
        self._decision = _Decision(obstacle.delay, 0.0, moves=True)
        self.movers = (Mover(obstacle.name, self._pose),)

    def decide(self, time: float, presence: Presence) -> None:
        """Go while the way is free."""
        now = self._decision
        if time < now.since:
            return
        going = now.at(time)
        free = not presence.touching(self._ahead(going))
        if free != now.moves:
            self._decision = _Decision(time, going, free)

    def _pose(self, time: float) -> Pose:
        return self._route.pose(self._decision.at(time))

    def _ahead(self, going: float) -> Zone:
        here, there = self._route.pose(going), self._route.pose(going + SOON)
        ahead = (here.inverse() @ there).position
        length = math.hypot(*ahead)
        dx, dy, dz = (part * self._distance / length if length > 1e-9 else 0.0 for part in ahead)
        x, y, z = (edge / 2.0 for edge in self._size)
        middle = here @ Pose((dx / 2.0, dy / 2.0, z + dz / 2.0))
        # Neither what it carries nor what it goes over, but what is level with it.
        height = max(z - AROUND, z / 2.0)
        half = (x + abs(dx) / 2.0 + AROUND, y + abs(dy) / 2.0 + AROUND, height + abs(dz) / 2.0)
        return Zone(middle, half)


@dataclass(frozen=True, slots=True)
class Operators:
    """Movers that are functions of time alone, and machines that decide."""

    movers: tuple[Mover, ...]
    machines: tuple[Machine, ...]


def operators_of(machinery: Machinery) -> Operators:
    """Fresh operators of all machinery; for `Simulation.set_movers`."""
    doors = [DoorOperator(one) for one in machinery.doors if isinstance(one.mechanism, Drive)]
    waiting = [ObstacleDriver(one) for one in machinery.obstacles if one.distance > 0.0]
    return Operators(
        movers=tuple(travelling(one) for one in machinery.obstacles if one.distance == 0.0),
        machines=(*doors, *map(LiftOperator, machinery.lifts), *waiting),
    )
