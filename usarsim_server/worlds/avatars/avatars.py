"""Everybody who walks about: classes become bodies, bodies get names."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from usarsim_server.base.errors import SpawnError
from usarsim_server.protocol.values import name_key
from usarsim_server.simulation.frames import Pose, Vector, around, rpy_from_quaternion
from usarsim_server.simulation.movers import Way
from usarsim_server.simulation.simulation import BodyHandle, Simulation
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.worlds.avatars.bodies import ADULT, CHEST, HEAD, AvatarClass, avatar_model
from usarsim_server.worlds.avatars.walk import Performance, Stance, Walk, body_poses
from usarsim_server.worlds.avatars.ways import ground_below
from usarsim_server.worlds.labels import Labels
from usarsim_server.worlds.surroundings import Passer

RINGS = (0.0, 0.4, 0.8, 1.2, 1.8)
"""m: radii searched around a place that is taken."""
DIRECTIONS = 8
ABOVE = 2.5
"""m above a place from where the ground is looked for if it is not below."""


@dataclass(frozen=True, slots=True, eq=False)
class Avatar:
    """One person in the world."""

    name: str  # unique among avatars; from INIT, or invented
    kind: AvatarClass  # the class
    handle: BodyHandle  # its body in the simulation
    begin: Stance  # how it stands at first

    @property
    def body(self) -> int:
        """Its number in the simulation."""
        return self.handle.number

    def state(self, snapshot: Snapshot) -> RobotBody | None:
        """Its state in a snapshot; None if it is not in there."""
        return self.handle.state(snapshot)

    def perform(self, plan: Callable[[float], Walk]) -> Walk:
        """Walk a walk from now on, which is made given the present time (s), at once.

        Raises:
            KeyError: if it is not in the world any more.
        """
        chosen: list[Walk] = []

        def ways(time: float, pose: Pose) -> list[Way]:
            walk = plan(time)
            chosen.append(walk)
            if not walk.legs:
                return []  # all bodies stay where they are
            performance = Performance(walk, self.kind.height)
            return [_way(performance, number) for number in range(len(performance.poses(time)))]

        self.handle.follow(ways)
        return chosen[0]


class Avatars:
    """All avatars of one world; may be used by any thread."""

    def __init__(self, classes: Mapping[str, AvatarClass], simulation: Simulation) -> None:
        """Start without anybody; `classes` are by all their names in lower case."""
        self._classes = classes
        self._simulation = simulation
        self._lock = threading.Lock()
        self._avatars: dict[str, Avatar] = {}
        self._labels = Labels("avatars")

    @property
    def names(self) -> list[str]:
        """Names of all classes."""
        return [kind.name for kind in self._classes.values()]

    def find_class(self, name: str) -> AvatarClass | None:
        """The class that a client means, without package; None if there is none."""
        return self._classes.get(name.strip().lower())

    def present(self, snapshot: Snapshot | None = None) -> list[tuple[Avatar, Pose]]:
        """All avatars in the order of coming, with their poses in a snapshot or, if None, now."""
        with self._lock:
            avatars = tuple(self._avatars.values())
        snapshot = snapshot or self._simulation.look()
        states = ((one, one.state(snapshot)) for one in avatars)
        return [(one, state.pose) for one, state in states if state is not None]

    def passers(self, snapshot: Snapshot) -> list[Passer]:
        """Everybody in a snapshot, in the order of their coming, as sensors notice them."""
        found = []
        for one, pose in self.present(snapshot):
            scale = one.kind.height / ADULT
            chest, head = (pose @ Pose((0.0, 0.0, scale * rise)) for rise in (CHEST, HEAD))
            found.append(Passer(one.body, chest.position, head.position))
        return found

    def label(self, body: int) -> str | None:
        """Name of the avatar with a number in the simulation; None if it is none of them."""
        with self._lock:
            return next((one.name for one in self._avatars.values() if one.body == body), None)

    def spawn(
        self, kind: AvatarClass, name: str | None, pose: Pose, exact_name: bool = False
    ) -> Avatar:
        """Put a person into the world, upright on the ground at a place or near it.

        Args:
            kind: its class.
            name: wanted label; cleaned and made unique, invented if None.
            pose: where.
            exact_name: no other name will do.

        Raises:
            SpawnError: if the name cannot be had, or there is no room or no ground.
        """
        with self._lock:
            label = self._labels.take(name, kind.name, exact_name)
        try:
            body, stance = self._settle(kind, pose)
        except BaseException:
            with self._lock:
                self._labels.give_back(label)
            raise
        avatar = Avatar(label, kind, self._simulation.body(body), stance)
        with self._lock:
            self._avatars[name_key(label)] = avatar
        return avatar

    def ways_home(self) -> list[tuple[str, Callable[[], bool]]]:
        """Names of all avatars, and what puts each back to where it came in; that raises
        `SpawnError` if something is in the way."""

        def way(one: Avatar) -> Callable[[], bool]:
            def go() -> bool:
                self._simulation.move(one.body, body_poses(one.begin, one.kind.height)[0])
                return True

            return go

        with self._lock:
            return [(one.name, way(one)) for one in self._avatars.values()]

    def remove(self, avatar: Avatar) -> None:
        """Take a person out of the world; a second call does nothing."""
        with self._lock:
            if self._avatars.pop(name_key(avatar.name), None) is None:
                return
            self._labels.give_back(avatar.name)
        self._simulation.remove(avatar.body)

    def _settle(self, kind: AvatarClass, pose: Pose) -> tuple[int, Stance]:
        if not all(map(math.isfinite, pose.position)):
            raise SpawnError("the pose is not finite")
        yaw = rpy_from_quaternion(pose.quaternion)[2]
        refusal = SpawnError("there is no ground below")
        for place in around(pose.position, RINGS, DIRECTIONS):
            ground = self._ground(place)
            if ground is None:
                continue
            stance = Stance(ground, yaw)
            try:
                body, _ = self._simulation.spawn(
                    avatar_model(kind), body_poses(stance, kind.height)[0]
                )
            except SpawnError as error:
                refusal = error
                continue
            return body, stance
        raise refusal

    def _ground(self, place: Vector) -> Vector | None:
        x, y, z = place
        for start in (z, z + ABOVE):
            (height,) = ground_below(self._simulation, [(x, y, start)])
            if math.isfinite(height):
                return x, y, height
        return None


def _way(performance: Performance, number: int) -> Way:
    return lambda time: performance.poses(time)[number]
