"""Doors that open by themselves: whom they notice, and what they do when somebody is in the way."""

from __future__ import annotations

import math
from dataclasses import dataclass

from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.machines import Machine, Presence, Zone
from usarsim_server.simulation.movers import Mover, Way
from usarsim_server.worlds.machinery.bodies import Leaf, leaves_of
from usarsim_server.worlds.machinery.courses import Course
from usarsim_server.worlds.machinery.machinery import Door, Drive

BESIDE = 0.3
"""m by which the watched ground is wider than the doorway, on both sides."""
CLEARANCE = 0.03
"""m that a leaf keeps from what is in its way."""
CAUTION = math.radians(10.0)
"""rad: how far beyond its braking distance a hinged leaf looks ahead."""
PART = math.radians(8.0)
"""rad between the poses of a hinged leaf that are looked at ahead."""
GLANCE = 0.05
"""m that a leaf looks ahead beyond its braking distance while it slides open."""


@dataclass(frozen=True, slots=True)
class _Decision:
    """What an operator has decided: how far the door is open, and until when (s) it will stay."""

    course: Course
    until: float = -math.inf


class DoorOperator(Machine):
    """Opens and closes one door, which has a drive; it begins closed."""

    _decision: _Decision

    def __init__(self, door: Door) -> None:
        assert isinstance(door.mechanism, Drive)
        self._drive = drive = door.mechanism
        # Hinged leaves turn toward x for a positive travel; openings are positive here.
        self._turn = math.copysign(1.0, door.travel)
        self._travel = abs(door.travel)
        self._leaves = leaves_of(door)
        self._decision = _Decision(Course(0.0, 0.0, 0.0, 0.0, drive.speed, drive.acceleration))
        half = (drive.reach + door.thickness / 2.0, door.width / 2.0 + BESIDE, door.height / 2.0)
        self._ground = Zone(door.pose @ Pose((0.0, 0.0, half[2])), half)
        self.movers = tuple(Mover(leaf.body, self._way(leaf)) for leaf in self._leaves)

    @property
    def opening(self) -> float:
        """How far it is open at last, when all that has been decided is done: m or rad."""
        return self._decision.course.target

    def decide(self, time: float, presence: Presence) -> None:
        """Open for whoever comes, close when it is time, give way to whoever is between."""
        place, velocity = self._decision.course.at(time)
        until = self._decision.until
        if self._wanted(time, presence):
            until = time if self._drive.timetable else time + self._drive.hold
        goal = self._travel if time <= until else 0.0
        if goal < place and self._blocked(place, velocity, goal, presence):
            goal, until = self._travel, time + self._drive.hold
        held = goal > place and self._blocked(place, velocity, goal, presence)
        self._decision = _Decision(self._course(time, None if held else goal), until)

    def _course(self, time: float, goal: float | None) -> Course:
        """How to go on from now; None: stop."""
        course = self._decision.course
        if goal == course.target or (goal is None and time >= course.end):
            return course
        return course.redirected(time, goal)

    def _way(self, leaf: Leaf) -> Way:
        return lambda time: leaf.at(self._turn * self._decision.course.at(time)[0])

    def _wanted(self, time: float, presence: Presence) -> bool:
        timetable = self._drive.timetable
        if timetable is not None:
            return timetable.holds(time)
        return bool(presence.touching(self._ground, going=True))

    def _blocked(self, place: float, velocity: float, goal: float, presence: Presence) -> bool:
        return any(
            presence.touching(zone)
            for leaf in self._leaves
            for zone in self._ahead(leaf, place, velocity, goal)
        )

    def _ahead(self, leaf: Leaf, place: float, velocity: float, goal: float) -> list[Zone]:
        """Where a leaf will be before it can stop; a leaf that slides shut: all the way."""
        sign = 1.0 if goal > place else -1.0
        braking = velocity * velocity / (2.0 * self._drive.acceleration)
        half_x, half_y, half_z = leaf.half
        if leaf.sliding:
            way = abs(goal - place)
            if goal > 0.0:
                way = min(way, braking + GLANCE)
            pose = leaf.at(place + sign * way / 2.0) @ Pose(leaf.middle)
            return [Zone(pose, (half_x + CLEARANCE, half_y + way / 2.0, half_z))]
        way = min(abs(goal - place), braking + CAUTION)
        count = max(1, math.ceil(way / PART))
        return [
            Zone(
                leaf.at(self._turn * (place + sign * way * number / count)) @ Pose(leaf.middle),
                (half_x + CLEARANCE, half_y, half_z),
            )
            for number in range(1, count + 1)
        ]
