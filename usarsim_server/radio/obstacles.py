"""How many obstacles a line between two stations meets.

Obstacles are counted by the rule of the original (side channels reference 3.3): only the part of
the world that never moves counts. Robots, victims and everything movable let a signal pass, as they
did in the original, which counted brushes, static meshes and blocking volumes.
"""

from __future__ import annotations

import math
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

    def first_scenery(self, origin: Array, direction: Array, reach: float) -> SceneryHit | None:
        """What a ray meets first of what never moves, within reach (m); None: nothing."""


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
        segment = _clipped(start, end)
        if segment is None:
            return 0
        origin, way = segment
        length = float(np.linalg.norm(way))
        if not length > 0.0:
            return 0
        direction = way / length
        found, passed, last = 0, 0.0, -1
        for _ in range(MOST):
            reach = length - passed
            hit = self._world.first_scenery(origin + passed * direction, direction, reach)
            if hit is None:
                break
            if _is_victim(hit.name):
                passed += hit.distance + SLIVER
                continue
            again = hit.geom == last and (hit.distance <= STRIDE or not hit.entering)
            found += 0 if again else 1
            last = hit.geom
            passed += hit.distance + STRIDE
            if passed >= length:
                break
        return found


def _is_victim(name: str | None) -> bool:
    return name is not None and part_of(name) is not None


def _clipped(start: Vector, end: Vector) -> tuple[Array, Array] | None:
    """Beginning and extent of what lies within `FAR` of the origin along all axes; None: nothing.

    The method of Liang and Barsky (ACM TOG 3(1), 1984). Points inside stay bit by bit what they
    are.
    """
    if not all(map(math.isfinite, (*start, *end))):
        return None
    first, last = 0.0, 1.0
    for a, b in zip(start, end, strict=True):
        way = b - a
        if way == 0.0:
            if abs(a) > FAR:
                return None
            continue
        enters, leaves = sorted(((-FAR - a) / way, (FAR - a) / way))
        first, last = max(first, enters), min(last, leaves)
    if first > last:
        return None
    here, there = np.array(start), np.array(end)
    begin = here if first == 0.0 else here + first * (there - here)
    finish = there if last == 1.0 else here + last * (there - here)
    return begin, finish - begin
