"""A four-wheeled test robot, small sceneries and listeners for the tests of this room.

The robot has the size and weight of the real P3AT of robots reference 4.1: chassis 9 kg, four
ellipsoid wheels of 0.75 kg and radius 0.11 m, half wheel base 0.1331 m, half track 0.197 m.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import PhysicsOptions, RobotModel
from usarsim_server.simulation.simulation import Simulation, SimulationOptions
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.testing import eventually

RADIUS = 0.11
HALF_BASE = 0.1331
HALF_TRACK = 0.197
WHEELS = ("front_left", "rear_left", "front_right", "rear_right")

Scenery = Callable[[], mujoco.MjSpec]
Geom = mujoco.mjtGeom


def build_robot(
    torque: float = 6.0, gain: float = 200.0, center_of_mass: float = 0.04, damping: float = 0.0
) -> mujoco.MjSpec:
    """The test robot; its reference point is level with the wheel axles.

    Args:
        torque: N m per wheel; 0 for no limit.
        gain: N m s/rad of the wheel servos.
        center_of_mass: height of the chassis over the axles, m.
        damping: N m s/rad of the wheel bearings; negative ones drive the wheel on.
    """
    spec = mujoco.MjSpec()
    base = spec.worldbody.add_body(name="base")
    base.add_freejoint(name="free")
    base.add_geom(
        name="chassis",
        type=Geom.mjGEOM_BOX,
        size=[0.2, 0.14, 0.06],
        pos=[0.0, 0.0, center_of_mass],
        mass=9.0,
        friction=[0.5, 0.005, 0.0001],
    )
    for name in WHEELS:
        x = HALF_BASE if name.startswith("front") else -HALF_BASE
        y = HALF_TRACK if name.endswith("left") else -HALF_TRACK
        wheel = base.add_body(name=name, pos=[x, y, 0.0])
        wheel.add_joint(name=name, axis=[0.0, 1.0, 0.0], armature=0.01, damping=damping)
        wheel.add_geom(
            type=Geom.mjGEOM_ELLIPSOID,
            size=[RADIUS, 0.04, RADIUS],
            mass=0.75,
            friction=[1.0, 0.005, 0.0001],
        )
        motor = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.set_to_velocity(kv=gain)
        if torque:
            motor.forcelimited = True
            motor.forcerange = [-torque, torque]
    return spec


def robot_model(key: str = "P3AT_real", brake_delay: float = 0.3, **body: float) -> RobotModel:
    """The test robot as the simulation wants it; `body` as for `build_robot`."""
    return RobotModel(
        key=key,
        build=lambda: build_robot(**body),
        driven=WHEELS,
        rest_height=RADIUS,
        wheel_acceleration=10.0,
        brake_delay=brake_delay,
    )


ROBOT = robot_model()
ROGUE = robot_model("rogue", damping=-2.0, torque=0.1)
"""A robot whose wheel bearings push: once moved it tears itself apart."""


def turn(speed: float) -> NDArray[np.float64]:
    """Wheel speeds (rad/s) for turning in place to the left."""
    return np.array([-speed, -speed, speed, speed])


def straight(speed: float) -> NDArray[np.float64]:
    """Wheel speeds (rad/s) for going straight."""
    return np.full(4, speed)


def floor(friction: float = 1.0, slope: float = 0.0) -> Scenery:
    """An endless floor, rising with x by an angle (rad)."""

    def build() -> mujoco.MjSpec:
        spec = mujoco.MjSpec()
        spec.worldbody.add_geom(
            name="floor",
            type=Geom.mjGEOM_PLANE,
            size=[0.0, 0.0, 1.0],
            friction=[friction, 0.005, 0.0001],
            quat=[np.cos(slope / 2), 0.0, -np.sin(slope / 2), 0.0],
        )
        return spec

    return build


def add_box(
    spec: mujoco.MjSpec, name: str, center: tuple[float, ...], half: tuple[float, ...]
) -> mujoco.MjsGeom:
    """A fixed box, m."""
    return spec.worldbody.add_geom(name=name, type=Geom.mjGEOM_BOX, pos=center, size=half)


def add_crate(
    spec: mujoco.MjSpec, name: str, center: tuple[float, ...], half: float = 0.15, mass: float = 2.0
) -> None:
    """A cube that can be pushed about."""
    body = spec.worldbody.add_body(name=name, pos=center)
    body.add_freejoint()
    body.add_geom(type=Geom.mjGEOM_BOX, size=[half] * 3, mass=mass)


Piece = Callable[[mujoco.MjSpec], object]


def box(name: str, center: tuple[float, ...], half: tuple[float, ...]) -> Piece:
    """As `add_box`, for `furnished`."""
    return lambda spec: add_box(spec, name, center, half)


def crate(name: str, center: tuple[float, ...], half: float = 0.15, mass: float = 2.0) -> Piece:
    """As `add_crate`, for `furnished`."""
    return lambda spec: add_crate(spec, name, center, half, mass)


def furnished(*pieces: Piece) -> Scenery:
    """An endless floor with things on it."""

    def build() -> mujoco.MjSpec:
        spec = floor()()
        for piece in pieces:
            piece(spec)
        return spec

    return build


def populated(scenery: Scenery | None = None, **options: object) -> tuple[Simulation, int]:
    """A simulation in lockstep and the number of a robot at its origin."""
    world = simulation(scenery, **options)  # type: ignore[arg-type]
    return world, world.spawn(ROBOT, pose_at(0.0, 0.0))[0]


def in_parallel(action: Callable[..., object], *arguments: object) -> None:
    """Do something in a thread for each argument, all at once, and wait for all."""
    threads = [threading.Thread(target=action, args=(one,)) for one in arguments]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def yard() -> mujoco.MjSpec:
    """Floor, a wall across x = 3 m, two crates and a door on hinges."""
    spec = floor()()
    add_box(spec, "wall", (3.0, 0.0, 0.5), (0.1, 4.0, 0.5))
    add_crate(spec, "crate0", (0.0, -3.0, 0.15))
    add_crate(spec, "crate1", (2.0, -3.0, 0.15))
    door = spec.worldbody.add_body(name="door", pos=(-3.0, 0.0, 0.6))
    door.add_joint(name="hinge", axis=[0.0, 0.0, 1.0], damping=2.0)
    door.add_geom(type=Geom.mjGEOM_BOX, size=[0.02, 0.4, 0.5], pos=[0.0, 0.4, 0.0], mass=5.0)
    return spec


def engine_with(
    *poses: tuple[float, ...],
    scenery: Scenery | None = None,
    model: RobotModel = ROBOT,
    spare: int = 0,
    **options: float | bool,
) -> Engine:
    """An engine with one robot per (x, y[, z[, yaw]]), numbered from 0, at rest on the floor."""
    engine = Engine(scenery or floor(), PhysicsOptions(**options), [model] * (len(poses) + spare))
    for number, place in enumerate(poses):
        engine.occupy(number, number, pose_at(*place))
    return engine


def pose_at(x: float, y: float, z: float = RADIUS, yaw: float = 0.0) -> Pose:
    """A level pose in the simulation frame."""
    return Pose((x, y, z), (float(np.cos(yaw / 2)), 0.0, 0.0, float(np.sin(yaw / 2))))


def run(engine: Engine, seconds: float) -> list[int]:
    """Advance an engine two steps at a time and return the robots that were lost."""
    lost = []
    for _ in range(round(seconds / engine.timestep / 2)):
        lost += engine.advance(2)
    return lost


def drive(engine: Engine, targets: NDArray[np.float64], seconds: float, robot: int = 0) -> None:
    """Drive a robot with wheel speeds (rad/s) for some time."""
    engine.drive(robot, targets)
    run(engine, seconds)


def base_qpos(engine: Engine, robot: int) -> NDArray[np.float64]:
    """Free-joint coordinates (7,) of a robot."""
    start = engine.world.layouts[engine.active[robot]].qpos
    return engine.data.qpos[start : start + 7].copy()


def base_qvel(engine: Engine, robot: int) -> NDArray[np.float64]:
    """Free-joint velocities (6,) of a robot."""
    start = engine.world.layouts[engine.active[robot]].dof
    return engine.data.qvel[start : start + 6].copy()


def whole_state(engine: Engine, robot: int) -> NDArray[np.float64]:
    """All coordinates and velocities of a robot in one array."""
    layout = engine.world.layouts[engine.active[robot]]
    data = engine.data
    return np.concatenate(
        [
            base_qpos(engine, robot),
            data.qpos[list(layout.joint_qpos.values())],
            base_qvel(engine, robot),
            data.qvel[list(layout.joint_dof.values())],
        ]
    )


def simulation(
    scenery: Scenery | None = None, *, timestep: float = 0.004, **options: object
) -> Simulation:
    """A simulation in lockstep unless `speed` says otherwise."""
    merged: dict[str, object] = {"speed": float("inf"), **options}
    return Simulation(
        scenery or floor(),
        SimulationOptions(physics=PhysicsOptions(timestep=timestep), **merged),  # type: ignore[arg-type]
    )


class Watcher:
    """A listener that is woken at a fixed period and deals with a snapshot at once.

    Attributes:
        snapshots: all it got, in order.
        reasons: why its robot was lost; empty while it is there.
    """

    def __init__(self, period: float, first: float = 0.0) -> None:
        self._period = period
        self.due = first
        self.snapshots: list[Snapshot] = []
        self.reasons: list[str] = []

    def wake(self, snapshot: Snapshot) -> None:
        """Keep the snapshot and ask for the next one."""
        assert not self.reasons, "woken after its robot was lost"
        self.snapshots.append(snapshot)
        self.due += self._period

    def settled(self) -> bool:
        """When it is idle."""
        return self.idle()

    def idle(self) -> bool:
        """Always: nothing is left undone."""
        return True

    @property
    def oldest(self) -> float:
        """No snapshot is left."""
        return math.inf

    @property
    def horizon(self) -> float:
        """The world need not wait."""
        return math.inf

    def overdue(self) -> None:
        """Never."""
        raise AssertionError

    def lost(self, reason: str) -> None:
        """Keep the reason."""
        self.reasons.append(reason)
        self.due = float("inf")


def watched(world: Simulation, robot: int, period: float, first: float = 0.0) -> Watcher:
    """A listener of a robot."""
    watcher = Watcher(period, first)
    world.body(robot).attach(watcher)
    return watcher


class SlowWatcher(Watcher):
    """A listener with a thread and a mailbox, as robot handlers have.

    Args:
        period: s between the snapshots it wants.
        work: wall seconds that it takes to deal with one.
        attention: called when it is done with one.
    """

    def __init__(self, period: float, work: float, attention: Callable[[], None]) -> None:
        super().__init__(period)
        self._work, self._attention = work, attention
        self._mail = threading.Condition()
        self._letters: deque[Snapshot] = deque()
        self._stopping = False
        self.done: list[Snapshot] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def wake(self, snapshot: Snapshot) -> None:
        """Put the snapshot into the mailbox."""
        with self._mail:
            super().wake(snapshot)
            self.due = snapshot.time + self._period
            self._letters.append(snapshot)
            self._mail.notify()

    @property
    def oldest(self) -> float:
        """The time of the one that is being worked on, or is next."""
        with self._mail:
            return self._letters[0].time if self._letters else math.inf

    def idle(self) -> bool:
        """Whether the mailbox is empty and nothing is being worked on."""
        with self._mail:
            return not self._letters

    def stop(self) -> None:
        """End the thread."""
        with self._mail:
            self._stopping = True
            self._mail.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._mail:
                while not self._letters and not self._stopping:
                    self._mail.wait()
                if self._stopping:
                    return
                snapshot = self._letters[0]
            time.sleep(self._work)
            self.done.append(snapshot)
            with self._mail:
                self._letters.popleft()
            self._attention()


Start = Callable[..., Simulation]


def wait_until(condition: Callable[[], bool]) -> None:
    """Poll until something is true."""
    assert eventually(condition)
