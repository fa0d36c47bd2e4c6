"""One range against the ray that it should be of, and bounds that chance does not leave in the life
of a kit."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from statistics import median

from usarsim_conformance.case import Case
from usarsim_conformance.excursions import Mount, bearer
from usarsim_conformance.registry import Failed, Inconclusive, NotApplicable
from usarsim_conformance.walls import Scene, Surrounded, Vector, among_walls, turned_by

SLACK = 0.03
"""m by which a range may be off: two digits, cut off, and a robot that has settled."""
EDGE = 0.06
"""m from the edge of a wall within which a beam may hit or miss."""


@dataclass(frozen=True, slots=True)
class Beam:
    """One value, and the ray that it should be of."""

    scene: Scene  # when it was told
    item: str  # name of the sensor
    what: str  # which of its values
    start: Vector  # ray in the robot's frame
    way: Vector
    value: float  # m
    perhaps: Vector | None = None
    """Another direction that the ray may have, as far as printed digits tell."""


def ray(mount: Mount, yaw: float = 0.0, pitch: float = 0.0) -> tuple[Vector, Vector]:
    """Start and direction of a beam in the robot's frame; yaw to the right, pitch upwards."""
    x, y, z = mount.location
    way = (math.cos(pitch) * math.cos(yaw), math.cos(pitch) * math.sin(yaw), -math.sin(pitch))
    return (x, y, z), turned_by(mount.orientation, way)


def limit(found: Surrounded, type: str, item: str, key: str) -> float:
    """A number of CONF.

    Raises:
        NotApplicable: if it is not told.
    """
    told = found.equipment.configured(type).get(item, {}).get(key)
    if told is None:
        raise NotApplicable(f"CONF tells no {key} of {item}")
    return float(told)


def floor_below(beams: Sequence[Beam], high: float) -> float:
    """z of the floor in the robot's frame, where beams on open floor that go down end; inf if
    there is none in reach."""
    found = [
        beam.start[2] + beam.value * beam.way[2]
        for beam in beams
        if beam.scene.wall is None and beam.way[2] > 0.05 and beam.value < 0.9 * high
    ]
    return median(found) if found else math.inf


def _along(beam: Beam, floor: float) -> tuple[float, float]:
    """Where a beam meets the wall or the floor, m, and how far it passes the nearest edge."""
    wall = beam.scene.wall
    length, margin = wall.along(beam.start, beam.way) if wall else (math.inf, math.inf)
    if beam.way[2] > 1e-3 and floor < math.inf:
        ground = (floor - beam.start[2]) / beam.way[2]
        margin = min(margin, abs(ground - length)) if length < math.inf else margin
        length = min(length, ground)
    return length, margin


def judge_beam(
    case: Case,
    found: Surrounded,
    type: str,
    key: str,
    beam: Beam,
    least: bool,
    floor: float = math.inf,
) -> None:
    """One value against the ray: the wall's distance, or MaxRange if there is no wall."""
    length, margin = _along(beam, floor)
    if beam.perhaps is not None:
        other, edge = _along(replace(beam, way=beam.perhaps), floor)
        if math.isinf(other) != math.isinf(length):
            return
        margin = min(margin, edge)
        length = min(max(beam.value, min(length, other)), max(length, other))
    low, high = (limit(found, type, beam.item, name) for name in ("MinRange", "MaxRange"))
    if margin < EDGE or abs(length - high) < 0.01 * high + SLACK or length < low * 0.5:
        return
    if length < low:
        if not least:
            return
        length = low
    wanted = min(length, high)
    if abs(beam.value - wanted) < SLACK + 0.005 * wanted + (
        0.03 * wanted if beam.way[2] > 0.05 else 0.0
    ):
        return
    what = "MaxRange" if wanted == high else "MinRange" if wanted == low else "where a wall is"
    case.fail(
        f"{key} of {beam.what} is {beam.value:.3f} m, not {wanted:.3f} m, {what} (scene "
        f"{beam.scene.name!r})"
    )


_ORDERS = {
    "roll and yaw": (2, 1, 0),
    "pitch and yaw": (0, 2, 1),
    "roll and pitch": (1, 0, 2),
}
"""Angles that a server may exchange."""


def explained(found: Surrounded, type: str, judge: Callable[[Surrounded], None]) -> None:
    """Judge values by GEO; if they fail, tell whether all are right with two angles of GEO
    exchanged: then not the values are wrong.

    Raises:
        Failed: if one is not right.
    """
    try:
        judge(found)
    except Failed as error:
        for words, order in _ORDERS.items():
            other = replace(found, order=order)
            if other.mounts(type) == found.mounts(type):
                continue
            try:
                judge(other)
            except (Failed, Inconclusive, NotApplicable):
                continue
            first = next(name for name, one in found.mounts(type).items() if any(one.orientation))
            told, right = (
                ",".join(f"{angle:.4f}" for angle in one.mounts(type)[first].orientation)
                for one in (found, other)
            )
            raise Failed(
                f"{words} of Orientation of GEO are exchanged: it is {told} for {first}, not "
                f"{right}, by which every Range of {type} is right (by GEO as it is, {error})"
            ) from None
        raise


async def walls_for(case: Case, type: str) -> Surrounded:
    return await among_walls(case, await bearer(case, type, "GroundTruth", fixed=type))


def values_of(found: Surrounded, type: str, key: str) -> Iterator[tuple[Scene, str, Mount, str]]:
    """The last value of each item in each scene."""
    mounts = found.mounts(type)
    for scene in found.scenes:
        for item, told in scene.track.items(type, key).items():
            if item in mounts:
                yield scene, item, mounts[item], told[-1][1]


CHANCE = 5.3
"""Standard deviations of a normal variate that are exceeded once in ten million times."""


def spread_bounds(samples: int) -> tuple[float, float]:
    """Between which the mean square of so many unit normal variates stays.

    The cube root of chi-square is nearly normal (Wilson and Hilferty 1931).
    """
    part = 2.0 / (9.0 * samples)
    low, high = (1.0 - part + sign * CHANCE * math.sqrt(part) for sign in (-1.0, 1.0))
    return max(low, 0.0) ** 3, high**3
