"""What the physics thread of a running server costs beside a bare `mj_step` on the same scene.

`python -m benchmarks.physics FILE serve ...` is `usarsim serve ...` whose physics
thread pauses now and then and steps the scene that it has just reached with `mj_step` and nothing
else: the same model with the wheels driven by MuJoCo's own velocity actuators at the commanded
speeds, many steps in one call. So both sides are measured on one thread of one process, in turns,
while clients drive the robots and read everything. What the thread spends between two pauses is all
of its work: steps, snapshots, waking the robots' threads, requests, keeping time.

Bare robots hop when they turn (see `stepping.py`): they have fewer contacts, but the solver needs
more iterations. Therefore the time inside MuJoCo in the thread's own run is told, too; the two
stopwatches on it cost the thread some microseconds per step, which are not taken off.

When the server ends the file gets a JSON list of turns (`Turn`). Times are processor times, so that
other programs disturb them little.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import mean, median
from unittest import mock

import mujoco

from benchmarks.plan import Plan
from benchmarks.robot_files import SCOUT, SCOUT_SENSORS, scouts
from benchmarks.server import Server
from benchmarks.stepping import (
    BARE_GAIN,
    HALVES,
    Stopwatch,
    calls_timed,
    with_velocity_actuators,
)
from benchmarks.swarm import TOGETHER
from benchmarks.team import SETTLE, gather
from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.figures import Aim, BenchError, Figure, Section
from usarsim_server.cli import main as usarsim
from usarsim_server.protocol.json_text import parse_json
from usarsim_server.simulation.engine import Engine
from usarsim_server.simulation.model import CompiledWorld

SETTLE_STEPS = 50
"""Steps after a pause that do not count: the thread catches up, and the caches are cold."""
COUNTED_STEPS = 125
"""Steps between two looks at the clock: half a second of simulated time."""
WARM_STEPS = 4
BARE_STEPS = 24
"""Steps of a pause, first those that do not count: less than a tenth of a second, which the server
may catch up."""


@dataclass(frozen=True, slots=True)
class Turn:
    """One stretch of the server's work and the pause behind it."""

    moment: float  # of the pause, s, `time.perf_counter`, which all processes of the machine share
    robots: int  # active ones
    thread: float  # processor seconds of the physics thread per step
    server: float  # the same of all threads of the server
    engine: float  # the part of it that was spent in `Engine.advance`
    mujoco: float
    """The part of that that was spent inside MuJoCo's steps and half steps: bare MuJoCo with the
    same contacts, in the very same states, with what is compiled of the server (some
    microseconds); 0 if the engine steps otherwise."""
    bare: float  # processor seconds of a bare step
    contacts: int  # of the scene at the pause


class BareSteps:
    """Bare MuJoCo on the scene of an engine."""

    def __init__(self, gain: float) -> None:
        """Take no scene yet; the gain is that of the wheels' velocity actuators, N m s/rad."""
        self._gain = gain
        self._world: CompiledWorld | None = None
        self._model: mujoco.MjModel | None = None
        self._data: mujoco.MjData | None = None

    def spend(self, engine: Engine) -> float:
        """Processor seconds of a bare step from the present state of an engine, which is between
        two steps and stays as it is."""
        model, data = self._scene(engine)
        mujoco.mj_copyData(data, engine.world.model, engine.data)
        model.tree_sleep_policy[:] = engine.world.model.tree_sleep_policy
        data.ctrl[:] = 0.0
        for robot, slot in engine.active.items():
            data.ctrl[engine.world.layouts[slot].wheel_actuators] = engine.wheel_targets(robot)
        mujoco.mj_step(model, data, nstep=WARM_STEPS)
        begun = time.thread_time()
        mujoco.mj_step(model, data, nstep=BARE_STEPS)
        return (time.thread_time() - begun) / BARE_STEPS

    def _scene(self, engine: Engine) -> tuple[mujoco.MjModel, mujoco.MjData]:
        if self._world is not engine.world or self._model is None or self._data is None:
            self._world = engine.world
            self._model = with_velocity_actuators(engine, self._gain)
            self._data = mujoco.MjData(self._model)
        return self._model, self._data


class Bystander:
    """Watches one engine on its own thread and pauses it for the comparison.

    Attributes:
        turns: so far.
    """

    def __init__(self, bare: Callable[[Engine], float], watch: Stopwatch) -> None:
        """Begin with a stretch that does not count.

        `bare` gives the s of a bare step on the scene of an engine; the watch adds up what is spent
        inside MuJoCo.
        """
        self.turns: list[Turn] = []
        self._bare = bare
        self._watch = watch
        self._steps = -SETTLE_STEPS
        self._begun = 0.0
        self._server_begun = 0.0
        self._inside = 0.0

    def stepped(self, engine: Engine, steps: int, inside: float) -> None:
        """Take note of steps that an engine has just made, and of processor s spent in them."""
        settling = self._steps < 0
        self._steps += steps
        if settling:
            if self._steps >= 0:
                self._watch.reset()
                self._steps, self._inside, self._begun = 0, 0.0, time.thread_time()
                self._server_begun = time.process_time()
            return
        self._inside += inside
        if self._steps < COUNTED_STEPS:
            return
        thread = time.thread_time() - self._begun
        server = time.process_time() - self._server_begun
        mujoco_part = self._watch.seconds if self._watch.calls else 0.0
        self.turns.append(
            Turn(
                moment=time.perf_counter(),
                robots=len(engine.active),
                thread=thread / self._steps,
                server=server / self._steps,
                engine=self._inside / self._steps,
                mujoco=mujoco_part / self._steps,
                bare=self._bare(engine),
                contacts=int(engine.data.ncon),
            )
        )
        self._steps = -SETTLE_STEPS


@contextmanager
def compared() -> Iterator[Bystander]:
    """While inside, the engine that steps in this process is compared with bare MuJoCo."""
    watch = Stopwatch()
    bystander = Bystander(BareSteps(BARE_GAIN).spend, watch)
    original = Engine.advance

    def advance(engine: Engine, steps: int) -> list[int]:
        begun = time.thread_time()
        lost = original(engine, steps)
        bystander.stepped(engine, steps, time.thread_time() - begun)
        return lost

    with mock.patch.object(Engine, "advance", advance), calls_timed(watch, (*HALVES, "mj_step")):
        yield bystander


def main(arguments: Sequence[str]) -> int:
    """Run `usarsim` with all words but the first, the file to write; returns its exit code."""
    file, *rest = arguments
    with compared() as bystander:
        result = usarsim(rest)
    Path(file).write_text(json.dumps([asdict(turn) for turn in bystander.turns]))
    return result


ROBOTS = (1, 4, 16, 64)
SECONDS = 20.0

RATIO_AIM = Aim("<=", 1.10)
FEW_AIM = Aim("<=", 1.25)
"""With fewer than `FEW` robots, where what does not grow with them weighs more."""
FEW = 16
SERVER_AIM = Aim("<=", 1.25)
GROWTH_AIM = Aim("<=", 1.0)


Told = Mapping[str, float]


def within(turns: Sequence[Told], robots: int, start: float, stop: float) -> list[Told]:
    """The turns of a span of wall time in which a whole team was there.

    Raises:
        BenchError: if there are none.
    """
    found = [one for one in turns if start <= one["moment"] <= stop and one["robots"] == robots]
    if not found:
        raise BenchError(f"the physics thread was not compared in {stop - start:.1f} s")
    return found


def measure_physics(plan: Plan) -> Section:
    """Teams at real time; `plan.seconds` of wall time are watched for each size."""
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    bare: dict[int, float] = {}
    for robots in plan.sizes(ROBOTS, max(ROBOTS)):
        plan.say(f"physics: {robots} robots for {seconds:g} s")
        turns = _turns(plan, robots, seconds)
        figures += physics_figures(robots, turns)
        bare[robots] = median(turn["bare"] for turn in turns)
    figures += growth_figures(bare)
    return Section(
        "physics",
        "The physics thread against bare MuJoCo",
        f"{DEFAULT_CLASS} with {SCOUT_SENSORS} each in {plan.world} at real time, random DRIVE "
        f"commands at 2 Hz each, clients in another process, {seconds:g} s for each size. Every "
        "0.7 s the thread pauses and steps the scene that it has reached with mj_step and nothing "
        "else, the wheels driven by MuJoCo's own velocity actuators. MuJoCo's part: inside "
        "mj_step, or its two halves, in the thread's own run, so in the very same states, with "
        "what is compiled of servos and compensation. Server: all "
        "its threads, which answer everything that clients read, between the same moments. "
        "Processor time per step; ratios are medians of these turns.",
        tuple(figures),
    )


def _turns(plan: Plan, robots: int, seconds: float) -> list[Told]:
    with tempfile.TemporaryDirectory() as folder, scouts() as classes:
        file = Path(folder, "turns.json")
        command = ("benchmarks.physics", str(file), "serve")
        with (
            Server(plan.world, robots, *classes, serve=command) as server,
            Crowd(server.port, plan.seed) as crowd,
        ):
            gather(crowd, robots, (SCOUT,), TOGETHER)
            crowd.run(SETTLE)
            start, stop = crowd.run(seconds)
        return within(parse_json(file.read_text()), robots, start, stop)


def physics_figures(robots: int, turns: Sequence[Told]) -> list[Figure]:
    """The figures of one size, from at least one turn."""
    name = f"{robots} robots"
    ratios = [turn["thread"] / turn["bare"] for turn in turns]
    engine = [turn["engine"] / turn["bare"] for turn in turns]
    return [
        Figure(
            f"{name}: physics thread / bare mj_step",
            median(ratios),
            "",
            2,
            RATIO_AIM if robots >= FEW else FEW_AIM,
        ),
        Figure(f"{name}: its step loop alone / bare mj_step", median(engine), "", 2),
        *_to_mujoco(name, turns),
        Figure(
            f"{name}: all of the server / bare mj_step",
            median(turn["server"] / turn["bare"] for turn in turns),
            "",
            2,
            SERVER_AIM,
        ),
        Figure(f"{name}: physics thread", 1e6 * median(t["thread"] for t in turns), "us/step", 0),
        Figure(f"{name}: bare mj_step", 1e6 * median(t["bare"] for t in turns), "us/step", 0),
        Figure(f"{name}: contacts", mean(turn["contacts"] for turn in turns), "", 0),
        Figure(f"{name}: turns", len(turns), "", 0),
    ]


def growth_figures(bare: Mapping[int, float]) -> list[Figure]:
    """What a robot of a large team costs MuJoCo against one alone in the same world.

    Args:
        bare: s of a bare step by team size; without one robot alone there is nothing to tell.
    """
    if 1 not in bare:
        return []
    return [
        Figure(
            f"{robots} robots: bare mj_step / {robots} times that of one robot",
            spent / (robots * bare[1]),
            "",
            2,
            GROWTH_AIM,
        )
        for robots, spent in bare.items()
        if robots > 1
    ]


def _to_mujoco(name: str, turns: Sequence[Told]) -> list[Figure]:
    ratios = [turn["thread"] / turn["mujoco"] for turn in turns if turn["mujoco"] > 0.0]
    if not ratios:
        return []
    return [Figure(f"{name}: physics thread / MuJoCo's part of it", median(ratios), "", 2)]


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
