"""Which zone holds a place, and whether a blue band does.

A band reaches so far into a zone from each border with a zone of another rule. Floor without a zone
is free; a zone with a rule has a band along it too. Only where robots can cross: the grid of the
reachable floor tells, so that a zone that ends at the walls of a room has its band at the door.
Blue zones of the world are bands as they are drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

from usarsim_mission.grid import FREE, Grid
from usarsim_mission.model import Point, World, Zone
from usarsim_mission.scoring import ZoneRules

Segment = tuple[Point, Point]

_PIECE = 0.1
"""m of a border that are looked at for a way across, at a time."""
_BESIDE = 0.15
"""m beside a border that have to be free for that."""


class ZoneMap:
    """The zones of a world under the rules of a scoring file.

    Attributes:
        zones: those with a rule, in which a place can be; at most one holds it.
        bands: blue ones, which may lie across others.
    """

    def __init__(self, world: World, rules: ZoneRules, band: float) -> None:
        """Derive the bands.

        Args:
            world: with its zones.
            rules: by colour.
            band: m that a band reaches into a zone.
        """
        self.zones = tuple(one for one in world.zones if not rules.of(one.colour).transition)
        self.bands = tuple(one for one in world.zones if rules.of(one.colour).transition)
        self._band = band
        self._borders = {zone.name: self._border(zone, rules, world.floor) for zone in self.zones}

    def zone(self, x: float, y: float) -> Zone | None:
        """The zone that holds a place; None if there is none."""
        return next((zone for zone in self.zones if contains(zone.points, x, y)), None)

    def in_band(self, zone: Zone, x: float, y: float) -> bool:
        """Whether a place in a zone lies in a band."""
        if any(contains(one.points, x, y) for one in self.bands):
            return True
        return any(distance(one, x, y) <= self._band for one in self._borders[zone.name])

    def borders(self, zone: Zone) -> Sequence[Segment]:
        """Where a zone borders on another rule; m."""
        return self._borders[zone.name]

    def _border(self, zone: Zone, rules: ZoneRules, floor: Grid | None) -> list[Segment]:
        rule = rules.of(zone.colour)
        others = [one for one in self.zones if rules.of(one.colour) != rule]
        found = [edge for other in others for edge in edges(other.points)]
        if floor is None:
            return found
        found = [part for edge in found for part in self._crossings(edge, floor, zoned=True)]
        if rule != rules.of(None):
            for edge in edges(zone.points):
                found += self._crossings(edge, floor, zoned=False)
        return found

    def _crossings(self, edge: Segment, floor: Grid, *, zoned: bool) -> Iterator[Segment]:
        """The parts of an edge that robots can get across.

        Args:
            edge: of a zone.
            floor: that robots can get to.
            zoned: whatever is on the other side; else only to floor without a zone.
        """
        (x0, y0), (x1, y1) = edge
        length = math.hypot(x1 - x0, y1 - y0)
        count = max(1, math.ceil(length / _PIECE))
        aside = max(floor.cell, _BESIDE) / (length or 1.0)
        ax, ay = (y0 - y1) * aside, (x1 - x0) * aside
        begin: Point | None = None
        for number in range(count + 1):
            share = (number + 0.5) / count
            x, y = x0 + (x1 - x0) * share, y0 + (y1 - y0) * share
            sides = ((x + ax, y + ay), (x - ax, y - ay))
            free = number < count and (
                floor.at(x, y) == FREE
                if zoned
                else any(floor.at(*side) == FREE and self.zone(*side) is None for side in sides)
            )
            corner = x0 + (x1 - x0) * number / count, y0 + (y1 - y0) * number / count
            if free and begin is None:
                begin = corner
            elif not free and begin is not None:
                yield begin, corner
                begin = None


def edges(points: Sequence[Point]) -> Iterator[Segment]:
    """The edges of a polygon."""
    yield from pairwise((*points, points[0]))


def contains(points: Sequence[Point], x: float, y: float) -> bool:
    """Whether a polygon holds a place: a ray to the right crosses its edges an odd number of times.

    Of two polygons that share an edge exactly one holds a place on it.
    """
    inside = False
    x0, y0 = points[-1]
    for x1, y1 in points:
        if (y0 > y) != (y1 > y) and x < (x1 - x0) * (y - y0) / (y1 - y0) + x0:
            inside = not inside
        x0, y0 = x1, y1
    return inside


def distance(segment: Segment, x: float, y: float) -> float:
    """From a place to a segment, m."""
    (x0, y0), (x1, y1) = segment
    dx, dy = x1 - x0, y1 - y0
    square = dx * dx + dy * dy
    share = ((x - x0) * dx + (y - y0) * dy) / square if square else 0.0
    share = min(max(share, 0.0), 1.0)
    return math.hypot(x0 + share * dx - x, y0 + share * dy - y)
