"""Who is where: GETPOS and GETOBS for wireless simulations, the listing of actors for scoring.

GETOBS also says what stands between two places (side channels reference 3). The listing has
everybody and everything in the world under the names of the original's engine. The engine calls a
pawn by its class and a number, `P3AT_0`, whatever its owner calls it; objects of world controllers
and items of robots go by their own names (side channels reference 6.1).
"""

from __future__ import annotations

import math
import re
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

from usarsim_server.protocol import truth
from usarsim_server.protocol import truth as text
from usarsim_server.protocol.truth import BetweenPoints, BetweenRobots
from usarsim_server.protocol.truth import GroundTruthQuery as Query
from usarsim_server.radio.network import ObstacleCounter, Station, StationSource
from usarsim_server.robots.description import ItemDescription, RobotDescription
from usarsim_server.simulation.frames import Pose, flip_point, wire_from_pose
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.worlds.avatars.avatars import Avatars
from usarsim_server.worlds.objects.objects import WorldObjects
from usarsim_server.worlds.surroundings import LiveVictim


class _Sighting:
    """Where everybody was at one moment, and what stood between them as far as it was counted.

    Attributes:
        stations: all of that moment. robots: who was there.
        until: s of wall time to which it holds.
    """

    def __init__(self, stations: Sequence[Station], robots: object, until: float) -> None:
        self.stations, self.robots, self.until = stations, robots, until
        self._numbers: dict[str, int] = {}
        for number, one in enumerate(stations):
            self._numbers.setdefault(one.name.lower(), number)
        self._counts: dict[int, list[int]] = {}

    def ends(self, query: BetweenRobots) -> tuple[int, int] | None:
        """Numbers of two stations, each the first of its name, whatever its case (side channels
        3.3); None if one is not there."""
        start, end = (self._numbers.get(name.lower()) for name in (query.start, query.end))
        return None if start is None or end is None else (start, end)

    def known(self, ends: tuple[int, int]) -> int | None:
        """Obstacles from one to the other, None if they have not been counted."""
        row = self._counts.get(ends[0])
        return None if row is None else row[ends[1]]

    def count(self, ends: tuple[int, int], obstacles: ObstacleCounter) -> int:
        """The same, counted if they have not been: those from one station to all at once."""
        if self._counts.get(ends[0]) is None:
            places = [one.position for one in self.stations]
            self._counts[ends[0]] = obstacles.counts(places[ends[0]], places)
        return self._counts[ends[0]][ends[1]]


class GroundTruth:
    """Knows all stations and everything between them; may be used by any thread.

    A wireless simulation asks for every pair of robots, one after the other. So the physics is
    asked once in an instant, obstacles from one robot are counted to all others at once, and what
    is known by then is told without waiting for anybody.
    """

    def __init__(
        self,
        stations: StationSource,
        obstacles: ObstacleCounter,
        span: float = 0.0,
        robots: Callable[[], object] = tuple,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Know the world.

        Args:
            stations: all robots of this moment.
            obstacles: counts what stands between two points.
            span: s of wall time for which a look at the stations holds; 0: every question is about
                its own moment.
            robots: changes with who is there; a look before that does not hold any more.
            clock: wall time, s.
        """
        self._stations = stations
        self._obstacles = obstacles
        self._span, self._robots, self._clock = span, robots, clock
        self._sighting = _Sighting((), None, -math.inf)

    def answer(self, line: str) -> str | None:
        """The reply to one request, both without line end; None: there is no reply.

        May block for a physics step, so it is not for the event loop. An empty text is a reply,
        too: an empty line has to be sent.

        Raises:
            UsarsimError: if the simulation has ended.
        """
        return self.answers([line])[0]

    def answers(self, lines: Iterable[str]) -> list[str | None]:
        """The replies to requests that came together, one for each, about the same moment.

        Cheaper than one by one: the physics is asked once for all of them. See `answer`.
        """
        queries = [text.read_ground_truth_query(line) for line in lines]
        needed = any(isinstance(query, text.Positions | BetweenRobots) for query in queries)
        sighting = self._look() if needed else self._sighting
        return [None if one is None else self._reply(one, sighting) for one in queries]

    def at_once(self, line: str) -> str | None:
        """The reply to a request, as in `answer`, if it is known without asking the physics or
        casting a ray; otherwise None."""
        sighting = self._sighting
        if not self._holds(sighting):
            return None
        match text.read_ground_truth_query(line):
            case text.Positions():
                return _positions(sighting)
            case BetweenRobots() as query:
                ends = sighting.ends(query)
                count = text.UNKNOWN_COUNT if ends is None else sighting.known(ends)
                return None if count is None else text.obstacles(query, count)
        return None

    def version(self) -> object:
        """What is equal to an earlier one while everything that was told since then still holds."""
        sighting, now = self._sighting, self._clock()
        if self._holds(sighting):
            return sighting
        # What was asked while a sighting held and is told when it does not belongs to none.
        return object() if now < sighting.until + self._span else self._robots()

    def _holds(self, sighting: _Sighting) -> bool:
        return self._clock() < sighting.until and self._robots() == sighting.robots

    def _look(self) -> _Sighting:
        """The last sighting if it still holds, or a new one."""
        sighting = self._sighting
        if not self._holds(sighting):
            # Both before the look, which is not older then.
            robots, until = self._robots(), self._clock() + self._span
            self._sighting = sighting = _Sighting(self._stations(), robots, until)
        return sighting

    def _reply(self, query: Query, sighting: _Sighting) -> str:
        match query:
            case text.Positions():
                return _positions(sighting)
            case BetweenRobots():
                return text.obstacles(query, self._between(query, sighting))
            case BetweenPoints():
                ends = flip_point(query.start_point), flip_point(query.end_point)
                return text.obstacles(query, self._obstacles.count(*ends))
            case _:
                return ""

    def _between(self, query: BetweenRobots, sighting: _Sighting) -> int:
        ends = sighting.ends(query)
        if ends is None:
            return text.UNKNOWN_COUNT
        if self._span:
            return sighting.count(ends, self._obstacles)
        # Nobody asks about this moment again.
        return self._obstacles.count(*(sighting.stations[one].position for one in ends))


def _positions(sighting: _Sighting) -> str:
    return text.positions(_position(one) for one in sighting.stations)


def _position(station: Station) -> text.Position:
    return text.Position(station.name, flip_point(station.position), station.battery_empty)


PAWN = "pawn"
"""The class that is listed if none is asked for."""

# Ancestors of the original's classes, in lower case, as far as a tool may ask for them.
_ACTOR = frozenset({"actor", "object"})
_PAWN = _ACTOR | {PAWN}
_VICTIM = _PAWN
_AVATAR = _PAWN | {"usaravatarcommon", "usaravatarnewcommon"}
_VEHICLE = _PAWN | {"basevehicle", "usarvehicle"}
_OBJECT = _ACTOR | {"wcobject", "kactor"}
_ITEM = _ACTOR | {"item"}
_VICTIM_NAME = re.compile(r"(MaleVictim|FemaleVictim)_([0-9]{1,6})", re.ASCII)
_FAMILIES = {
    "skid": {"wheeledvehicle", "skidsteeredvehicle"},
    "differential": {"wheeledvehicle", "skidsteeredvehicle"},
    "tracked": {"wheeledvehicle", "skidsteeredvehicle"},
    "omni": {"wheeledvehicle"},
    "ackerman": {"wheeledvehicle", "ackermansteeredvehicle"},
    "static": {"staticvehicle", "staticplatform"},
    "aerial": {"aerialvehicle"},
    "legged": {"leggedvehicle"},
}
"""Beginnings of the kinds of robot files, and what the original derived such robots from."""


@dataclass(frozen=True, slots=True)
class _Present:
    """An actor at the instant of a listing; `kinds` are all its classes in lower case."""

    name: str
    class_name: str
    kinds: frozenset[str]
    pose: Pose

    def line(self) -> truth.Actor:
        return truth.Actor(self.name, self.class_name, *wire_from_pose(self.pose))


class _PawnNames:
    """Gives every pawn a name that is its own for the whole run."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._names: dict[int, str] = {}
        self._counts: dict[str, int] = {}

    def keep(self, name: str) -> None:
        """Leave a name, and all of its class with smaller numbers, to somebody who has it."""
        class_name, _, number = name.rpartition("_")
        with self._lock:
            count = self._counts.get(class_name.lower(), 0)
            self._counts[class_name.lower()] = max(count, int(number) + 1)

    def name(self, class_name: str, body: int | None = None) -> str:
        """Name of the thing with a number in the simulation; always a new one for None."""
        with self._lock:
            if body is not None and body in self._names:
                return self._names[body]
            number = self._counts.get(class_name.lower(), 0)
            self._counts[class_name.lower()] = number + 1
            name = f"{class_name}_{number}"
            if body is not None:
                self._names[body] = name
            return name


Robots = Sequence[tuple[int, RobotDescription]]
"""Number in the simulation and class of every robot, in the order of spawning."""


class Actors:
    """All actors of a world; may be used by any thread."""

    def __init__(
        self,
        simulation: Simulation,
        robots: Callable[[], Robots],
        victims: Iterable[LiveVictim],
        avatars: Avatars,
        objects: WorldObjects,
    ) -> None:
        """Know where everybody is to be found.

        Args:
            simulation: the world.
            robots: all robots of this moment.
            victims: people of the world, in the order of the world file. A name there that is a
                class of the original and a number, `MaleVictim_3`, is kept.
            avatars, objects: of the world.
        """
        self._simulation = simulation
        self._robots = robots
        self._avatars = avatars
        self._objects = objects
        self._names = _PawnNames()
        people = list(victims)
        for one in people:
            if _VICTIM_NAME.fullmatch(one.name):
                self._names.keep(one.name)
        self._victims = [self._victim(one) for one in people]

    def answer(self, line: str) -> str:
        """The whole listing that a query asks for, line ends included.

        Blocks until the physics is between two steps.

        Args:
            line: without line end.

        Raises:
            UsarsimError: if the simulation has ended.
        """
        query = truth.read_query(line)
        wanted = query.bare_class if query.class_name else PAWN
        robots = self._robots()
        snapshot = self._simulation.look()
        found = [
            actor.line()
            for actor in self._all(snapshot, robots)
            if wanted in actor.kinds and query.name in ("", actor.name)
        ]
        return truth.listing(found, snapshot.time)

    def _all(self, snapshot: Snapshot, robots: Robots) -> Iterator[_Present]:
        states = [(*one, self._simulation.body(one[0]).state(snapshot)) for one in robots]
        riding = [(number, robot, state) for number, robot, state in states if state is not None]
        for number, robot, state in riding:
            yield self._robot(number, robot, state)
        for body, class_name, name in self._victims:
            facts = self._simulation.object_facts(body, snapshot)
            if facts is not None:
                yield _Present(name, class_name, _VICTIM | {class_name.lower()}, facts.pose)
        for avatar, pose in self._avatars.present(snapshot):
            class_name = avatar.kind.name
            name = self._names.name(class_name, avatar.body)
            yield _Present(name, class_name, _AVATAR | _lower(class_name), pose)
        for thing, pose in self._objects.present(snapshot):
            kind = thing.kind
            yield _Present(thing.name, kind.name, _OBJECT | _lower(kind.name, *kind.aliases), pose)
        for _, robot, state in riding:
            yield from _items(robot, state)

    def _robot(self, body: int, robot: RobotDescription, state: RobotBody) -> _Present:
        family = [names for word, names in _FAMILIES.items() if robot.kind.startswith(word)]
        kinds = _VEHICLE.union(*family) | _lower(robot.name)
        name = self._names.name(robot.name, body)
        return _Present(name, robot.name, kinds, state.pose)

    def _victim(self, victim: LiveVictim) -> tuple[str, str, str]:
        """Body, class and name of a victim; the name of the world file if it is an engine's."""
        body = f"victim:{victim.name}"
        given = _VICTIM_NAME.fullmatch(victim.name)
        if given is not None:
            return body, given[1], victim.name
        female = victim.properties.get("figure") == "female"
        class_name = "FemaleVictim" if female else "MaleVictim"
        return body, class_name, self._names.name(class_name)


def _items(robot: RobotDescription, state: RobotBody) -> Iterator[_Present]:
    """Sensors and fixed effectors of a robot, under their own names."""
    for item in robot.items:
        yield _item(item, "sensor", state)
    for effector in robot.effectors:
        if not effector.detached:
            yield _item(effector.item, "effector", state)


def _item(item: ItemDescription, family: str, state: RobotBody) -> _Present:
    carrier = state.pose if item.link is None else state.link_pose(item.link)
    return _Present(item.name, item.type, _ITEM | _lower(item.type, family), carrier @ item.pose)


def _lower(*names: str) -> frozenset[str]:
    return frozenset(name.lower() for name in names)
