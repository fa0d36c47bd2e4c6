"""How objects go their way: way points, rotation, falling, as pure functions of simulated time.

A path is a value. It begins where the object is when its first way point is added, leads through
the way points in order, and in a loop from the last one back to the first way point. Whatever is
changed on the way is changed from the present place on.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from usarsim_server.simulation.frames import (
    Pose,
    Vector,
    flip_quaternion,
    quaternion_from_rpy,
    rpy_from_quaternion,
)

Quaternion = tuple[float, float, float, float]


GRAVITY = 9.81
"""m/s^2."""


@dataclass(frozen=True)
class Path:
    """Way points and how far an object has come."""

    speed: float = 1.0  # m/s
    loop: bool = False  # go round for ever
    moving: bool = True  # false: it stands where it is
    reset_on_clear: bool = False  # the object returns `home` when the way points are cleared
    home: Vector | None = None
    """Where it was when it got its first way point, m; None without way points."""
    start: Vector | None = None  # where the path begins, m; None without way points
    points: tuple[Vector, ...] = ()  # way points, m
    done: float = 0.0  # way along the path (m) at the moment `since`
    since: float = 0.0  # simulated time (s)

    def travelled(self, time: float) -> float:
        """Way along the path (m) at a simulated time; a loop goes on growing."""
        way = self.done
        if self.moving and self.points:
            way += self.speed * max(0.0, time - self.since)
        return way if self.loop or not self.points else min(way, self.length)

    def position(self, time: float) -> Vector | None:
        """Where the object is at a simulated time; None without way points."""
        if self.start is None or not self.points:
            return None
        corners, marks = self._route
        way = self.travelled(time)
        if self.loop:
            way = self._within_lap(way)
        leg = min(bisect.bisect_right(marks, way), len(marks) - 1)
        before = marks[leg - 1] if leg else 0.0
        span = marks[leg] - before
        share = min(1.0, max(0.0, (way - before) / span)) if span > 0.0 else 1.0
        return _between(corners[leg], corners[leg + 1], share)

    @property
    def length(self) -> float:
        """m from the start to the last way point, not round."""
        corners = (self.start or (0.0, 0.0, 0.0), *self.points)
        return sum(itertools.starmap(math.dist, itertools.pairwise(corners)))

    def changed(
        self,
        time: float,
        *,
        speed: float | None = None,
        loop: bool | None = None,
        moving: bool | None = None,
        reset_on_clear: bool | None = None,
        clock: float | None = None,
    ) -> Path:
        """The path with other parameters from a simulated time on.

        Args:
            time: now, s.
            speed, loop, moving, reset_on_clear: as the attributes; None: as before.
            clock: s of travel since the start; sets the progress (protocol reference 3.14, Time).
        """
        now = self._from(time)
        now = replace(
            now,
            speed=self.speed if speed is None else speed,
            loop=self.loop if loop is None else loop,
            moving=self.moving if moving is None else moving,
            reset_on_clear=self.reset_on_clear if reset_on_clear is None else reset_on_clear,
        )
        if clock is None:
            return now
        return replace(now, start=self.home, done=max(0.0, clock) * now.speed)

    def extended(self, time: float, here: Vector, points: Sequence[Vector]) -> Path:
        """The path with more way points; it begins here if it had none."""
        if not self.points:
            return replace(self, home=here, start=here, points=tuple(points), since=time)
        now = self._from(time)
        return replace(now, points=(*now.points, *points))

    def moved(self, time: float, place: Vector) -> Path:
        """The path as it goes on if the object is put somewhere else: to its next way point."""
        if not self.points:
            return self
        now = self._from(time)
        ahead = bisect.bisect_right(now._route[1], now.done)
        if ahead < len(self.points):
            points = (*self.points[ahead:], *(self.points[:ahead] if self.loop else ()))
        else:  # nothing is ahead any more
            points = (place,)
        return replace(now, home=place, start=place, points=points, done=0.0)

    def cleared(self) -> Path:
        """The path without way points; the other parameters stay."""
        return replace(self, home=None, start=None, points=(), done=0.0)

    def _from(self, time: float) -> Path:
        """The same path told from a moment on, and in a loop without the laps that are over.

        On its way back from the last way point to the first it begins where the object is.
        """
        done = self.travelled(time)
        if not (self.loop and self.points):
            return replace(self, done=done, since=time)
        done = self._within_lap(done)
        if done < self._route[1][len(self.points) - 1]:
            return replace(self, done=done, since=time)
        return replace(self, start=self.position(time), done=0.0, since=time)

    def _within_lap(self, way: float) -> float:
        marks = self._route[1]
        around = marks[-1] - marks[0]
        if way <= marks[0]:
            return way
        return marks[0] + (math.fmod(way - marks[0], around) if around > 0.0 else 0.0)

    @cached_property
    def _route(self) -> tuple[tuple[Vector, ...], list[float]]:
        """Corners from the start on, round to the first way point in a loop; way to each (m)."""
        assert self.start is not None
        corners = (self.start, *self.points, *(self.points[:1] if self.loop else ()))
        legs = itertools.starmap(math.dist, itertools.pairwise(corners))
        return corners, list(itertools.accumulate(legs))


@dataclass(frozen=True)
class Spin:
    """Rotation at constant rates of roll, pitch and yaw."""

    rates: Vector  # rad/s, wire frame
    angles: Vector  # roll, pitch, yaw (rad, wire frame) at the moment `since`
    since: float  # simulated time, s

    @staticmethod
    def begin(rates: Vector, orientation: Quaternion, time: float) -> Spin:
        """Rotation from an orientation (simulation frame) on."""
        return Spin(rates, rpy_from_quaternion(flip_quaternion(orientation)), time)

    def orientation(self, time: float) -> Quaternion:
        """Orientation in the simulation frame at a simulated time."""
        passed = max(0.0, time - self.since)
        angles = (a + rate * passed for a, rate in zip(self.angles, self.rates, strict=True))
        return flip_quaternion(quaternion_from_rpy(*angles))


@dataclass(frozen=True)
class Fall:
    """Falling straight down until something is below."""

    drop: float  # how far, m
    since: float  # simulated time of letting go, s

    def fallen(self, time: float) -> float:
        """m at a simulated time."""
        passed = max(0.0, time - self.since)
        return min(self.drop, 0.5 * GRAVITY * passed * passed)


def motion(pose: Pose, path: Path, spin: Spin | None, fall: Fall | None, time: float) -> Pose:
    """Pose of an object at a simulated time.

    Args:
        pose: where it was put last.
        path, spin, fall: how it moves from there; a path leads where it leads.
        time: s.
    """
    x, y, z = pose.position
    if fall is not None:
        z -= fall.fallen(time)
    place = path.position(time) or (x, y, z)
    return Pose(place, pose.quaternion if spin is None else spin.orientation(time))


def _between(one: Vector, other: Vector, share: float) -> Vector:
    if share >= 1.0:
        return other
    x, y, z = (a + share * (b - a) for a, b in zip(one, other, strict=True))
    return x, y, z
