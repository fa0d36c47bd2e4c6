"""Who is in which slot: robots and things come, change their bodies and places, and go.

Requests come from any thread, one at a time; whatever touches the live world is asked of the
physics thread. Only when a kind has run out of slots is a larger model compiled, here, in the
thread that asks, while the physics goes on.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from usarsim_server.errors import SpawnError
from usarsim_server.logs import Log
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.fitting import Fitting
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.mailbox import Mailbox
from usarsim_server.simulation.model import CompiledWorld, RobotModel
from usarsim_server.simulation.moving_geometry import DynamicGeometry
from usarsim_server.simulation.placement import Placement
from usarsim_server.simulation.snapshot import Snapshot

__all__ = ["SlotLimits", "Slots", "always"]

T = TypeVar("T")

_log = Log("simulation")

GROWTH_LIMIT = 8
"""Most slots added by one compilation."""
GENERATIONS_KEPT = 3
"""Former model generations whose snapshots can still be looked at."""


def always() -> bool:
    """Yes: what is asked for is wanted however long it takes."""
    return True


@dataclass(frozen=True, slots=True)
class SlotLimits:
    """How much a world may hold, and where.

    Attributes:
        max_robots, max_things: most robots and most other things at a time.
        lower, upper: corners of the box that they may be in, m.
    """

    max_robots: int
    max_things: int
    lower: Vector
    upper: Vector


class Slots:
    """Gives out the slots of a world and makes new ones."""

    def __init__(self, engine: Engine, mail: Mailbox, limits: SlotLimits) -> None:
        self._engine = engine
        self._mail = mail
        self._limits = limits
        self._dynamic = {0: DynamicGeometry(engine.world)}
        self._worlds = {0: engine.world}
        self._judge(engine.world)
        self._lock = threading.Lock()
        self._counting = threading.Lock()
        self._waiting = 0
        self._number = 0

    @property
    def busy(self) -> bool:
        """Whether anybody is being put into the world (lockstep waits for that)."""
        return self._waiting > 0

    def geometry(self, snapshot: Snapshot) -> DynamicGeometry:
        """What moves, in the model generation of a snapshot."""
        return self._dynamic[snapshot.generation]

    def compiled(self, snapshot: Snapshot) -> CompiledWorld:
        """The model generation of a snapshot."""
        return self._worlds[snapshot.generation]

    def spawn(
        self, model: RobotModel, pose: Pose, wanted: Callable[[], bool] = always
    ) -> tuple[int, Pose]:
        """Put a robot or a thing into the world.

        Args:
            model: its kind.
            pose: wanted pose of the reference point. A robot gets the nearest free one, a thing
                this one or none.
            wanted: asked when its turn has come; others before it may have taken long.

        Returns:
            Its number and the pose it really got.

        Raises:
            SpawnError: if the world is full, the pose cannot be used, or nobody wants it any more.
        """
        return self._undisturbed(lambda: self._spawn(model, pose, wanted))

    def move(self, robot: int, pose: Pose) -> Pose:
        """Move a robot or a thing, at rest, as if it were spawned there; returns the pose it got.

        Raises:
            SpawnError: if it is not in the world or the pose cannot be used.
        """
        return self._undisturbed(lambda: self._move(robot, pose))

    def reseat(self, robot: int, model: RobotModel) -> None:
        """Give something in the world another body at the same pose.

        Raises:
            SpawnError: if it is not in the world.
        """
        self._undisturbed(lambda: self._reseat(robot, model))

    def _undisturbed(self, action: Callable[[], T]) -> T:
        self._count(1)
        try:
            with self._lock:
                return action()
        finally:
            self._count(-1)

    def _count(self, change: int) -> None:
        with self._counting:
            self._waiting += change
        self._mail.notify()

    def _spawn(self, model: RobotModel, pose: Pose, wanted: Callable[[], bool]) -> tuple[int, Pose]:
        if not wanted():
            raise SpawnError("nobody waits for it any more")
        self._check_room(model)
        # Before a slot is made: nonsense must not make the world larger.
        if model.robot:
            self._placement.admit(pose, model.rest_height)
        else:
            self._fitting.admit(pose)
        slot = self._free_slot(model)
        placed = self._place(model, slot, pose)
        robot = self._number
        self._number += 1
        self._mail.ask(lambda: self._engine.occupy(robot, slot, placed))
        return robot, placed

    def _move(self, robot: int, pose: Pose) -> Pose:
        slot = self._slot_of(robot)
        placed = self._place(self._engine.world.slots[slot], slot, pose)
        if not self._mail.ask(lambda: self._engine.teleport(robot, placed)):
            raise SpawnError("it has just left the world")
        return placed

    def _reseat(self, robot: int, model: RobotModel) -> None:
        self._slot_of(robot)
        slot = self._free_slot(model)
        if not self._mail.ask(lambda: self._engine.reseat(robot, slot)):
            raise SpawnError("it has just left the world")

    def _slot_of(self, robot: int) -> int:
        slot = self._mail.ask(lambda: self._engine.active).get(robot)
        if slot is None:
            raise SpawnError("it is not in the world any more")
        return slot

    def _place(self, model: RobotModel, slot: int, pose: Pose) -> Pose:
        snapshot = self._mail.ask(self._engine.snapshot)
        if model.robot:
            return self._placement.find(snapshot, slot, pose)
        return self._fitting.check(snapshot, slot, pose)

    def _check_room(self, model: RobotModel) -> None:
        slots, limits = self._engine.world.slots, self._limits
        active = self._mail.ask(lambda: self._engine.active)
        present = sum(slots[slot].robot is model.robot for slot in active.values())
        if model.robot and present >= limits.max_robots:
            raise SpawnError(f"the world is full ({limits.max_robots} robots; --max-robots)")
        if not model.robot and present >= limits.max_things:
            raise SpawnError(f"the world is full ({limits.max_things} objects; --max-objects)")

    def _free_slot(self, model: RobotModel) -> int:
        slot = self._mail.ask(lambda: self._engine.free_slot(model.key))
        if slot is None:
            self._grow(model)
            slot = self._mail.ask(lambda: self._engine.free_slot(model.key))
        assert slot is not None
        return slot

    # -- growing -----------------------------------------------------------------------------

    def _grow(self, model: RobotModel) -> None:
        """Compile a larger world in this thread while the physics goes on, then swap."""
        slots = self._engine.world.slots
        present = sum(slot.key == model.key for slot in slots)
        most = self._limits.max_robots if model.robot else self._limits.max_things
        count = max(1, min(present, GROWTH_LIMIT, most - present))
        replaced = self._spare(model, count)
        started = time.perf_counter()
        try:
            growth = self._engine.grow(
                [model] * (count - len(replaced)), dict.fromkeys(replaced, model)
            )
        except ValueError as error:
            raise SpawnError(f"{model.key} cannot be built: {error}") from error
        dynamic = DynamicGeometry(growth.world, next(reversed(self._dynamic.values())))

        def adopt() -> None:
            generation = growth.world.generation
            # Handlers may still look at snapshots of the generations before.
            kept = [*self._dynamic.items()][-GENERATIONS_KEPT:]
            self._dynamic = {**dict(kept), generation: dynamic}
            worlds = {number: self._worlds[number] for number, _ in kept}
            self._worlds = {**worlds, generation: growth.world}
            self._engine.adopt(growth)

        self._mail.ask(adopt)
        self._judge(growth.world)
        elapsed = 1e3 * (time.perf_counter() - started)
        _log.debug("grown", model=model.key, slots=len(growth.world.slots), ms=round(elapsed, 1))

    def _spare(self, model: RobotModel, count: int) -> list[int]:
        """Free slots that give way to a new kind, when there are as many things as there may be."""
        slots = self._engine.world.slots
        things = sum(not slot.robot for slot in slots)
        surplus = things + count - self._limits.max_things - GROWTH_LIMIT
        if model.robot or surplus <= 0:
            return []
        taken = set(self._mail.ask(lambda: self._engine.active).values())
        free = [
            number
            for number, slot in enumerate(slots)
            if not slot.robot and slot.key != model.key and number not in taken
        ]
        return free[: min(surplus, count)]

    def _judge(self, world: CompiledWorld) -> None:
        self._placement = Placement(world, self._limits.lower, self._limits.upper)
        self._fitting = Fitting(world, self._limits.lower, self._limits.upper)
