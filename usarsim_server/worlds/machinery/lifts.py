"""Platforms that go from stop to stop, by themselves or when somebody wants to go."""

from __future__ import annotations

import bisect
import itertools
import math
from dataclasses import dataclass, replace

from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.simulation.machines import Machine, Presence, Zone
from usarsim_server.simulation.movers import Mover
from usarsim_server.worlds.machinery.courses import Course
from usarsim_server.worlds.machinery.machinery import Lift

HEADROOM = 1.5
"""m above a platform in which something counts as being on it."""
FLOOR = 0.02
"""m below its top that still counts: what stands on it presses itself in a little."""
BOUNDLESS = 50.0
"""m: half a height that nobody exceeds."""
GLANCE = 0.1
"""m that a platform looks ahead beyond its braking distance."""


@dataclass(frozen=True, slots=True)
class _Decision:
    """What an operator has decided."""

    course: Course  # way along the stops, m
    goal: int = 0  # number of the stop that it goes to, or stands at
    step: int = 1  # 1 on the way to the last stop, -1 on the way back
    boarded: float | None = None  # since when (s) somebody has been on it; None: nobody is
    served: bool = False  # who is on it has had the ride, and must get off before there is another


class LiftOperator(Machine):
    """Runs one lift; it begins at the first stop."""

    _decision: _Decision

    def __init__(self, lift: Lift) -> None:
        self._lift = lift
        self._turn = quaternion_from_rpy(0.0, 0.0, lift.yaw)
        legs = itertools.starmap(math.dist, itertools.pairwise(lift.stops))
        self._marks = [0.0, *itertools.accumulate(legs)]
        self._decision = _Decision(Course(0.0, 0.0, 0.0, 0.0, lift.speed, lift.acceleration))
        self._waiting = [self._beside(stop) for stop in lift.stops]
        self.movers = (Mover(lift.name, self._pose),)

    @property
    def stop(self) -> int:
        """Number of the stop that it stands at or goes to, from 0."""
        return self._decision.goal

    def decide(self, time: float, presence: Presence) -> None:
        """Go on, wait, or stop before what is in the way."""
        now = self._decision
        aboard = presence.touching(self._above(now.course.at(time)[0]))
        if not aboard:
            now = replace(now, boarded=None, served=False)
        elif now.boarded is None:
            now = replace(now, boarded=time)
        target = self._marks[now.goal]
        if time < now.course.end or now.course.target != target:
            now = self._travel(time, now, aboard, presence)
        else:
            now = self._attend(time, now, aboard, presence)
        self._decision = now

    # -- deciding ----------------------------------------------------------------------------

    def _travel(
        self, time: float, now: _Decision, aboard: frozenset[int], presence: Presence
    ) -> _Decision:
        """On the way: stop before what is in the way, and go on when it is gone."""
        place, velocity = now.course.at(time)
        target = self._marks[now.goal]
        blocked = bool(presence.touching(self._ahead(place, velocity, target)) - aboard)
        stopping = now.course.target != target
        if blocked == stopping:
            return now
        return replace(now, course=now.course.redirected(time, None if blocked else target))

    def _attend(
        self, time: float, now: _Decision, aboard: frozenset[int], presence: Presence
    ) -> _Decision:
        """At a stop: go where somebody wants to go, or where it is time to go."""
        lift = self._lift
        if aboard - presence.within(self._column(now.course.target)):
            return now  # somebody is coming or going
        if not lift.called:
            return self._depart(time, now) if time - now.course.end >= lift.pause else now
        if aboard:
            waited = now.boarded is not None and time - now.boarded >= lift.pause
            if now.served or not waited:
                return now
            return replace(self._depart(time, now), served=True)
        if presence.touching(self._waiting[now.goal], going=True):
            return now
        for number, zone in enumerate(self._waiting):
            if number != now.goal and presence.touching(zone, going=True):
                return self._go(time, now, number)
        return now

    def _depart(self, time: float, now: _Decision) -> _Decision:
        """To the next stop; at the ends it turns back."""
        step = now.step
        if not 0 <= now.goal + step < len(self._marks):
            step = -step
        return replace(self._go(time, now, now.goal + step), step=step)

    def _go(self, time: float, now: _Decision, goal: int) -> _Decision:
        return replace(now, course=now.course.redirected(time, self._marks[goal]), goal=goal)

    # -- places ------------------------------------------------------------------------------

    def _pose(self, time: float) -> Pose:
        return Pose(self._top(self._decision.course.at(time)[0]), self._turn)

    def _top(self, place: float) -> Vector:
        """Middle of the top when the platform has come so far along its stops (m)."""
        stops, marks = self._lift.stops, self._marks
        leg = min(max(bisect.bisect_right(marks, place) - 1, 0), len(stops) - 2)
        share = (place - marks[leg]) / (marks[leg + 1] - marks[leg])
        x, y, z = (a + share * (b - a) for a, b in zip(stops[leg], stops[leg + 1], strict=True))
        return x, y, z

    def _above(self, place: float) -> Zone:
        """What counts as being on the platform."""
        return self._zone(self._top(place), -FLOOR, HEADROOM, 0.0)

    def _column(self, place: float) -> Zone:
        """All that is above or below the platform."""
        return self._zone(self._top(place), -BOUNDLESS, BOUNDLESS, FLOOR)

    def _beside(self, stop: Vector) -> Zone:
        return self._zone(stop, -FLOOR, HEADROOM, self._lift.reach)

    def _zone(self, top: Vector, low: float, high: float, wider: float) -> Zone:
        length, width, _ = self._lift.size
        x, y, z = top
        half = (length / 2.0 + wider, width / 2.0 + wider, (high - low) / 2.0)
        return Zone(Pose((x, y, z + (high + low) / 2.0), self._turn), half)

    def _ahead(self, place: float, velocity: float, target: float) -> Zone:
        """A box around where the platform is and where it will be before it can stop."""
        way = velocity * velocity / (2.0 * self._lift.acceleration) + GLANCE
        way = math.copysign(min(abs(target - place), way), target - place)
        here, there = Pose(self._top(place), self._turn), Pose(self._top(place + way), self._turn)
        dx, dy, dz = (here.inverse() @ there).position
        length, width, thickness = self._lift.size
        middle = here @ Pose((dx / 2.0, dy / 2.0, dz / 2.0 - thickness / 2.0))
        half = ((length + abs(dx)) / 2.0, (width + abs(dy)) / 2.0, (thickness + abs(dz)) / 2.0)
        return Zone(middle, half)
