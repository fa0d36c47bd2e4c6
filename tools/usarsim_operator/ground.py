"""Keeps what the unattended robots of a station know of the floor beside their map.

A flat scanner sees one height and misses what is lower. So the robots share the people that a
camera has seen or an operator has marked, the places where one of them was stopped, tilted or
lifted, where each robot is, and when each place was visited last.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from usarsim_operator.navigation import Place

PERSON = 0.95
"""m from the pelvis to the feet of somebody who lies: what is kept clear of around a mark."""
ROBOT = 0.4
"""m from the middle of a robot to its corners."""
_LIFT = 1.4  # m around a robot that a lift has within which that may be
_MOST = 1000  # people, and things that were felt
_TRAIL = 20.0  # simulated s for which somebody who walks may come back
_STEP = 0.3  # m between two places of a trail
_WALKS = 3.0  # simulated s between its last two places at which somebody still walks
_GOES_ON, _SOON = 8.0, 1.0  # simulated s for which one does so unseen, and ahead of now
_APART, _THING = 0.5, 0.9  # m between places that one thing was felt at
_TILE = 1.0  # m: side of the tiles that count as visited


@dataclass(frozen=True, slots=True)
class Disc:
    """Something that no robot touches: its middle, and how far it reaches, m."""

    place: Place
    radius: float


@dataclass(frozen=True, slots=True)
class Walker:
    """Somebody who walks.

    Attributes:
        place: where they are by now. velocity: m/s along x and y. radius: how far they reach, m.
    """

    place: Place
    velocity: Place
    radius: float

    def disc(self, after: float) -> Disc:
        """Where they will be after so many s."""
        (x, y), (dx, dy) = self.place, self.velocity
        return Disc((x + dx * after, y + dy * after), self.radius)


@dataclass(frozen=True, slots=True)
class Followed:
    """Somebody near whom a robot is to stay.

    Attributes:
        name: of them. place: where they are by now. within: m of them that the robot stays.
    """

    name: str
    place: Place
    within: float


class Ground:
    """The shared knowledge of all robots of one station; times are simulated s."""

    def __init__(self) -> None:
        self._people: dict[str, deque[tuple[float, Disc]]] = {}
        self._marked: list[Disc] = []
        self._left: list[Disc] = []
        self._felt: deque[tuple[float, Place]] = deque(maxlen=_MOST)
        self._between: deque[tuple[float, Place]] = deque(maxlen=_MOST)
        self._risen: deque[Disc] = deque(maxlen=_MOST)
        self._robots: dict[str, Place] = {}
        self._visits: dict[tuple[int, int], float] = {}
        self._follows: dict[str, tuple[str, float]] = {}
        self._walked: set[tuple[int, int]] = set()

    def keep_clear(self, name: str, disc: Disc, time: float) -> None:
        """Note where a person was seen. Who walks leaves a trail of discs, and may come back.

        The newest place replaces the one before where that is close to the rest of the trail.
        """
        if name not in self._people and len(self._people) >= _MOST:
            return
        trail = self._people.setdefault(name, deque())
        while len(trail) > 1 and time - trail[0][0] > _TRAIL:
            trail.popleft()
        if len(trail) > 1 and math.dist(trail[-1][1].place, trail[-2][1].place) < _STEP:
            trail.pop()
        trail.append((time, disc))
        if len(trail) > 1 and math.dist(trail[0][1].place, disc.place) > _STEP:
            self._walked |= {_tile(one.place) for _, one in trail}

    def follow(self, robot: str, name: str | None, within: float) -> None:
        """Let a robot stay within so many m of somebody; of nobody any more if name is None."""
        if name is None:
            self._follows.pop(robot, None)
        else:
            self._follows[robot] = name, within

    def followed(self, robot: str, time: float) -> Followed | None:
        """Near whom a robot is to stay; None if near nobody whose place is known."""
        name, within = self._follows.get(robot, ("", 0.0))
        if (trail := self._people.get(name)) is None:
            return None
        walker = _walker(trail, time)
        return Followed(name, trail[-1][1].place if walker is None else walker.place, within)

    def mark(self, places: Iterable[Place]) -> None:
        """Replace the places of people that operators have marked."""
        self._marked, self._left = [], []
        for place in places:
            (self._left if self._is_way(place) else self._marked).append(Disc(place, PERSON))

    def left(self) -> Iterator[Disc]:
        """Discs around marks beside the way of somebody who was seen to walk.

        They are theirs: they have gone on, and may come back; their trail tells where they are.
        """
        return iter(self._left)

    def _is_way(self, place: Place) -> bool:
        """Whether somebody who walks was seen within a tile of a place."""
        row, column = _tile(place)
        around = itertools.product((row - 1, row, row + 1), (column - 1, column, column + 1))
        return not self._walked.isdisjoint(around)

    def feel(self, time: float, place: Place) -> None:
        """Note a place where something stopped or tilted a robot.

        What was felt beside it is the same thing, and so is what is between: a pipe, a beam.
        """
        self._between.extend(
            (time, ((place[0] + other[0]) / 2.0, (place[1] + other[1]) / 2.0))
            for _, other in self._felt
            if _APART < math.dist(place, other) < _THING
        )
        self._felt.append((time, place))

    def felt(self, since: float) -> Iterator[Place]:
        """Places that were felt since a moment."""
        both = itertools.chain(self._felt, self._between)
        return (place for time, place in both if time >= since)

    def rise(self, place: Place) -> None:
        """Note where the floor rose under a robot: a lift."""
        self._risen.append(Disc(place, _LIFT))

    def risen(self) -> Iterator[Disc]:
        """Discs around those places."""
        return iter(self._risen)

    def stand(self, robot: str, place: Place, time: float) -> None:
        """Note where a robot is; the place counts as visited."""
        self._robots[robot] = place
        self.visit(place, time)

    def visit(self, place: Place, time: float) -> None:
        """Note that a place was looked at, or that no way leads there."""
        self._visits[_tile(place)] = time

    def forget(self, robot: str) -> None:
        """Drop a robot that has left."""
        self._robots.pop(robot, None)
        self._follows.pop(robot, None)

    def people(self, time: float) -> Iterator[Disc]:
        """Discs around all places where people are or may be: who walks has gone on since."""
        yield from self.still(time)
        for trail in self._people.values():
            if (walker := _walker(trail, time)) is not None:
                yield from _discs(trail, time)
                came = math.dist(trail[-1][1].place, walker.place)
                pace = math.hypot(*walker.velocity)
                parts = math.ceil((came + pace * _SOON) / _STEP)
                yield from (walker.disc(_SOON - part * _STEP / pace) for part in range(parts))

    def still(self, time: float) -> Iterator[Disc]:
        """Discs around who does not walk."""
        yield from self._marked
        for trail in self._people.values():
            if _walker(trail, time) is None:
                yield from _discs(trail, time)

    def walkers(self, time: float) -> Iterator[Walker]:
        """Who walks, seen at this moment or expected."""
        found = (_walker(trail, time) for trail in self._people.values())
        return (one for one in found if one is not None)

    def others(self, robot: str) -> Iterator[Disc]:
        """Discs around all robots but one."""
        return (Disc(place, ROBOT) for name, place in self._robots.items() if name != robot)

    def visited(self, place: Place) -> float:
        """When a robot was near a place last; minus infinity if none was."""
        return self._visits.get(_tile(place), -math.inf)


def _discs(trail: deque[tuple[float, Disc]], time: float) -> Iterator[Disc]:
    """Where somebody was seen last, and a while ago."""
    return (disc for since, disc in trail if time - since <= _TRAIL or disc is trail[-1][1])


def _walker(trail: deque[tuple[float, Disc]], time: float) -> Walker | None:
    """Who left a trail, while they walk: as they did between its last two places."""
    if len(trail) < 2:
        return None
    (before, was), (seen, now) = trail[-2], trail[-1]
    took, unseen = seen - before, time - seen
    if not 0.0 < took < _WALKS or unseen > _GOES_ON:
        return None
    dx, dy = ((new - old) / took for new, old in zip(now.place, was.place, strict=True))
    x, y = now.place
    return Walker((x + dx * unseen, y + dy * unseen), (dx, dy), now.radius)


def _tile(place: Place) -> tuple[int, int]:
    return math.floor(place[0] / _TILE), math.floor(place[1] / _TILE)
