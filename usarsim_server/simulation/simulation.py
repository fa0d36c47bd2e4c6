"""The simulation as the rest of the server uses it: spawn, drive, look, from any thread.

One thread owns the physics. Everybody else posts requests, which are carried out between steps,
and reads immutable snapshots. Time is simulated time: paced to the wall clock at a factor, or as
fast as possible in lockstep, where the world waits until everyone who wanted a snapshot has dealt
with it, so that equal commands at equal times give equal runs.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.logs import Log
from usarsim_server.simulation.articulation import JointOrder
from usarsim_server.simulation.clock import ClockOptions, Listener, Stepper, Witness
from usarsim_server.simulation.divergence import SPEED_LIMIT
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose, Vector
from usarsim_server.simulation.machines import Machine
from usarsim_server.simulation.mailbox import Mailbox
from usarsim_server.simulation.model import (
    CompiledWorld,
    PhysicsOptions,
    RobotModel,
    check_mujoco_version,
)
from usarsim_server.simulation.movers import Mover, Way
from usarsim_server.simulation.objects import ObjectFacts
from usarsim_server.simulation.rays.cast import cast, cast_all, cast_scenery
from usarsim_server.simulation.rays.query import PendingReport, RayFan, RayHits, SceneryHit
from usarsim_server.simulation.rays.scenery import StaticGeometry
from usarsim_server.simulation.slots import SlotLimits, Slots, always, compiled
from usarsim_server.simulation.snapshot import RobotBody, Snapshot
from usarsim_server.simulation.splice import FixedPart
from usarsim_server.simulation.touching import Touches, TouchWatch

_log = Log("simulation")


@dataclass(frozen=True, slots=True)
class SimulationOptions:
    """How a world is run."""

    physics: PhysicsOptions = field(default_factory=PhysicsOptions)  # settings of the physics
    speed: float = 1.0  # simulated seconds per wall second; infinity for as fast as possible
    patience: float = math.inf
    """Wall s for which the world waits at a listener's horizon; infinity for ever."""
    max_robots: int = 16  # most robots at a time
    max_things: int = 256  # most things at a time that were put into the world and are no robots
    lower: Vector = (-1000.0, -1000.0, -50.0)  # corners of the box that robots may be in, m
    upper: Vector = (1000.0, 1000.0, 200.0)


class Simulation:
    """A running world."""

    def __init__(
        self,
        scenery: Callable[[], mujoco.MjSpec],
        options: SimulationOptions,
        fixed: FixedPart | None = None,
    ) -> None:
        """Compile a world; it does not run yet.

        Args:
            scenery: makes a fresh specification of the world without robots.
            options: how it is run.
            fixed: geoms of the world that are not in this specification.
        """
        check_mujoco_version()
        mujoco.set_mju_user_warning(_log_warning)
        self._options = options
        self._engine = Engine(scenery, options.physics, fixed=fixed)
        self._static = StaticGeometry(self._engine.world)
        self._mail = Mailbox()
        self._slots = Slots(
            self._engine,
            self._mail,
            SlotLimits(
                *(options.max_robots, options.max_things, options.lower, options.upper),
                at_once=math.isinf(options.speed),
            ),
        )
        self._stepper = Stepper(
            self._engine,
            self._mail,
            lambda: self._slots.busy,
            ClockOptions(options.speed, options.patience, options.lower[2]),
        )
        self._slots.adopted = self._stepper.renew
        self._touching: TouchWatch | None = None

    # -- looking -----------------------------------------------------------------------------

    @property
    def snapshot(self) -> Snapshot:
        """The newest published snapshot."""
        return self._stepper.snapshot

    def look(self) -> Snapshot:
        """A picture of this very moment; blocks until the physics is between two steps."""
        return self._mail.ask(self._engine.snapshot)

    @property
    def now(self) -> float:
        """Simulated s that have passed; any thread, at once, without a picture of the world."""
        return self._engine.time

    @property
    def timestep(self) -> float:
        """Simulated seconds per physics step."""
        return self._options.physics.timestep

    @property
    def speed(self) -> float:
        """Simulated seconds per wall second asked for; infinity in lockstep."""
        return self._stepper.speed

    def moment(self, simulated: float) -> float:
        """See `Stepper.moment`."""
        return self._stepper.moment(simulated)

    @property
    def paused(self) -> bool:
        """Whether time stands still because somebody has said so, see `pause`."""
        return self._stepper.stands

    def pause(self) -> None:
        """Let time stand still from now on; orders are taken, and take effect when it goes on."""
        self._mail.ask(lambda: self._stepper.go_until(self._engine.time))

    def go_on(self, seconds: float = math.inf) -> None:
        """Let time go on, for so many simulated s; then it stands still."""
        self._mail.ask(lambda: self._stepper.go_until(self._engine.time + seconds))

    @contextmanager
    def standing(self) -> Iterator[None]:
        """Time stands still inside, and then goes on as it would have gone."""
        before = self._mail.ask(self._stepper.hold)
        try:
            yield
        finally:
            self._mail.ask(lambda: self._stepper.go_until(before))

    def restart_scene(self) -> None:
        """Put the scene back to how it was when the world began."""
        self._mail.ask(self._engine.restart)

    def set_speed(self, speed: float) -> None:
        """Go at another pace, simulated s per wall s.

        Raises:
            ValueError: if the world goes at none.
        """
        self._mail.ask(lambda: self._stepper.set_speed(speed))

    def compiled(self, snapshot: Snapshot) -> CompiledWorld:
        """The model that a snapshot belongs to, for who wants to draw it; not to be written to."""
        return compiled(snapshot)

    def body(self, number: int) -> BodyHandle:
        """The handle of a robot or another thing, by its number; made once by whoever keeps it."""
        return BodyHandle(number, self)

    def cast(self, fans: Sequence[RayFan], snapshot: Snapshot, robot: int | None) -> list[RayHits]:
        """Answer ray fans against the world of a snapshot; the robot's own body is left out."""
        return cast(fans, snapshot, robot, self._static, self._slots.geometry(snapshot))

    def cast_all(self, reports: Sequence[PendingReport]) -> list[list[RayHits]]:
        """Answer the rays of many reports, at least one, about the same instant, as one batch."""
        return cast_all(reports, self._static, self._slots.geometry(reports[0].snapshot))

    def cast_scenery(self, fans: Sequence[RayFan]) -> list[RayHits]:
        """Answer ray fans against the part of the world that never moves."""
        return cast_scenery(fans, self._static)

    def first_sceneries(
        self,
        origins: NDArray[np.float64],
        directions: NDArray[np.float64],
        reaches: NDArray[np.float64],
    ) -> list[SceneryHit | None]:
        """What rays from (n, 3) m along unit vectors (n, 3) meet first that never moves, each
        within its reach (n,), m; None: nothing."""
        return self._static.first_hits(origins, directions, reaches)

    def object_facts(self, name: str | int, snapshot: Snapshot) -> ObjectFacts | None:
        """Facts at a snapshot about the object that a ray's name belongs to (see `objects.py`)."""
        return self._slots.geometry(snapshot).objects.facts(name, snapshot)

    # -- robots ------------------------------------------------------------------------------

    def spawn(
        self, model: RobotModel, pose: Pose, wanted: Callable[[], bool] = always
    ) -> tuple[int, Pose]:
        """Put a robot or another thing into the world; blocks until it is there.

        Args:
            model: its class.
            pose: wanted pose of the reference point; a robot gets the nearest free one, a thing
                this one or none.
            wanted: asked when its turn has come; others before it may have taken long.

        Returns:
            Its number and the pose it really got.

        Raises:
            SpawnError: if the world is full, the pose cannot be used, or nobody wants it any more.
        """
        return self._slots.spawn(model, pose, wanted)

    def move(self, number: int, pose: Pose) -> Pose:
        """Move a robot or a thing, at rest, as if it were spawned there; the pose it really got.

        Raises:
            SpawnError: if it is not in the world or the pose cannot be used.
        """
        return self._slots.move(number, pose)

    def reseat(self, number: int, model: RobotModel) -> None:
        """Give a thing another body at the same pose, for example one that forces move.

        Raises:
            SpawnError: if it is not in the world.
        """
        self._slots.reseat(number, model)

    def remove(self, number: int) -> None:
        """Take a robot or a thing out of the world soon; unknown ones are ignored."""
        self._mail.post(lambda: self._stepper.remove(number))

    # -- bodies that go their own way --------------------------------------------------------

    def set_movers(self, movers: Sequence[Mover], machines: Sequence[Machine] = ()) -> None:
        """Replace everything that places mocap bodies of the world (see `movers.py`).

        Raises:
            ValueError: if a body cannot be moved.
        """
        self._mail.ask(lambda: self._engine.set_movers(movers, machines))

    def run_belts(self, tag: str, factor: float) -> int:
        """Let conveyors run at so many times their speed in the scene; how many there are."""
        return self._mail.ask(lambda: self._engine.run_belts(tag, factor))

    # -- listeners ---------------------------------------------------------------------------

    def be_watched(self, by: Witness | None, solid: Callable[[str], bool] = bool) -> None:
        """Have somebody who is nothing in the world see it at the times that he chooses; from now
        on it is noted what touches what, for `touches`. Returns at once.

        Args:
            by: see `Stepper.be_seen_by`; instead of who was there before; None: nobody any more.
            solid: see `TouchWatch`.
        """

        def begin() -> None:
            self._touching = None if by is None else TouchWatch(self._engine, solid)
            self._engine.after_step = () if self._touching is None else (self._touching.note,)
            self._stepper.be_seen_by(by)

        self._mail.post(begin)

    def touches(self) -> Touches:
        """What touched what since the last call. Physics thread, as in `Listener.wake`."""
        return {} if self._touching is None else self._touching.take()

    def wake_batched(self, batched: Callable[[], AbstractContextManager[object]]) -> None:
        """Have all listeners that are due at one instant woken inside a context manager."""
        self._stepper.batched = batched

    def attention(self) -> None:
        """Tell the physics that a listener became idle or changed its due time or horizon."""
        self._mail.notify()

    # -- running -----------------------------------------------------------------------------

    @property
    def failure(self) -> Exception | None:
        """Why the physics thread had to give up, None if it did not."""
        return self._stepper.failure

    def start(self, on_failure: Callable[[], None] | None = None) -> None:
        """Start the physics thread; it calls `on_failure` if it has to give up, see `failure`."""
        self._stepper.start(on_failure)

    def stop(self) -> None:
        """Stop the physics thread and wait for it."""
        self._stepper.stop()
        self._slots.close()

    def run_until(self, moment: float) -> None:
        """Advance in the calling thread, in lockstep, to a simulated time (tests, benchmarks).

        Must not be mixed with `start`.
        """
        self._stepper.run_until(moment)

    def settle(self) -> None:
        """Carry out requests in the calling thread until every listener is idle (tests)."""
        self._stepper.settle()


class BodyHandle:
    """One robot or another thing of a world, for any thread.

    Orders are queued for the physics, which carries them out before its next step, in the order
    in which they were given; a body that has left the world takes none.

    Attributes:
        number: its number in the simulation.
        last_drive: what its driven wheels were told last, rad/s; empty before.
    """

    def __init__(self, number: int, simulation: Simulation) -> None:
        self.last_drive: NDArray[np.float64] = np.zeros(0)
        self.number = number
        self._simulation = simulation
        self._engine = simulation._engine
        self._mail = simulation._mail
        self._stepper = simulation._stepper

    def state(self, snapshot: Snapshot) -> RobotBody | None:
        """Its state in a snapshot; None if it is not in there."""
        layout = snapshot.layouts.get(self.number)
        return None if layout is None else RobotBody(snapshot, layout)

    def look(self) -> RobotBody | None:
        """Its present state, None if it has left; blocks until the physics is between two steps."""
        return self.state(self._simulation.look())

    def cast(self, fans: Sequence[RayFan], snapshot: Snapshot) -> list[RayHits]:
        """Answer ray fans against the world of a snapshot; it does not see itself."""
        return self._simulation.cast(fans, snapshot, self.number)

    def drive(self, targets: NDArray[np.float64]) -> None:
        """Set wheel speed targets (rad/s, driven wheels in part order); NaN lets a wheel roll.

        Raises:
            ValueError: if a target is infinite or beyond all sense.
        """
        if (np.abs(targets) >= SPEED_LIMIT).any():
            raise ValueError(f"wheel speed targets must be finite and sensible: {targets}")
        self.last_drive = targets
        self._mail.post(lambda: self._engine.drive(self.number, targets))

    def command_joints(self, orders: Mapping[str, JointOrder]) -> None:
        """Give orders to joints that are no wheels, by name in any case.

        Values beyond what a joint can do are taken for the limit; unknown joints are ignored.

        Raises:
            ValueError: if a value is not finite.
        """
        if not all(math.isfinite(order.value) for order in orders.values()):
            raise ValueError(f"orders must be finite: {orders}")
        taken = dict(orders)
        self._mail.post(lambda: self._engine.command_joints(self.number, taken))

    def hold_joints(self) -> None:
        """Have every joint that is no wheel keep the place that it has when the order comes."""
        self._mail.post(lambda: self._engine.hold_joints(self.number))

    def command_law(self, values: NDArray[np.float64]) -> None:
        """Set the command of the laws that its family added to the physics (see `LawModel`).

        Raises:
            ValueError: if a value is not finite.
        """
        if not np.isfinite(values).all():
            raise ValueError(f"a command must be finite: {values}")
        self._mail.post(lambda: self._engine.command_law(self.number, values))

    def operate_hand(self, hand: str, close: bool) -> bool:
        """Close or open a hand; blocks until it is done. Whether it obeyed, see `Hands.operate`."""
        return self._mail.ask(lambda: self._engine.operate_hand(self.number, hand, close))

    def teleport(self, pose: Pose) -> None:
        """Move it to a pose, at rest.

        Raises:
            ValueError: if the pose is not finite.
        """
        if not all(map(math.isfinite, (*pose.position, *pose.quaternion))):
            raise ValueError(f"a pose must be finite: {pose}")

        def move() -> None:
            if self.number in self._engine.active:
                self._engine.teleport(self.number, pose)

        self._mail.post(move)

    def wheel_targets(self) -> NDArray[np.float64]:
        """Commanded wheel speeds (rad/s) as the physics has them; for measurements."""
        return self._mail.ask(lambda: self._engine.wheel_targets(self.number))

    def follow(self, plan: Callable[[float, Pose], Sequence[Way]]) -> None:
        """Let a kinematic thing go its way from now on; blocks until it does.

        Args:
            plan: given the present time (s) and pose, says where its bodies go, the base first;
                no ways at all: it stays where it is. Called by the physics thread between two
                steps; must return at once.

        Raises:
            KeyError: if it is not in the world.
        """

        def set_out() -> None:
            engine = self._engine
            engine.follow(self.number, plan(engine.time, engine.pose(self.number)))

        self._mail.ask(set_out)

    def attach(self, listener: Listener) -> None:
        """Give a listener the snapshots it asks for from now on."""
        self._mail.post(lambda: self._stepper.attach(self.number, listener))


def _log_warning(text: str) -> None:
    _log.warning(" ".join(text.split()), source="mujoco")
