"""The live facts of a world: who is there and where, who calls, what is tagged.

One instance is shared by all robots of a world and may be used by any thread. What follows from
the world file never changes, or changes as a pure function of simulated time; only RFID tags can
be dropped and written, under a lock.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import mujoco

from usarsim_server.simulation.frames import Pose, Vector, pose_of
from usarsim_server.simulation.movers import Mover
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.description import (
    MAX_TAG_ID,
    FalseAlarm,
    Noise,
    RfidTag,
    Victim,
    WorldDescription,
)
from usarsim_server.worlds.life import BREATH, VOICE, Traits, traits_of
from usarsim_server.worlds.victims import add_victim, part_of

MAX_TAGS = 10_000
"""Tags that a world can hold; more cannot be dropped."""

MAX_MEMORY = 1024
"""Characters that fit into the memory of a tag."""

SPEED_WINDOW = 0.5
"""s over which the speed of a moving victim is averaged, so that an arm at its turning point is
not taken for a resting one."""
SPEED_SAMPLES = 10


@dataclass(frozen=True, slots=True)
class BodyPart:
    """A part of a victim: one of `PARTS`, `Left`, `Right` or no side, and its centre, m."""

    name: str
    side: str
    position: Vector


@dataclass(frozen=True, slots=True)
class Passer:
    """Somebody who is no victim but walks about, at an instant."""

    number: int  # in the simulation
    chest: Vector  # places, m
    head: Vector
    co2: float = BREATH  # percent by volume that the breath adds 1 m away


@dataclass(frozen=True, slots=True)
class Sound:
    """A noise that has begun."""

    position: Vector  # where it comes from, m
    noise: Noise  # what it is like
    start: float  # simulated s of its beginning
    victim: str | None = None  # name of the victim that calls, None for all other sources


@dataclass(frozen=True, slots=True)
class _Source:
    """Something that makes a noise at a place that may change."""

    place: Callable[[float], Vector]
    noise: Noise
    victim: str | None = None
    since: float | None = None
    """Simulated s from which on its times count; None: those of the world."""
    until: float = math.inf
    """Simulated s from which on none begins."""

    def sound(self, start: float, time: float) -> Sound:
        return Sound(self.place(time), self.noise, start, self.victim)


class LiveVictim:
    """One victim of a world.

    Attributes:
        name, status: as in the world file.
        properties: all of the world file.
        traits: those that the server knows.
        tag: number of its RFID tag, None if it carries none.
        movers: what moves its bodies.
        epoch: simulated s at which it began to do what it does.
    """

    def __init__(self, victim: Victim, tag: int | None) -> None:
        self.name = victim.name
        self.status = victim.status
        self.properties = victim.properties
        self.traits: Traits = traits_of(victim)
        self.tag = tag
        self.epoch = 0.0
        spec = mujoco.MjSpec()
        self.movers = add_victim(spec, victim)
        model = spec.compile()
        self._groups = _groups(model)
        self._fixed = {
            body: pose_of(model.body_pos[body], model.body_quat[body])
            for body in range(model.nbody)
        }
        self._ways = {model.body(mover.body).id: mover.pose for mover in self.movers}
        self._marks = [self._mark(body) for body in self._ways]
        self._at_rest = self._parts(0.0) if not self.movers else ()

    @property
    def moves(self) -> bool:
        """Whether it moves at all, now or later."""
        return bool(self.movers)

    def parts(self, time: float) -> tuple[BodyPart, ...]:
        """Its parts at a simulated time, left and right ones apart."""
        return self._at_rest or self._parts(time)

    def head(self, time: float) -> Vector:
        """Where it breathes and calls, m."""
        return next(part.position for part in self.parts(time) if part.name == "Head")

    def position(self, time: float) -> Vector:
        """Centre of its chest, m; where its tag is."""
        return next(part.position for part in self.parts(time) if part.name == "Chest")

    def motion(self, time: float) -> tuple[Vector, float]:
        """Place (m) and mean speed (m/s) of what moves; the chest and 0 if it keeps still."""
        if not self._marks:
            return self.position(time), 0.0
        span = SPEED_WINDOW / SPEED_SAMPLES
        mark = self._marks[0]
        places = [self._centre([mark], time - span * n) for n in range(SPEED_SAMPLES + 1)]
        way = sum(math.dist(a, b) for a, b in itertools.pairwise(places))
        return places[0], way / SPEED_WINDOW

    def _mark(self, body: int) -> tuple[int, Vector]:
        """A point that shows how a body moves: the chest of a walking person, a waving hand."""
        found = {
            name: local
            for (name, _), pieces in self._groups.items()
            for owner, local in pieces
            if owner == body
        }
        return body, found["Chest"] if "Chest" in found else found["Hand"]

    def _parts(self, time: float) -> tuple[BodyPart, ...]:
        return tuple(
            BodyPart(name, side, self._centre(pieces, time))
            for (name, side), pieces in self._groups.items()
        )

    def _centre(self, pieces: list[tuple[int, Vector]], time: float) -> Vector:
        points = [(self._pose(body, time) @ Pose(local)).position for body, local in pieces]
        x, y, z = (sum(axis) / len(points) for axis in zip(*points, strict=True))
        return x, y, z

    def _pose(self, body: int, time: float) -> Pose:
        way = self._ways.get(body)
        return self._fixed[body] if way is None else way(time - self.epoch)


class Surroundings:
    """What sensors of life find in a world.

    Attributes:
        victims: in the order of the world file.
        false_alarms: boxes that victim sensors mistake for people.
        movers: everything that moves people; for `Simulation.set_movers`.
    """

    def __init__(self, world: WorldDescription) -> None:
        """Bring a world's facts to life.

        Raises:
            WorldError: if a known property of a victim cannot be used.
        """
        self._placed = {tag.id: tag for tag in world.tags}
        self._tags = dict(self._placed)
        self._tags_lock = threading.Lock()
        numbers = [*self._tags, *(traits_of(victim).tag for victim in world.victims)]
        self._next_tag = 1 + max((n for n in numbers if not isinstance(n, bool)), default=0)
        self.victims = tuple(LiveVictim(v, self._number(v)) for v in world.victims)
        self.false_alarms: tuple[FalseAlarm, ...] = world.false_alarms
        self.movers: tuple[Mover, ...] = tuple(
            mover for victim in self.victims for mover in victim.movers
        )
        self._sources = [_Source(_fixed(one.position), one.noise) for one in world.sounds] + [
            _Source(victim.head, victim.traits.voice, victim.name)
            for victim in self.victims
            if victim.traits.voice is not None
        ]
        self._calls: tuple[_Source, ...] = ()
        self._passers: Callable[[Snapshot], Sequence[Passer]] = _nobody
        self._epoch = 0.0

    def restart(self, time: float) -> None:
        """Let everybody begin anew at a simulated time (s), see `Simulation.restart_scene`; tags
        are those of the world file again."""
        self._epoch, self._calls = time, ()
        for victim in self.victims:
            victim.epoch = time
        with self._tags_lock:
            self._tags = dict(self._placed)

    def call(self, name: str, since: float, until: float = math.inf) -> bool:
        """Let a victim call, beside what it does by itself, as it calls or as people do.

        Args:
            name: of the victim. since, until: simulated s; once more, and it begins anew.

        Returns:
            Whether there is one of that name.
        """
        victim = next((one for one in self.victims if one.name == name), None)
        if victim is None:
            return False
        noise = replace(victim.traits.voice or VOICE, delay=0.0)
        others = tuple(one for one in self._calls if one.victim != name)
        self._calls = (*others, _Source(victim.head, noise, name, since, until))
        return True

    # -- people who are no victims -----------------------------------------------------------

    def watch(self, passers: Callable[[Snapshot], Sequence[Passer]]) -> None:
        """Have sensors notice further people; `passers` may be called by any thread."""
        self._passers = passers

    def passers(self, snapshot: Snapshot) -> Sequence[Passer]:
        """Everybody who walks about and is no victim, at an instant, in a fixed order."""
        return self._passers(snapshot)

    # -- sounds ------------------------------------------------------------------------------

    def sounds(self, after: float, until: float) -> list[Sound]:
        """Noises that began in (after, until], in the order of beginning, where they began."""
        found = [
            source.sound(start, start)
            for source in (*self._sources, *self._calls)
            for start in self._beginnings(source, after, until)
        ]
        return sorted(found, key=lambda sound: sound.start)

    def sounding(self, time: float) -> list[Sound]:
        """Noises that last at a time, where they are then."""
        return [
            source.sound(start, time)
            for source in (*self._sources, *self._calls)
            for start in self._beginnings(source, time - source.noise.duration, time)
        ]

    def _beginnings(self, source: _Source, after: float, until: float) -> list[float]:
        epoch = self._epoch if source.since is None else source.since
        starts = beginnings(source.noise, after - epoch, until - epoch)
        return [start + epoch for start in starts if start + epoch < source.until]

    # -- RFID tags ---------------------------------------------------------------------------

    def tags(self, near: Vector, radius: float) -> list[RfidTag]:
        """Tags within a distance of a place (m), the nearest first."""
        with self._tags_lock:
            tags = list(self._tags.values())
        found = [(math.dist(tag.position, near), tag.id, tag) for tag in tags]
        return [tag for distance, _, tag in sorted(found) if distance <= radius]

    def tag(self, number: int) -> RfidTag | None:
        """The tag of a number as it is now, None if there is none."""
        with self._tags_lock:
            return self._tags.get(number)

    def write(self, number: int, memory: str) -> bool:
        """Write into a tag's memory; False if there is no such tag or the text is too long."""
        with self._tags_lock:
            tag = self._tags.get(number)
            if tag is None or len(memory) > MAX_MEMORY:
                return False
            self._tags[number] = replace(tag, memory=memory)
            return True

    def drop(self, position: Vector) -> RfidTag | None:
        """Leave a new tag with an empty memory at a place; None if the world holds too many."""
        with self._tags_lock:
            if len(self._tags) >= MAX_TAGS or self._next_tag > MAX_TAG_ID:
                return None
            tag = RfidTag(self._take_number(), position)
            self._tags[tag.id] = tag
            return tag

    def _number(self, victim: Victim) -> int | None:
        tag = traits_of(victim).tag
        if tag is False:
            return None
        return self._take_number() if tag is True else int(tag)

    def _take_number(self) -> int:
        self._next_tag += 1
        return self._next_tag - 1


def beginnings(noise: Noise, after: float, until: float) -> list[float]:
    """Times (s) in (after, until] at which a noise begins."""
    if noise.period == 0.0:
        return [noise.delay] if after < noise.delay <= until else []
    first = max(0, math.floor((after - noise.delay) / noise.period) + 1)
    last = math.floor((until - noise.delay) / noise.period)
    return [noise.delay + noise.period * turn for turn in range(first, last + 1)]


def _nobody(snapshot: Snapshot) -> Sequence[Passer]:
    return ()


def _fixed(position: Vector) -> Callable[[float], Vector]:
    return lambda time: position


def _groups(model: mujoco.MjModel) -> dict[tuple[str, str], list[tuple[int, Vector]]]:
    """Bodies and places in them of all geoms, by part and side, in the order of the geoms."""
    groups: dict[tuple[str, str], list[tuple[int, Vector]]] = {}
    for geom in range(model.ngeom):
        name = model.geom(geom).name
        found = part_of(name)
        assert found is not None
        side = next((side for side in ("Left", "Right") if name.endswith(side)), "")
        x, y, z = model.geom_pos[geom].tolist()
        groups.setdefault((found[1], side), []).append((int(model.geom_bodyid[geom]), (x, y, z)))
    return groups
