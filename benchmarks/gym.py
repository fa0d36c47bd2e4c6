"""The environments for learning: steps per second beside what they stand on, resets, memory.

Each is driven by random actions, kept for some steps each, in a process of its own; times are
processor times of one thread. The same run tells which part of a step is spent in the level below:
the grid's own step, or the engine of the physics. Bare is a loop of as many `mj_step` as a step
has, on the same model with MuJoCo's own wheel servos, and nothing else.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from statistics import median
from typing import Any
from unittest import mock

import numpy as np
import psutil

from benchmarks.apart import run_apart
from benchmarks.plan import Plan
from benchmarks.stepping import BARE_GAIN, Stopwatch, with_velocity_actuators
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms

STEPS = 100_000
"""Of each environment, with resets (doors reference, DOOR-12)."""
WARM_UP = 0.1
"""Part of the steps after which memory has to stay."""
EPISODE = 200
KEPT = 5
"""Steps for which an action is kept."""
BARE_STEPS = 2000

GRID_AIM, PHYSICS_AIM = 2.0, 6.0
"""ms of a step."""
RATE_AIM = 500.0
"""Steps per s with one P3AT and a range finder (DOOR-11)."""
RESET_AIM, MEMORY_AIM = 50.0, 20.0
"""ms; MB (DOOR-11, DOOR-12)."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What an environment took.

    Attributes:
        step, below: processor s of a step, and of that in the level below. bare: s of the bare
            loop; 0: there is none. first, reset: s until the first observation, median of others.
        growth: MB of memory that came after the first tenth of the steps.
    """

    step: float
    below: float
    bare: float
    first: float
    reset: float
    growth: float


CASES = ("ExploreGrid", "ExploreFrontiers", "ExplorePhysics")


def measure(name: str, steps: int, seed: int) -> Cost:
    """Make so many steps in one of the environments."""
    import gymnasium

    import usarsim_exploration.gym  # noqa: F401 (registers them)
    from usarsim_exploration.cycle import Cycle
    from usarsim_server.simulation.engine import Engine

    begun = time.process_time()
    # without the checks that `make` wraps around it, which are no part of the environment
    made: Any = gymnasium.make(f"usarsim/{name}-v0").unwrapped
    made.reset(seed=seed)
    first = time.process_time() - begun
    random, watch, process = np.random.default_rng(seed), Stopwatch(), psutil.Process()
    level: Any = Engine if name == "ExplorePhysics" else Cycle
    spent, resets, settled = 0.0, list[float](), 0
    with mock.patch.object(level, "advance", watch.timed(level.advance)):
        action: Any = None
        below = 0.0
        for step in range(steps):
            if step % EPISODE == 0:
                begun = time.thread_time()
                made.reset()
                resets.append(time.thread_time() - begun)
            if step == int(WARM_UP * steps):
                settled = process.memory_info().rss
            if step % KEPT == 0:
                action = _action(made, random)
            watch.reset()
            begun = time.thread_time()
            _, _, ended, cut, _ = made.step(action)
            spent += time.thread_time() - begun
            below += watch.seconds
            if ended or cut:
                made.reset()
    growth = (process.memory_info().rss - settled) / 1e6
    bare = _bare(made, random) if name == "ExplorePhysics" else 0.0
    return Cost(spent / steps, below / steps, bare, first, median(resets), growth)


def _action(made: Any, random: np.random.Generator) -> Any:
    if hasattr(made.action_space, "n"):
        return np.int64(random.integers(made.action_space.n))
    return random.uniform((0.0, -1.0), 1.0).astype(np.float32)


def _bare(made: Any, random: np.random.Generator) -> float:
    """Processor s of a loop of as many `mj_step` as a step has."""
    import mujoco

    from usarsim_exploration.gym.rover import TICK

    made.reset()
    made.step(_action(made, random))  # who is told to drive never sleeps
    engine = made.level.stage.engine
    model = with_velocity_actuators(engine, BARE_GAIN)
    data = mujoco.MjData(model)
    mujoco.mj_copyData(data, engine.world.model, engine.data)
    wheels = engine.world.layouts[0].wheel_actuators
    ticks = round(TICK / engine.timestep)
    begun = time.thread_time()
    for step in range(BARE_STEPS):
        if step % KEPT == 0:
            data.ctrl[wheels] = np.tile(random.uniform(-8.0, 8.0, 2), 2)
        for _ in range(ticks):
            mujoco.mj_step(model, data)
    return (time.thread_time() - begun) / BARE_STEPS


def measure_gym(plan: Plan) -> Section:
    """Steps, resets and memory of all; `plan.seconds` x 1,000 steps of each."""
    try:
        import usarsim_exploration.gym
    except ImportError as error:
        raise BenchError(str(error)) from None
    assert usarsim_exploration.gym
    steps = STEPS if plan.seconds is None else max(round(1000 * plan.seconds), EPISODE)
    figures = list[Figure]()
    for name in CASES:
        plan.say(f"gym: {steps} steps of {name}")
        figures += _figures(name, run_apart(measure, name, steps, plan.seed))
    return Section(
        "gym",
        "Environments for learning",
        f"One robot in `lab`, {steps} steps of each with a reset every {EPISODE}, random actions; "
        "processor time of one thread. Below: the part of a step that the grid, or the engine of "
        "the physics, takes. Bare: a loop of mj_step over the same simulated time.",
        tuple(figures),
    )


def _figures(name: str, cost: Cost) -> list[Figure]:
    physics = name == "ExplorePhysics"
    aim = Aim("<=", PHYSICS_AIM if physics else GRID_AIM)
    found = [
        in_ms(f"{name}: a step", cost.step, aim=aim),
        Figure(
            f"{name}: steps per s", 1.0 / cost.step, "1/s", 0,
            Aim(">=", RATE_AIM) if physics else None,
        ),
        in_ms(f"{name}: of a step, below", cost.below),
        in_ms(f"{name}: the first reset, with all that is compiled", cost.first, 0),
        in_ms(f"{name}: a reset", cost.reset, aim=Aim("<=", RESET_AIM)),
        Figure(f"{name}: memory that came", cost.growth, "MB", 1, Aim("<=", MEMORY_AIM)),
    ]  # fmt: skip
    if physics:
        found.insert(3, in_ms(f"{name}: bare mj_step over the same time", cost.bare))
    return found
