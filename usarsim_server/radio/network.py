"""Who is registered, how strong each hears the other, and which links are up. No sockets.

A worker thread looks at the world (`observe` may wait for a physics step); everything else belongs
to one thread, usually the event loop, and reads what was seen last. Stations of a world are its
robots; whoever walks or controls the world is none.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from usarsim_server.protocol.values import Vector
from usarsim_server.radio.configuration import Fading
from usarsim_server.radio.event_log import Event, EventLog
from usarsim_server.radio.models import Propagation


@dataclass(frozen=True, slots=True)
class Station:
    """A robot or a ComStation at one instant."""

    name: str  # label from INIT, in its own spelling
    position: Vector  # of its reference point, simulation frame, m
    battery_empty: bool = False  # whether it has run out of power


StationSource = Callable[[], Sequence[Station]]
"""All stations of this moment in the order of spawning; may block for a physics step."""


class ObstacleCounter(Protocol):
    """Counts what stands between two points."""

    def count(self, start: Vector, end: Vector) -> int:
        """Obstacles between two points (simulation frame, m) by the rule of side channels 3.3."""

    def counts(self, start: Vector, ends: Sequence[Vector]) -> list[int]:
        """The same between a point and each of others."""


@dataclass(frozen=True, slots=True, eq=False)
class RadioWorld:
    """What a network sees of the simulation."""

    stations: StationSource  # everybody's place
    obstacles: ObstacleCounter  # counts what stands between two places
    clock: Callable[[], float]  # simulated time, s; returns at once
    speed: float = 1.0  # simulated seconds per second of wall time; infinity: as fast as possible


@dataclass(frozen=True, slots=True)
class Departure:
    """A station that has to go: its battery is empty, or the simulator does not know it."""

    name: str
    battery_empty: bool


@dataclass(frozen=True, slots=True, eq=False)
class _Picture:
    time: float = 0.0
    positions: Mapping[str, Vector] = field(default_factory=dict)
    empty: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class _Count:
    """Obstacles as they were counted once between two places."""

    start: Vector
    end: Vector
    obstacles: int

    def holds(self, start: Vector, end: Vector, reach: float) -> bool:
        """Whether neither place is further than `reach` (m) from where it was."""
        return max(math.dist(self.start, start), math.dist(self.end, end)) <= reach


class Network:
    """Registered stations and the links between them; names are compared with their case."""

    def __init__(
        self,
        world: RadioWorld,
        model: Propagation,
        fading: Fading | None = None,
        *,
        cache_distance: float = 0.25,
        patience: float = 1.0,
        log: EventLog | None = None,
    ) -> None:
        """Start without stations.

        Args:
            world: what there is to see.
            model: how strong signals arrive.
            fading: added to the strength that the model says.
            cache_distance: m that a station may move before obstacles are counted again.
            patience: s of wall time that a registered station may be unknown to the simulator
                before it has to go.
            log: told of stations and links.
        """
        self.model = model
        self.log = log or EventLog(None, world.clock)
        self._world = world
        self._fading = fading or Fading()
        self._reach = cache_distance
        self._patience = patience
        self._picture = _Picture()
        self._lock = threading.Lock()
        self._counts: dict[tuple[str, str], _Count] = {}
        """Guarded by the lock, as an observing thread and the owner both count."""
        self._seen: dict[str, float] = {}
        self._up: dict[tuple[str, str], bool] = {}

    # -- stations --------------------------------------------------------------------------------

    @property
    def names(self) -> tuple[str, ...]:
        """All registered stations in the order of registration."""
        return tuple(self._seen)

    def register(self, name: str, now: float) -> bool:
        """Add a station; False if the name is taken. `now`: s of wall time."""
        if name in self._seen:
            return False
        self._seen[name] = now
        return True

    def deregister(self, name: str) -> None:
        """Remove a station; does nothing if it is not there."""
        self._seen.pop(name, None)
        self._up = {pair: up for pair, up in self._up.items() if name not in pair}
        with self._lock:
            self._counts = {pair: old for pair, old in self._counts.items() if name not in pair}

    # -- looking ---------------------------------------------------------------------------------

    def observe(self) -> None:
        """Look where everybody is and what stands between the registered ones.

        May wait for a physics step, and may be called on a thread of its own, one call at a time.

        Raises:
            UsarsimError: if the simulation has ended.
        """
        if not self.model.needs_positions:
            return
        time = self._world.clock()  # before the places, which then are not older than it
        stations = self._world.stations()
        picture = _Picture(
            time,
            {station.name: station.position for station in stations},
            frozenset(station.name for station in stations if station.battery_empty),
        )
        if self.model.counts_obstacles:
            # Not over all names: those of nobody cost nothing, however many are registered.
            for one, other in _pairs(filter(picture.positions.__contains__, self.names)):
                self._obstacles(picture, one, other)
        self._picture = picture

    @property
    def outdated(self) -> bool:
        """Whether time has passed since the last look."""
        return self.model.needs_positions and self._picture.time < self._world.clock()

    def knows(self, name: str) -> bool:
        """Whether the last look found a station, or none is needed."""
        return not self.model.needs_positions or name in self._picture.positions

    def review(self, now: float) -> list[Departure]:
        """Record which links came and went since the last review; returns who has to go.

        Args:
            now: s of wall time.
        """
        departures = []
        for name in self.names:
            empty = name in self._picture.empty
            if self.knows(name):
                self._seen[name] = now
            if empty or now - self._seen[name] > self._patience:
                departures.append(Departure(name, empty))
        if self.log.recording:
            for pair in _pairs(filter(self.knows, self.names)):
                self._review_link(pair)
        return departures

    def _review_link(self, pair: tuple[str, str]) -> None:
        strength = self.strength(*pair)
        up = self.model.connects(strength)
        if up is not self._up.get(pair):
            self._up[pair] = up
            event = Event.IN_RANGE if up else Event.OUT_OF_RANGE
            self.log.write(event, *pair, strength, self.distance(*pair))

    # -- asking ----------------------------------------------------------------------------------

    def distance(self, one: str, other: str) -> float:
        """Metres between two stations at the last look; not a number if one was not found."""
        start, end = map(self._picture.positions.get, (one, other))
        return math.nan if start is None or end is None else math.dist(start, end)

    def strength(self, one: str, other: str) -> float:
        """dBm between two stations, equal in both directions; not a number if one is unknown."""
        if not self.model.needs_positions:
            return self.model.strength(0.0, 0) + self._fading.of(one, other, self._world.clock())
        picture = self._picture
        distance = self.distance(one, other)
        if math.isnan(distance):
            return math.nan
        obstacles = 0
        if self.model.counts_obstacles:
            obstacles = self._obstacles(picture, *sorted((one, other)))
        return self.model.strength(distance, obstacles) + self._fading.of(one, other, picture.time)

    def connected(self, one: str, other: str) -> bool:
        """Whether two stations can talk to each other."""
        if not (self.knows(one) and self.knows(other)):
            return self.model.trusting
        return self.model.connects(self.strength(one, other))

    def _obstacles(self, picture: _Picture, one: str, other: str) -> int:
        """Count, or remember the count of when both stood about where they are."""
        start, end = map(picture.positions.get, (one, other))
        if start is None or end is None:
            return 0
        with self._lock:
            old = self._counts.get((one, other))
        if old is not None and old.holds(start, end, self._reach):
            return old.obstacles
        number = self._world.obstacles.count(start, end)
        with self._lock:
            self._counts[one, other] = _Count(start, end, number)
        return number


def _pairs(names: Iterable[str]) -> Iterator[tuple[str, str]]:
    """Every pair once, the smaller name first, as the original asks (side channels 3.5)."""
    return itertools.combinations(sorted(names), 2)
