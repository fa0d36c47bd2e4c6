"""The objects that world controllers have put into the world.

One instance is shared by all controllers. Changes take a lock, which may be held while a larger
model is compiled; looking takes none.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Unpack

from usarsim_server.base.errors import SpawnError
from usarsim_server.base.logs import Log
from usarsim_server.protocol.values import clean_name, free_name, name_key, near
from usarsim_server.simulation.frames import Pose, Vector, flip_point
from usarsim_server.simulation.model import RobotModel
from usarsim_server.simulation.movers import Way
from usarsim_server.simulation.simulation import Simulation
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.worlds.objects.bodies import (
    LARGEST_RIGID,
    ObjectCatalog,
    ObjectClass,
    object_model,
    object_size,
)
from usarsim_server.worlds.objects.world_object import (
    Creation,
    Fall,
    PathChange,
    Physics,
    Spin,
    WorldObject,
    drop_below,
)

SMALLEST, LARGEST = 0.001, 50.0
"""m: extents that an object may have."""
FASTEST = 20.0
"""m/s along a path; anything faster would jump over what it should push."""
FASTEST_TURN = 50.0
"""rad/s."""
MOST_POINTS = 1000
"""Way points of one path."""
LONGEST_MEMORY = 256
"""Characters of the text that clients keep with an object; every GetSTA tells it."""

_log = Log("objects")


Change = Callable[[WorldObject, float], WorldObject]
"""Makes the object as it shall be from a simulated time on; its `pose` is that of the moment."""


class WorldObjects:
    """All objects of one world, by name."""

    def __init__(
        self, catalog: ObjectCatalog, simulation: Simulation, lower: Vector, upper: Vector
    ) -> None:
        """Start without objects; way points may be in the box from `lower` to `upper` (m)."""
        self._catalog = catalog
        self._simulation = simulation
        self._lower, self._upper = lower, upper
        self._lock = threading.Lock()
        self._objects: dict[str, WorldObject] = {}
        self._homes: dict[int, Pose] = {}  # of the bodies that were created
        self._count = 0

    # -- looking -----------------------------------------------------------------------------

    def present(self, snapshot: Snapshot | None = None) -> list[tuple[WorldObject, Pose]]:
        """All objects in the order of creation, with their poses in a snapshot or, if None, now."""
        snapshot = snapshot or self._simulation.look()
        objects = tuple(self._objects.values())
        states = [self._simulation.body(one.body).state(snapshot) for one in objects]
        pairs = zip(objects, states, strict=True)
        return [(one, state.pose) for one, state in pairs if state is not None]

    def find(self, name: str) -> WorldObject | None:
        """The object of a name, whatever its case; None if there is none."""
        return self._objects.get(name_key(name))

    def label(self, body: int) -> str | None:
        """Name of the object with a number in the simulation; None if it is none of them."""
        objects = tuple(self._objects.values())
        return next((one.name for one in objects if one.body == body), None)

    def number(self, name: str) -> int | None:
        """Number in the simulation of the object of a name; None if there is none."""
        one = self.find(name)
        return None if one is None else one.body

    # -- coming and going --------------------------------------------------------------------

    def create(self, wish: Creation, owner: object) -> WorldObject:
        """Put a new object into the world.

        Raises:
            SpawnError: if the class is unknown, the name taken or too long, the memory too long,
                the size out of range, the place blocked or the world full.
        """
        if len(wish.memory) > LONGEST_MEMORY:
            problem = f"the memory has {len(wish.memory)} characters"
            raise SpawnError(f"{problem}, {LONGEST_MEMORY} are possible")
        kind = self._catalog.find(wish.class_name)
        if kind is None:
            names = [one.name for one in self._catalog.classes]
            raise SpawnError(f"there is no class {wish.class_name!r}{near(wish.class_name, names)}")
        material = None
        if wish.material:
            material = self._catalog.material(wish.material)
            if material is None:
                _log.info("unknown material, the class's own is used", material=wish.material)
        _check_size(object_size(kind, wish.scale), wish.physics)
        with self._lock:
            self._forget_lost()
            name = self._free_name(wish.name, kind)
            rigid = wish.physics is Physics.RIGID
            pose = self._grounded(wish.pose, object_size(kind, wish.scale), wish.physics, None)
            model = object_model(kind, wish.scale, rigid, material)
            body, placed = self._simulation.spawn(model, pose)
            created = WorldObject(
                name=name,
                kind=kind,
                scale=wish.scale,
                material=material,
                physics=wish.physics,
                memory=wish.memory,
                permanent=wish.permanent,
                owner=owner,
                body=body,
                pose=placed,
                placed=not rigid,
            )
            self._keep(created)
            self._homes[body] = placed
            if wish.physics is Physics.FALLING:
                created = self._let_fall(created)
            return created

    def ways_home(self) -> list[tuple[str, Callable[[], bool]]]:
        """Names of all objects, and what puts each back to where it was created, if it is still
        there; that raises `SpawnError` if something is in the way."""

        def way(one: WorldObject, home: Pose) -> Callable[[], bool]:
            return lambda: self.move(one.name, lambda _: home)

        present = tuple(self._objects.values())
        return [
            (one.name, way(one, self._homes[one.body]))
            for one in present
            if one.body in self._homes
        ]

    def kill(self, name: str) -> bool:
        """Remove one object, permanent or not; whether there was one."""
        with self._lock:
            return self._remove([one for one in (self.find(name),) if one is not None]) == 1

    def kill_all(self, box: tuple[Vector, Vector] | None = None) -> int:
        """Remove all objects that are not permanent; how many.

        Args:
            box: corners in the wire frame, in any order; only what is strictly inside goes.
        """
        with self._lock:
            doomed = [
                one
                for one, pose in self.present()
                if not one.permanent and (box is None or _inside(flip_point(pose.position), *box))
            ]
            return self._remove(doomed)

    def leave(self, owner: object) -> int:
        """Remove everything that somebody created; how much."""
        with self._lock:
            return self._remove([one for one in self._objects.values() if one.owner is owner])

    # -- moving ------------------------------------------------------------------------------

    def move(self, name: str, change: Callable[[Pose], Pose]) -> bool:
        """Put an object somewhere else; whether there is one of that name.

        `change` makes the wanted pose from the present one. If it follows a path it goes on to its
        next way point.

        Raises:
            SpawnError: if the place is blocked.
        """
        with self._lock:
            found = self._look(name)
            if found is None:
                return False
            one, pose = found
            wanted = self._grounded(change(pose), one.size, one.physics, one.body)
            placed = self._simulation.move(one.body, wanted)
            self._keep(replace(one, pose=placed, fall=None))
            if one.moves:
                self._steer(replace(one, pose=placed, fall=None), _resettled)
            if one.physics is Physics.FALLING:
                self._let_fall(self._objects[name_key(name)])
            return True

    def rotate(self, name: str, rates: Vector) -> bool:
        """Let an object turn at rates of roll, pitch and yaw (rad/s, wire frame); 0 ends it."""
        limited = _limited(rates, FASTEST_TURN)

        def turn(one: WorldObject, time: float) -> WorldObject:
            spin = Spin.begin(limited, one.pose.quaternion, time) if any(limited) else None
            return replace(one, spin=spin)

        with self._lock:
            one = self.find(name)
            if one is not None and (any(limited) or one.spin is not None):
                self._steer(one, turn)
            return one is not None

    def set_path(self, name: str, **wanted: Unpack[PathChange]) -> bool:
        """Change how an object follows its path; whether there is one."""
        speed = wanted.get("speed")
        if speed is not None:
            wanted["speed"] = min(max(speed, 0.0), FASTEST)

        def adjust(one: WorldObject, time: float) -> WorldObject:
            return replace(one, path=one.path.changed(time, **wanted))

        with self._lock:
            one = self.find(name)
            if one is None:
                return False
            if one.path.points:
                self._steer(one, adjust)
            else:
                self._keep(adjust(one, 0.0))
            return True

    def add_points(self, name: str, points: Sequence[Vector]) -> bool:
        """Append way points (m) to the path of an object; whether there is one.

        Raises:
            SpawnError: if one of them is outside the world, or if there are too many.
        """
        for point in points:
            limits = zip(self._lower, point, self._upper, strict=True)
            if not all(low <= value <= high for low, value, high in limits):
                raise SpawnError(f"the way point {point} is outside the world")

        def extend(one: WorldObject, time: float) -> WorldObject:
            return replace(one, path=one.path.extended(time, one.pose.position, points), fall=None)

        with self._lock:
            one = self.find(name)
            if one is None:
                return False
            if len(one.path.points) + len(points) > MOST_POINTS:
                raise SpawnError(f"a path has at most {MOST_POINTS} way points")
            if points:
                self._steer(one, extend)
            return True

    def clear_path(self, name: str) -> bool:
        """Drop the way points of an object; whether there is one.

        Raises:
            SpawnError: if it shall return to where it came from and cannot.
        """
        with self._lock:
            one = self.find(name)
            if one is None or not one.path.points:
                return one is not None
            home = one.path.home
            one = self._steer(one, lambda now, time: replace(now, path=now.path.cleared()))
        if one.path.reset_on_clear and home is not None:
            self.move(name, lambda pose: Pose(home, pose.quaternion))
        return True

    # -- helpers, under the lock -------------------------------------------------------------

    def _look(self, name: str) -> tuple[WorldObject, Pose] | None:
        self._forget_lost()
        wanted = name_key(name)
        return next((pair for pair in self.present() if name_key(pair[0].name) == wanted), None)

    def _keep(self, one: WorldObject) -> None:
        # A new table each time: others may be reading the old one.
        self._objects = {**self._objects, name_key(one.name): one}

    def _remove(self, doomed: Sequence[WorldObject]) -> int:
        names = {name_key(one.name) for one in doomed}
        self._objects = {name: one for name, one in self._objects.items() if name not in names}
        for one in doomed:
            self._simulation.remove(one.body)
            self._homes.pop(one.body, None)
        return len(doomed)

    def _forget_lost(self) -> None:
        """Objects that fell out of the world or diverged are gone, and their names free."""
        there = {one.body for one, _ in self.present()}
        self._remove([one for one in self._objects.values() if one.body not in there])

    def _free_name(self, wanted: str | None, kind: ObjectClass) -> str:
        """The name that the client asked for, cleaned, or else the class and a number."""
        if wanted and clean_name(wanted):
            try:
                name = free_name(wanted, ())
            except ValueError as error:
                raise SpawnError(str(error)) from None
            if name_key(name) in self._objects:
                raise SpawnError(f"there is already an object {name!r}")
            if name != wanted:
                _log.warning("a client gets another name than it asked for", asked=wanted, got=name)
            return name
        while True:
            self._count += 1
            name = f"{kind.name}_{self._count}"
            if name_key(name) not in self._objects:
                return name

    def _grounded(self, pose: Pose, size: Vector, physics: Physics, body: int | None) -> Pose:
        if physics is not Physics.GROUND:
            return pose
        x, y, z = pose.position
        return Pose((x, y, z - drop_below(self._simulation, pose, size, body)), pose.quaternion)

    def _let_fall(self, one: WorldObject) -> WorldObject:
        drop = drop_below(self._simulation, one.pose, one.size, one.body)
        if drop <= 0.0:
            return one
        return self._steer(one, lambda now, time: replace(now, fall=Fall(drop, time)))

    def _steer(self, one: WorldObject, change: Change) -> WorldObject:
        """Change how an object moves; it gets the body that suits its motion.

        Raises:
            SpawnError: if it is not in the world any more.
        """
        if not one.placed:
            self._simulation.reseat(one.body, _model(one, rigid=False))
        steered = one

        def plan(time: float, pose: Pose) -> list[Way]:
            nonlocal steered
            steered = change(replace(one, pose=pose, placed=True), time)
            if steered.fall is not None and steered.fall is one.fall:
                x, y, z = pose.position  # it goes on falling from where it was let go
                top = Pose((x, y, z + steered.fall.fallen(time)), pose.quaternion)
                steered = replace(steered, pose=top)
            return [steered.way()] if steered.moves else []

        try:
            self._simulation.body(one.body).follow(plan)
        except KeyError:
            self._remove([one])
            raise SpawnError("it has left the world") from None
        if steered.physics is Physics.RIGID and not steered.moves:
            self._simulation.reseat(one.body, _model(one, rigid=True))
            steered = replace(steered, placed=False)
        self._keep(steered)
        return steered


def _model(one: WorldObject, rigid: bool) -> RobotModel:
    return object_model(one.kind, one.scale, rigid, one.material)


def _resettled(one: WorldObject, time: float) -> WorldObject:
    """The object as it goes on after it was put somewhere else."""
    spin = one.spin and Spin.begin(one.spin.rates, one.pose.quaternion, time)
    return replace(one, path=one.path.moved(time, one.pose.position), spin=spin)


def _inside(point: Vector, one: Vector, other: Vector) -> bool:
    return all(min(a, b) < value < max(a, b) for value, a, b in zip(point, one, other, strict=True))


def _limited(rates: Vector, most: float) -> Vector:
    x, y, z = (min(max(rate, -most), most) for rate in rates)
    return x, y, z


def _check_size(size: Vector, physics: Physics) -> None:
    largest = LARGEST_RIGID if physics is Physics.RIGID else LARGEST
    if not all(SMALLEST <= extent <= largest and math.isfinite(extent) for extent in size):
        extents = " x ".join(f"{extent:g}" for extent in size)
        raise SpawnError(f"a size of {extents} m is out of range ({SMALLEST:g} to {largest:g} m)")
