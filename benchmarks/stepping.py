"""What the server's own work costs on top of MuJoCo's: steps per second of the same scene.

Three rates are taken in one process, on one thread, in turns, with the same robots driving:

* **engine**: `Engine.advance`, that is MuJoCo's two half steps with wheel servos, contact
  compensation and the check for divergence, in batches as long as those of a running server;
* **mujoco**: the part of it that is spent inside `mj_step1` and `mj_step2`, taken on a twin of the
  engine that goes through the very same states in two halves: bare MuJoCo with the same contacts;
* **bare**: a loop of `mj_step` and nothing else, the wheels driven by MuJoCo's own velocity
  actuators. Every repetition starts in the engine's state but then goes its own way: without
  compensation robots that turn hop, are in the air much of the time, and so cost MuJoCo less.

Rates are steps per second of processor time, so that other programs disturb them little.
`measure` runs in a process that does nothing else.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import product
from statistics import mean, median
from typing import Any
from unittest import mock

import mujoco
import numpy as np

from benchmarks.apart import run_apart
from benchmarks.plan import Plan
from usarsim_bench.figures import Aim, Figure, Section
from usarsim_server.robots.catalog import load_catalog
from usarsim_server.robots.description import RobotDescription
from usarsim_server.simulation.clock import BATCH_STEPS
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import PhysicsOptions
from usarsim_server.simulation.placement import Placement
from usarsim_server.testing import robot_model
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.loader import find_world, load_world
from usarsim_server.worlds.scene import build_scene

ROBOT_CLASS = "P3AT"
BARE_GAIN = 100.0
"""N m s/rad of the wheels of bare robots: MuJoCo's own velocity actuators let a robot run ahead of
its wheels if they are much stiffer (see `simulation/servos.py`)."""
CHUNK_STEPS = 25
"""Steps between two looks at the clock and between two commands: about a tenth of a second."""
REPETITION_CHUNKS = 5
WARM_UP_CHUNKS = 10
COMMAND_CHANCE = 0.2
"""Of each robot to get a new command between two chunks: two a second."""
HALVES = ("mj_step1", "mj_step2")
_CALIBRATION_CALLS = 1000


@dataclass(frozen=True, slots=True)
class Stepping:
    """One scene."""

    world: str  # the scene
    robots: int
    steps: int  # of each loop, in all
    engine: float  # steps per s of processor time, medians of the repetitions; see the module
    mujoco: float
    bare: float
    contacts: float  # mean number of contacts in the engine
    bare_contacts: float  # the same in the bare loop
    to_mujoco: float  # rate of the engine over that of MuJoCo's part, median of the repetitions
    to_bare: float  # the same over the bare loop


@dataclass(frozen=True, slots=True)
class _Turn:
    """One repetition: processor seconds of each loop, contacts per step."""

    engine: float
    mujoco: float
    bare: float
    contacts: float
    bare_contacts: float


def measure(world: str, robots: int, seconds: float, seed: int = 0) -> Stepping:
    """Take the three rates on one scene.

    Args:
        world: name or folder.
        robots: number of P3AT driving around.
        seconds: simulated time that each loop is measured for; rounded to whole repetitions of
            about half a second.
        seed: of the commands.

    Raises:
        WorldError: if the world cannot be used.
        RuntimeError: if the twin engines part, which would make the rates incomparable.
    """
    scene = _Scene(load_world(find_world(world)), robots, seed)
    for _ in range(WARM_UP_CHUNKS):
        scene.command()
        scene.advance()
    steps = REPETITION_CHUNKS * CHUNK_STEPS
    turns = [scene.turn() for _ in range(max(1, round(seconds / (steps * scene.timestep))))]
    return Stepping(
        world=world,
        robots=robots,
        steps=steps * len(turns),
        engine=median(steps / turn.engine for turn in turns),
        mujoco=median(steps / turn.mujoco for turn in turns),
        bare=median(steps / turn.bare for turn in turns),
        contacts=mean(turn.contacts for turn in turns),
        bare_contacts=mean(turn.bare_contacts for turn in turns),
        to_mujoco=median(turn.mujoco / turn.engine for turn in turns),
        to_bare=median(turn.bare / turn.engine for turn in turns),
    )


class Stopwatch:
    """Adds up the processor time that functions take, less what taking the time takes.

    Attributes:
        calls: number of calls timed so far.
    """

    def __init__(self) -> None:
        self.calls = 0
        self._seconds = 0.0
        self._overhead = 0.0
        nothing = self.timed(lambda: None)
        for _ in range(_CALIBRATION_CALLS):
            nothing()
        self._overhead = self._seconds / self.calls
        self.reset()

    @property
    def seconds(self) -> float:
        """Processor time of all calls since the last reset."""
        return self._seconds - self.calls * self._overhead

    def reset(self) -> None:
        """Start again at zero."""
        self.calls, self._seconds = 0, 0.0

    def timed(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """The same function, with its time added up."""

        def wrapper(*arguments: Any, **named: Any) -> Any:
            start = time.thread_time()
            result = function(*arguments, **named)
            self._seconds += time.thread_time() - start
            self.calls += 1
            return result

        return wrapper


@contextmanager
def calls_timed(watch: Stopwatch, names: Sequence[str]) -> Iterator[None]:
    """While inside, functions of MuJoCo are timed, whoever in this process calls them."""
    with ExitStack() as stack:
        for name in names:
            timed = watch.timed(getattr(mujoco, name))
            stack.enter_context(mock.patch.object(mujoco, name, timed))
        yield


class _Scene:
    """Two equal engines that go through the same states, and the bare loop's model and data."""

    def __init__(self, world: WorldDescription, robots: int, seed: int) -> None:
        description = load_catalog(()).find(ROBOT_CLASS)
        assert description is not None  # shipped
        self._top_speed = description.drive.max_wheel_speed
        self._left = np.array([wheel.side == "left" for wheel in description.driven_wheels])
        self._dice = np.random.default_rng(seed)
        self._robots = range(robots)
        self._engine = _engine(world, description, robots)
        self._twin = _engine(world, description, robots)
        self._twin.parts.native = None  # in two halves, which give the same
        self._watch = Stopwatch()
        self._plain = with_velocity_actuators(self._engine, BARE_GAIN)
        self._bare = mujoco.MjData(self._plain)
        self._turns = 0
        for robot in self._robots:
            self._drive(robot)

    @property
    def timestep(self) -> float:
        """Simulated s per step."""
        return self._engine.timestep

    def command(self) -> None:
        """Give some robots new random wheel speeds, in all loops."""
        for robot in self._robots:
            if self._dice.random() < COMMAND_CHANCE:
                self._drive(robot)

    def _drive(self, robot: int) -> None:
        left, right = self._dice.uniform(-self._top_speed, self._top_speed, 2)
        targets = np.where(self._left, left, right)
        self._engine.drive(robot, targets)
        self._twin.drive(robot, targets)
        self._bare.ctrl[self._engine.world.layouts[robot].wheel_actuators] = targets

    def turn(self) -> _Turn:
        """One repetition of all loops; they take turns in going first."""
        ctrl = self._bare.ctrl.copy()
        mujoco.mj_copyData(self._bare, self._engine.world.model, self._engine.data)
        self._bare.ctrl[:] = ctrl
        engine = inside = bare = contacts = bare_contacts = 0.0
        self._turns += 1
        for _ in range(REPETITION_CHUNKS):
            self.command()
            if self._turns % 2:
                bare += self._step_bare()
            seconds, seconds_inside = self.advance()
            if not self._turns % 2:
                bare += self._step_bare()
            engine += seconds
            inside += seconds_inside
            contacts += self._engine.data.ncon / REPETITION_CHUNKS
            bare_contacts += self._bare.ncon / REPETITION_CHUNKS
        return _Turn(engine, inside, bare, contacts, bare_contacts)

    def advance(self) -> tuple[float, float]:
        """Run both engines for a chunk.

        Returns:
            Processor seconds of the engine, and of MuJoCo's part of it, taken on the twin.

        Raises:
            RuntimeError: if they do not end in the same state, or MuJoCo's part was not found.
        """
        seconds = _timed(lambda: _advance(self._engine))
        self._watch.reset()
        with calls_timed(self._watch, HALVES):
            _advance(self._twin)
        if self._watch.calls != len(HALVES) * CHUNK_STEPS:
            raise RuntimeError("the engine does not step by two halves")
        if not np.array_equal(self._engine.data.qpos, self._twin.data.qpos):
            raise RuntimeError("the twin engines parted")
        return seconds, self._watch.seconds

    def _step_bare(self) -> float:
        model, data = self._plain, self._bare

        def steps() -> None:
            for _ in range(CHUNK_STEPS):
                mujoco.mj_step(model, data)

        return _timed(steps)


def _engine(world: WorldDescription, description: RobotDescription, robots: int) -> Engine:
    """An engine with robots on the world's start poses, in turn, or as near as there is room."""
    model = robot_model(description)
    engine = Engine(lambda: build_scene(world), PhysicsOptions(), [model] * robots)
    placement = Placement(engine.world, world.lower, world.upper)
    for robot in range(robots):
        wanted = world.starts[robot % len(world.starts)].pose
        engine.occupy(robot, robot, placement.find(engine.snapshot(), robot, wanted))
    return engine


def with_velocity_actuators(engine: Engine, gain: float) -> mujoco.MjModel:
    """The engine's model with the wheels driven as plain MuJoCo does it, gain in N m s/rad."""
    model = engine.world.model.__copy__()
    for layout in engine.world.layouts:
        model.dof_frictionloss[layout.wheel_dof] = 0.0
        model.actuator_gainprm[layout.wheel_actuators, 0] = gain
        model.actuator_biasprm[layout.wheel_actuators, :3] = (0.0, 0.0, -gain)
    return model


def _timed(work: Callable[[], None]) -> float:
    start = time.thread_time()
    work()
    return time.thread_time() - start


def _advance(engine: Engine) -> None:
    for _ in range(CHUNK_STEPS // BATCH_STEPS):
        engine.advance(BATCH_STEPS)


ROBOTS = (1, 4, 16)
SECONDS = 10.0
BARE_WORLD = "empty"
"""Measured besides the world asked for: a floor and nothing else."""

RATIO_AIM = Aim(">=", 0.8)


def measure_stepping(plan: Plan) -> Section:
    """Rates of the step loop; `plan.seconds` of simulated time for each loop on each scene."""
    sizes = plan.sizes(ROBOTS, max(ROBOTS))
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    for world, robots in product(dict.fromkeys((BARE_WORLD, plan.world)), sizes):
        plan.say(f"stepping: {robots} robots in {world}")
        figures += _figures(run_apart(measure, world, robots, seconds, plan.seed))
    return Section(
        "stepping",
        "The step loop against MuJoCo alone",
        f"P3AT driving around, {seconds:g} simulated s for each loop on each scene, the loops in "
        "turns on one thread, rates in steps per s of processor time. Engine: the server's loop, "
        "with wheel servos and contact compensation. Bare: mj_step and nothing else, on the same "
        "model with MuJoCo's own wheel servos. MuJoCo's part: mj_step1 and mj_step2 inside the "
        "engine's own run.",
        tuple(figures),
    )


def _figures(scene: Stepping) -> list[Figure]:
    place = f"{scene.world}, {scene.robots} robot{'s' if scene.robots != 1 else ''}"
    return [
        Figure(f"{place}: engine / bare mj_step", scene.to_bare, "", 2, RATIO_AIM),
        Figure(f"{place}: engine / MuJoCo's part of it", scene.to_mujoco),
        Figure(f"{place}: engine", scene.engine, "steps/s", 0),
        Figure(f"{place}: bare mj_step", scene.bare, "steps/s", 0),
        Figure(f"{place}: MuJoCo's part", scene.mujoco, "steps/s", 0),
        Figure(f"{place}: contacts, engine", scene.contacts, "", 1),
        Figure(f"{place}: contacts, bare mj_step", scene.bare_contacts, "", 1),
    ]
