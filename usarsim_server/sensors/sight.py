"""Where things are as a sensor sees them, and whether anything stands in between."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.values import Vector
from usarsim_server.simulation.frames import Pose, flip_point
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.worlds.victims import part_of

__all__ = ["in_sight", "relative", "sight_lines"]

Array = NDArray[np.float64]

MARGIN = 0.2
"""m: what a ray meets this near its end belongs to what it was sent to, such as a head to a
mouth."""


def relative(sensor: Pose, point: Vector) -> Vector:
    """A point of the world in the sensor's wire frame, m."""
    return flip_point((sensor.inverse() @ Pose(point)).position)


def sight_lines(sensor: Pose, points: Sequence[Vector]) -> tuple[RayFan, ...]:
    """The fan with one ray to each point; no fan for no points."""
    if not points:
        return ()
    origin = np.array(sensor.position)
    ways = np.array(points) - origin
    lengths = np.linalg.norm(ways, axis=1)
    there = lengths < 1e-6
    ways[there] = (1.0, 0.0, 0.0)
    directions = ways / np.where(there, 1.0, lengths)[:, None]
    return (RayFan(origin, directions, max(float(lengths.max()), MARGIN), identify=True),)


def in_sight(
    sensor: Pose,
    points: Sequence[Vector],
    hits: Sequence[RayHits],
    victims: Sequence[str | None] | None = None,
) -> list[bool]:
    """Which points can be seen.

    Args:
        sensor: as for `sight_lines`.
        points: as for `sight_lines`.
        hits: the answers to the fan.
        victims: for each point the victim that it belongs to, if any; nobody hides himself.
    """
    if not points:
        return []
    lengths = np.linalg.norm(np.array(points) - np.array(sensor.position), axis=1)
    free = [bool(far) for far in hits[0].distances >= lengths - MARGIN]
    names = hits[0].names
    if victims is None or names is None:
        return free
    return [
        seen or (victim is not None and _belongs(name, victim))
        for seen, name, victim in zip(free, names, victims, strict=True)
    ]


def _belongs(geom: str | None, victim: str) -> bool:
    found = None if geom is None else part_of(geom)
    return found is not None and found[0] == victim
