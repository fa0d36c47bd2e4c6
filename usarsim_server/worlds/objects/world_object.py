"""One object of a world controller, the wish for one, and the path it goes, as plain values.

Way points, rotation and falling are pure functions of simulated time. A path is a value. It begins
where the object is when its first way point is added, leads through the way points in order, and in
a loop from the last one back to the first way point. Whatever is changed on the way is changed from
the present place on.
"""

from __future__ import annotations

import bisect
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import Any, TypedDict, Unpack

import numpy as np

from usarsim_server.base.errors import SpawnError
from usarsim_server.simulation.frames import (
    Pose,
    Quaternion,
    Vector,
    flip_quaternion,
    quaternion_from_rpy,
    rpy_from_quaternion,
)
from usarsim_server.simulation.movers import Way
from usarsim_server.simulation.rays.query import RayFan
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.worlds.objects.bodies import Material, ObjectClass, object_size

GRAVITY = 9.81
"""m/s^2."""


class PathChange(TypedDict, total=False):
    """Attributes of a `Path` to be changed; None: as before."""

    speed: float | None
    loop: bool | None
    moving: bool | None
    reset_on_clear: bool | None
    clock: float | None
    """s of travel since the start; sets the progress (protocol reference 3.14, Time)."""


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

    def changed(self, time: float, **wanted: Unpack[PathChange]) -> Path:
        """The path with other parameters from a simulated time (s) on."""
        clock = wanted.pop("clock", None)
        given: dict[str, Any] = {key: value for key, value in wanted.items() if value is not None}
        now = replace(self._from(time), **given)
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
    """Pose of an object at a simulated time (s), from where it was put last.

    A path leads where it leads.
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


class Physics(Enum):
    """What becomes of an object where it was put (protocol reference 3.14)."""

    NONE = "none"
    """It stays there, in the air too."""
    RIGID = "rigidbody"
    """Forces move it."""
    FALLING = "falling"
    """It falls straight down until something is below, and stays there."""
    GROUND = "ground"
    """It is set down at once on whatever is below, and stays there."""


@dataclass(frozen=True, slots=True)
class Creation:
    """A wish for an object.

    Attributes:
        class_name: of the catalogue. name: None for any.
        pose: of its middle.
        scale: factors along its axes.
        physics, material, memory, permanent: see `WorldObject`.
    """

    class_name: str
    name: str | None
    pose: Pose
    scale: Vector = (1.0, 1.0, 1.0)
    physics: Physics = Physics.NONE
    material: str | None = None
    memory: str = ""
    permanent: bool = False


@dataclass(frozen=True, slots=True)
class WorldObject:
    """One object.

    Attributes:
        name: unique among the objects of the world, whatever the case.
        kind: its class. scale: factors along its axes. material: None for the looks of the class.
        physics: see there.
        memory: text that clients keep with it.
        permanent: spared when all objects are removed.
        owner: whoever created it.
        body: its number in the simulation.
        pose: where it was put last, or where its present motion began.
        path, spin, fall: how it moves from there.
        placed: it has a body that forces do not move at present.
    """

    name: str
    kind: ObjectClass
    scale: Vector
    material: Material | None
    physics: Physics
    memory: str
    permanent: bool
    owner: object
    body: int
    pose: Pose
    path: Path = Path()
    spin: Spin | None = None
    fall: Fall | None = None
    placed: bool = True

    @property
    def size(self) -> Vector:
        """Extents along its axes, m."""
        return object_size(self.kind, self.scale)

    @property
    def moves(self) -> bool:
        """Whether it goes its own way."""
        return bool(self.path.points) or self.spin is not None or self.fall is not None

    def way(self) -> Way:
        """Its pose as a function of simulated time."""
        pose, path, spin, fall = self.pose, self.path, self.spin, self.fall
        return lambda time: motion(pose, path, spin, fall, time)


GRID = 7
"""Rays along each side of an object's outline."""
INSET = 1e-3
"""m by which the outermost rays are inside, so that they pass what the object only touches."""
FARTHEST = 1000.0


def drop_below(simulation: Simulation, pose: Pose, size: Vector, body: int | None = None) -> float:
    """How far (m) an object can be lowered until something is below; negative: it has to rise.

    It counts as its bounding box about the middle `pose`, and only what is below its middle counts.
    `body` is its number if it is in the world already.

    Raises:
        SpawnError: if there is nothing below.
    """
    half = np.abs(pose.matrix()) @ (np.array(size) / 2.0)
    x, y = (np.linspace(-1.0, 1.0, GRID) * max(0.0, extent - INSET) for extent in half[:2])
    across, along = np.meshgrid(x, y)
    offsets = np.column_stack([across.ravel(), along.ravel(), np.zeros(GRID * GRID)])
    fan = RayFan(
        np.array(pose.position) + offsets, np.tile([0.0, 0.0, -1.0], (len(offsets), 1)), FARTHEST
    )
    hits = simulation.cast([fan], simulation.look(), body)[0]
    nearest = float(hits.distances.min())
    if not math.isfinite(nearest):
        raise SpawnError("there is nothing below")
    return nearest - float(half[2])
