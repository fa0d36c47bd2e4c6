"""Gives out the slots of a world: puts robots and things in, moves them, and compiles for more.

Requests come from any thread, one at a time; whatever touches the live world is asked of the
physics thread. Only when a kind has run out of slots is a larger model compiled, here, in the
thread that asks, while the physics goes on.

Slots that nobody has been in for a while are given back: a smaller model is compiled in a thread of
its own, and dropped if somebody wanted one of these slots meanwhile. When, is a matter of simulated
time and of who came and left. Without pace the world waits for it, so that runs repeat.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakKeyDictionary

from usarsim_server.base.errors import SpawnError, UsarsimError
from usarsim_server.base.logs import Log
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.growth import Growth, shortage, trim
from usarsim_server.simulation.mailbox import Mailbox
from usarsim_server.simulation.model import JOINT_WIDTH, VACANT, CompiledWorld, RobotModel
from usarsim_server.simulation.placement import Fitting, Placement
from usarsim_server.simulation.rays.moving import DynamicGeometry
from usarsim_server.simulation.snapshot import Snapshot

T = TypeVar("T")
Judges = tuple[Placement, Fitting]

_log = Log("simulation")

GROWTH_LIMIT = 8
"""Most slots added by one compilation."""
LOOK_INTERVAL = 5.0
"""s of simulated time between two looks whether there are slots to give back."""
TIDY_LOOKS = 6
"""Looks after a swap at which free pages are given back: cameras, for one, let go late."""
KEPT_FREE = 30.0
"""s of simulated time for which a slot that was left is kept for who comes back."""
LEAST_BODIES = 24
WORTH = 0.2
"""Shrinking is worth it from so many bodies in such slots on, and from such a part of the rest."""
STOP_TIMEOUT = 1.0
"""s of wall time that a model under way gets to be dropped at the end."""


def always() -> bool:
    """Yes: what is asked for is wanted however long it takes."""
    return True


@dataclass(frozen=True, slots=True)
class SlotLimits:
    """How much a world may hold, and where."""

    max_robots: int  # most robots and most other things at a time
    max_things: int
    lower: Vector  # corners of the box that they may be in, m
    upper: Vector
    at_once: bool = False  # the world waits while it shrinks, so that runs repeat


def compiled(snapshot: Snapshot) -> CompiledWorld:
    """The model that a snapshot of the engine belongs to."""
    assert snapshot.world is not None
    return snapshot.world


class Slots:
    """Gives out the slots of a world and makes new ones."""

    def __init__(self, engine: Engine, mail: Mailbox, limits: SlotLimits) -> None:
        self._engine = engine
        self._mail = mail
        self._limits = limits
        # Handlers may still look at snapshots of generations before: these live as long.
        self._dynamic = WeakKeyDictionary({engine.world: DynamicGeometry(engine.world)})
        self._judges = self._judge(engine.world)
        self.adopted: Callable[[], None] = _nothing
        """Called by the physics thread when there is another model."""
        self._next_look = 0
        self._untidy = 0
        self._shrinking: threading.Thread | None = None
        self._closed = False
        self._lock = threading.Lock()
        self._counting = threading.Lock()
        self._waiting = 0
        self._number = 0
        engine.after_batch = self._look

    @property
    def busy(self) -> bool:
        """Whether anybody is being put into the world (lockstep waits for that)."""
        return self._waiting > 0

    def geometry(self, snapshot: Snapshot) -> DynamicGeometry:
        """What moves, in the model generation of a snapshot."""
        return self._dynamic[compiled(snapshot)]

    def spawn(
        self, model: RobotModel, pose: Pose, wanted: Callable[[], bool] = always
    ) -> tuple[int, Pose]:
        """Put a robot or a thing into the world, see `Simulation.spawn`."""
        return self._undisturbed(lambda: self._spawn(model, pose, wanted))

    def move(self, robot: int, pose: Pose) -> Pose:
        """Move a robot or a thing, at rest, see `Simulation.move`."""
        return self._undisturbed(lambda: self._move(robot, pose))

    def reseat(self, robot: int, model: RobotModel) -> None:
        """Give something in the world another body, see `Simulation.reseat`."""
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
        placement, fitting = self._judges
        if model.robot:
            placement.admit(pose, model.rest_height)
        else:
            fitting.admit(pose)
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
        placement, fitting = self._judges
        if model.robot:
            return placement.find(snapshot, slot, pose)
        return fitting.check(snapshot, slot, pose)

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
        stale = self._mail.ask(lambda: self._engine.free_since(KEPT_FREE))
        vacant = [number for number, slot in enumerate(slots) if slot is VACANT]
        taken = sorted({*vacant, *stale, *self._spare(model, count)})[:count]
        started = time.perf_counter()
        changes = dict.fromkeys(stale, VACANT) | dict.fromkeys(taken, model)
        try:
            self._check_memory(model, count)
            growth, dynamic, judges = self._compile([model] * (count - len(taken)), changes)
        except ValueError as error:
            raise SpawnError(f"{model.key} cannot be built: {error}") from error
        self._mail.ask(lambda: self._adopt(growth, dynamic, judges))
        elapsed = 1e3 * (time.perf_counter() - started)
        _log.debug("grown", model=model.key, slots=len(growth.world.slots), ms=round(elapsed, 1))

    def _check_memory(self, model: RobotModel, count: int) -> None:
        """Refuse what there is no memory for; MuJoCo would end the process."""
        joints = model.build().joints
        dofs = sum(JOINT_WIDTH[int(joint.type)][1] for joint in joints)
        missing = shortage(self._engine.world, count * dofs)
        if missing is not None:
            raise SpawnError(f"there is not enough memory for {model.key}: {missing}")

    def _compile(
        self, added: Sequence[RobotModel], changes: Mapping[int, RobotModel]
    ) -> tuple[Growth, DynamicGeometry, Judges]:
        old = self._engine.world
        growth = self._engine.grow(added, changes)
        dynamic = DynamicGeometry(growth.world, self._dynamic[old])
        return growth, dynamic, self._judge(growth.world)

    def _adopt(self, growth: Growth, dynamic: DynamicGeometry, judges: Judges) -> None:
        """Swap the models; physics thread."""
        self._dynamic[growth.world] = dynamic
        self._engine.adopt(growth)
        self._judges = judges
        self._untidy = TIDY_LOOKS
        self.adopted()

    def _spare(self, model: RobotModel, count: int) -> list[int]:
        """Free slots that give way to a new kind, when there are as many things as there may be."""
        slots = self._engine.world.slots
        things = sum(not slot.robot and slot is not VACANT for slot in slots)
        surplus = things + count - self._limits.max_things - GROWTH_LIMIT
        if model.robot or surplus <= 0:
            return []
        taken = set(self._mail.ask(lambda: self._engine.active).values())
        free = [
            number
            for number, slot in enumerate(slots)
            if not slot.robot and slot.key not in (model.key, VACANT.key) and number not in taken
        ]
        return free[: min(surplus, count)]

    def _judge(self, world: CompiledWorld) -> Judges:
        lower, upper = self._limits.lower, self._limits.upper
        return Placement(world, lower, upper), Fitting(world, lower, upper)

    # -- shrinking ---------------------------------------------------------------------------

    def _look(self) -> None:
        """Give slots back if that is worth it; physics thread, after every batch of steps."""
        if self._engine.steps < self._next_look:
            return
        self._next_look = self._engine.steps + round(LOOK_INTERVAL / self._engine.timestep)
        if self._shrinking is not None and self._shrinking.is_alive():
            return
        stale = self._engine.free_since(KEPT_FREE)
        if not (self._untidy > 0 or self._worth(stale)):
            return
        if self._limits.at_once:
            self._tidy_up(stale)
            return
        self._shrinking = threading.Thread(
            target=self._tidy_up, args=(stale,), name="shrinking", daemon=True
        )
        self._shrinking.start()

    def _worth(self, slots: Sequence[int]) -> bool:
        """Whether a model without these slots is worth the work."""
        world = self._engine.world
        bodies = sum(world.weight(slot) for slot in slots)
        return bodies >= max(LEAST_BODIES, WORTH * float(world.model.nbody - bodies))

    def _tidy_up(self, stale: Sequence[int]) -> None:
        """Give back memory that former models took, then slots."""
        if self._untidy > 0:
            self._untidy -= 1
            trim()
        try:
            if self._worth(stale):
                self._shrink(stale)
        except UsarsimError as error:
            _log.debug("not shrunk", reason=error)  # the physics has ended
        except Exception as error:
            _log.exception("the model cannot be made smaller", error)

    def _shrink(self, stale: Sequence[int]) -> None:
        started = time.perf_counter()
        old = self._engine.world
        growth, dynamic, judges = self._compile((), dict.fromkeys(stale, VACANT))

        def adopt() -> bool:
            taken = self._engine.active.values()
            if self._closed or self._engine.world is not old or not set(stale).isdisjoint(taken):
                return False
            self._adopt(growth, dynamic, judges)
            return True

        with self._lock if not self._limits.at_once else nullcontext():
            done = bool(self._mail.ask(adopt))
        elapsed = 1e3 * (time.perf_counter() - started)
        slots = sum(slot is not VACANT for slot in growth.world.slots)
        _log.debug("shrunk" if done else "not shrunk", slots=slots, ms=round(elapsed, 1))

    def close(self) -> None:
        """Wait for a smaller model that is being made; the physics has ended."""
        self._closed = True
        if self._shrinking is not None:
            self._shrinking.join(STOP_TIMEOUT)


def _nothing() -> None:
    """Nobody wants to know."""
