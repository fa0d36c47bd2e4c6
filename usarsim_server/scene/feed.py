"""The scene feed: what is there and where, as the frames of the scene port, made once for all.

While somebody looks, one thread asks the physics for snapshots, as cameras do. Of each it makes an
`Instant`, an immutable set of frames that everybody who looks shares: the newest is all there is,
so nothing waits for who reads slowly. While nobody looks there is no thread and no snapshot.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.errors import UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.protocol.scene import MOST_RATE, Frames, Instant, message, pose_frame
from usarsim_server.scene.primitives import Described, Primitives
from usarsim_server.sessions.robots import Robots
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.avatars.avatars import Avatars
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.objects.objects import WorldObjects

STILL = 1.0
"""s of wall time after which a world that stands still is told of again."""
KINDS_KEPT = 512
"""Kinds of things that are kept described beside those that are present."""

_log = Log("scene")


class WorldSource(Protocol):
    """What the feed needs of the simulation."""

    def look(self) -> Snapshot:
        """A picture of this very moment."""

    def compiled(self, snapshot: Snapshot) -> CompiledWorld:
        """The model that a snapshot belongs to."""


@dataclass(frozen=True, slots=True)
class Identity:
    """Who somebody in a slot is."""

    what: str  # robot, object or avatar
    name: str
    class_name: str


Identities = Callable[[Snapshot], Mapping[int, Identity]]
"""Everybody that there is, by number in the simulation; must return at once."""


@dataclass(frozen=True, slots=True)
class _Crowd:
    """Who is there, and where their bodies are in a model."""

    seats: object  # the model, and who is in which of its slots
    known: Mapping[int, Identity]  # somebody who has just come may be missing
    marks: Mapping[int, frozenset[str]]  # what is true of whom, such as `lit`
    generation: int
    needed: tuple[str, ...]
    present: bytes
    bodies: NDArray[np.intp]


@dataclass(slots=True, eq=False)
class _Watch:
    """From `start` to `stop`: `called` wakes the thread."""

    called: threading.Event = field(default_factory=threading.Event)
    ended: bool = False


class SceneFeed:
    """Makes instants while somebody looks."""

    def __init__(
        self,
        simulation: WorldSource,
        description: WorldDescription,
        census: Identities,
        marks: Callable[[int], frozenset[str]],
        pace: Callable[[], float],
    ) -> None:
        """Stand still until `start`.

        Args:
            simulation: the world.
            description: what its scene is made from.
            census: see `Census`; called by the thread.
            marks: what is true of somebody, by number: `lit` for a headlight that is on, `stuck`;
                likewise.
            pace: which part of the rate may be used now; called by the thread.
        """
        self._simulation = simulation
        self._description = description
        self._census, self._marks = census, marks
        self._pace = pace
        self._rate = MOST_RATE
        self._watch: _Watch | None = None
        self._working = threading.Lock()  # held by the one thread that works
        self._primitives: Primitives | None = None
        self._generation: int | None = None
        self._moving: list[int] = []
        self._scene: Frames = ()
        self._kinds: dict[str, Frames] = {}
        self._crowd: _Crowd | None = None
        self.looks = 0
        """Snapshots asked for so far; for measurements."""

    def start(self, on_news: Callable[[Instant], None], on_end: Callable[[], None]) -> None:
        """Begin to look.

        Args:
            on_news: told of every instant, by the thread; must return at once.
            on_end: told, by the thread, if the world has ended.
        """
        self.stop()
        self._watch = watch = _Watch()
        arguments = watch, on_news, on_end
        threading.Thread(target=self._run, args=arguments, name="scene", daemon=True).start()

    def stop(self) -> None:
        """Look away; returns at once, a second call does nothing."""
        if self._watch is not None:
            self._watch.ended = True
            self._watch.called.set()
            self._watch = None

    def set_rate(self, rate: float) -> None:
        """Make so many instants per s of wall time at most, from now on."""
        self._rate = rate
        if self._watch is not None:
            self._watch.called.set()

    # -- the thread --------------------------------------------------------------------------

    def _run(
        self,
        watch: _Watch,
        on_news: Callable[[Instant], None],
        on_end: Callable[[], None],
    ) -> None:
        try:
            with self._working:
                self._look(watch, on_news)
        except UsarsimError as error:
            _log.debug("the scene feed ends", reason=error)  # the physics has ended
            on_end()
        except Exception as error:
            _log.exception("the scene feed died", error)
            on_end()

    def _look(self, watch: _Watch, on_news: Callable[[Instant], None]) -> None:
        told: tuple[float, int] | None = None
        spoken = due = time.monotonic()
        while not watch.ended:
            snapshot = self._simulation.look()
            self.looks += 1
            now = time.monotonic()
            instant = self.instant(snapshot)
            news = snapshot.time, instant.generation
            del snapshot
            if news != told or now - spoken >= STILL:
                told, spoken = news, now
                on_news(instant)
            due = max(due + 1.0 / (self._rate * self._pace()), now)
            if watch.called.wait(due - now):
                watch.called.clear()
                due = time.monotonic()
        self._primitives = None  # lets go of a model that may be out of use soon
        self._generation = None

    def instant(self, snapshot: Snapshot) -> Instant:
        """What is to be told of a snapshot; for one thread at a time."""
        crowd = self._crowd_of(snapshot)
        chosen = crowd.bodies
        poses = np.concatenate([snapshot.xpos[chosen], snapshot.xquat[chosen]], axis=1)
        frame = pose_frame(snapshot.time, crowd.generation, poses.astype(np.float32))
        return Instant(
            self._scene, self._kinds, crowd.needed, crowd.generation, crowd.present, frame
        )

    def _crowd_of(self, snapshot: Snapshot) -> _Crowd:
        former, layouts = self._crowd, snapshot.layouts
        seats = snapshot.generation, tuple((n, one.slot) for n, one in layouts.items())
        if former is not None and former.seats == seats and len(former.known) == len(layouts):
            known = former.known
        else:
            everybody = self._census(snapshot)
            known = {number: everybody[number] for number in layouts if number in everybody}
        marks = {number: self._marks(number) for number in known}
        now = seats, known, marks
        if former is not None and (former.seats, former.known, former.marks) == now:
            return former
        primitives = self._model(snapshot)
        things: list[dict[str, object]] = []
        bodies = list(self._moving)
        kinds: dict[str, None] = {}
        world = self._simulation.compiled(snapshot)
        for number, one in known.items():
            slot = layouts[number].slot
            kind = world.slots[slot].key
            self._learn(kind, primitives, slot)
            kinds[kind] = None
            thing = {"id": number, "what": one.what, "name": one.name, "class": one.class_name}
            thing |= {"kind": kind, "first": len(bodies)}
            things.append(thing | dict.fromkeys(sorted(marks[number]), True))
            bodies += primitives.bodies(slot)
        generation = 0 if former is None else former.generation + 1
        present = message(
            {
                "type": "present",
                "generation": generation,
                "time": round(snapshot.time, 6),
                "count": len(bodies),
                "things": things,
            }
        )
        chosen = np.array(bodies, dtype=np.intp)
        self._forget(kinds)
        self._crowd = _Crowd(seats, known, marks, generation, tuple(kinds), present, chosen)
        return self._crowd

    def _model(self, snapshot: Snapshot) -> Primitives:
        """The model of a snapshot; the scenery is described once."""
        if self._primitives is None or self._generation != snapshot.generation:
            self._primitives = Primitives(self._simulation.compiled(snapshot))
            self._generation = snapshot.generation
            self._moving = self._primitives.moving()
        if not self._scene:
            self._scene = _frames("", self._primitives.scene(self._description))
        return self._primitives

    def _learn(self, kind: str, primitives: Primitives, slot: int) -> None:
        if kind not in self._kinds:
            # A new table each time: others are reading the old one.
            self._kinds = {**self._kinds, kind: _frames(kind, primitives.kind(slot))}

    def _forget(self, needed: Mapping[str, object]) -> None:
        """Let go of the oldest kinds that nobody is of, when there are many."""
        idle = [kind for kind in self._kinds if kind not in needed]
        doomed = set(idle[: max(0, len(idle) - KINDS_KEPT)])
        if doomed:
            self._kinds = {one: self._kinds[one] for one in self._kinds if one not in doomed}


def _frames(name: str, described: Described) -> Frames:
    assets = tuple((one, message(fields)) for one, fields in described.assets.items())
    return (*assets, (name, message(described.message)))


class Census:
    """Everybody by number in the simulation; may be called by any thread, returns at once."""

    def __init__(self, robots: Robots, avatars: Avatars, objects: WorldObjects) -> None:
        """Know where everybody is to be found."""
        self._robots, self._avatars, self._objects = robots, avatars, objects

    def __call__(self, snapshot: Snapshot) -> dict[int, Identity]:
        """Robots, avatars and objects of clients, those of the snapshot at least."""
        found = {
            one.robot: Identity("robot", one.name, one.description.name)
            for one in self._robots.vehicles
        }
        for avatar, _ in self._avatars.present(snapshot):
            found[avatar.body] = Identity("avatar", avatar.name, avatar.kind.name)
        for thing, _ in self._objects.present(snapshot):
            found[thing.body] = Identity("object", thing.name, thing.kind.name)
        return found
