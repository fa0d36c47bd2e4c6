"""How many obstacles a line between two stations meets.

Obstacles are counted by the rule of the original (side channels reference 3.3): only the part of
the world that never moves counts. Robots, victims and everything movable let a signal pass, as they
did in the original, which counted brushes, static meshes and blocking volumes.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from usarsim_server.protocol.values import Vector
from usarsim_server.simulation.frames import Array
from usarsim_server.simulation.rays.query import SceneryHit
from usarsim_server.worlds.victims import part_of

STRIDE = 0.20
"""m behind a hit where the search goes on, and beyond which the same object is an obstacle again:
50 units of the original, of which 250 are a metre."""

SLIVER = 0.001
"""m behind the skin of a victim where the search goes on: it shall not hide the wall behind it,
whether or not the world lets it move."""

MOST = 1000
"""Surfaces looked at on one line. A signal is lost long before; bounds the work."""

FAR = 10_000.0
"""m: what lies further out along any axis is not looked at. Rays are cast in single precision,
which resolves a millimetre there."""


class SceneryTracer(Protocol):
    """The part of a simulation that is needed here."""

    def first_sceneries(
        self, origins: Array, directions: Array, reaches: Array
    ) -> Sequence[SceneryHit | None]:
        """What rays (n, 3) meet first of what never moves, within reach (n,), m; None: nothing."""


class SceneryObstacles:
    """Counts static geometry between two points; may be used by any thread."""

    def __init__(self, world: SceneryTracer) -> None:
        """Know the world; in general a `Simulation`."""
        self._world = world

    def count(self, start: Vector, end: Vector) -> int:
        """Obstacles between two points (simulation frame, m).

        A surface is a new obstacle if it belongs to another object than the one before, or lies
        more than 0.20 m beyond the point from where the search went on, which is 0.20 m behind
        the surface before. Where a line leaves the object that it has just entered there is no
        second obstacle, however thick the object is: the original's traces do not see surfaces
        from within. Surfaces at the very start and at the very end count.

        Coordinates that are not finite give 0.
        """
        return self.counts(start, [end])[0]

    def counts(self, start: Vector, ends: Sequence[Vector]) -> list[int]:
        """Obstacles between a point and each of others, see `count`.

        All lines are followed together, surface by surface: fifteen cost hardly more than one.
        """
        lines = [_Line(*_clip(start, end)) for end in ends]
        followed = [line for line in lines if line.length > 0.0]
        for _ in range(MOST):
            if not followed:
                break
            rays = np.array([line.rest() for line in followed])
            hits = self._world.first_sceneries(rays[:, :3], rays[:, 3:6], rays[:, 6])
            followed = [
                line for line, hit in zip(followed, hits, strict=True) if hit and line.meet(hit)
            ]
        return [line.found for line in lines]


class _Line:
    """A line that is followed from one surface to the next."""

    __slots__ = ("_last", "_passed", "_start", "_way", "found", "length")

    def __init__(self, start: Vector, end: Vector) -> None:
        """Begin at its start."""
        (x, y, z), (u, v, w) = start, end
        u, v, w = u - x, v - y, w - z
        self._start, self.length = start, math.sqrt(u * u + v * v + w * w)
        scale = self.length or 1.0
        self._way = u / scale, v / scale, w / scale
        self.found, self._last, self._passed = 0, -1, 0.0

    def rest(self) -> tuple[float, ...]:
        """The ray that is left of it: origin, direction, length."""
        (x, y, z), (u, v, w), passed = self._start, self._way, self._passed
        return x + passed * u, y + passed * v, z + passed * w, u, v, w, self.length - passed

    def meet(self, hit: SceneryHit) -> bool:
        """Count a surface that is met next; whether there is more of the line behind it."""
        if _is_victim(hit.name):
            self._passed += hit.distance + SLIVER
            return True
        again = hit.geom == self._last and (hit.distance <= STRIDE or not hit.entering)
        self.found += 0 if again else 1
        self._last = hit.geom
        self._passed += hit.distance + STRIDE
        return self._passed < self.length


def _is_victim(name: str | None) -> bool:
    return name is not None and part_of(name) is not None


def _clip(start: Vector, end: Vector) -> tuple[Vector, Vector]:
    """Beginning and end of what lies within `FAR` of the origin along all axes; the origin twice if
    nothing does. Points inside stay bit by bit what they are.

    The method of Liang and Barsky (ACM TOG 3(1), 1984).
    """
    nothing = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if not all(map(math.isfinite, (*start, *end))):
        return nothing
    if max(map(abs, (*start, *end))) <= FAR:
        return start, end
    first, last = 0.0, 1.0
    for a, b in zip(start, end, strict=True):
        way = b - a
        if way == 0.0:
            if abs(a) > FAR:
                return nothing
            continue
        enters, leaves = sorted(((-FAR - a) / way, (FAR - a) / way))
        first, last = max(first, enters), min(last, leaves)
    if first > last:
        return nothing
    begin = start if first == 0.0 else _point(start, end, first)
    return begin, end if last == 1.0 else _point(start, end, last)


def _point(start: Vector, end: Vector, part: float) -> Vector:
    x, y, z = (a + part * (b - a) for a, b in zip(start, end, strict=True))
    return x, y, z
