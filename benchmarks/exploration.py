"""What a step of exploration on the grid costs, and where the time goes.

Teams of the frontier strategy start at the base of a shipped environment. Each case runs in a
process of its own, after a few steps that compile what is to be compiled; times are processor
times. The plain case does without compiled kernels, and must know the same in the end.
"""

from __future__ import annotations

import hashlib
import os
import resource
from dataclasses import dataclass

from benchmarks.apart import run_apart
from benchmarks.plan import Plan
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms

STEPS = 300
WARM_UP = 3
PHASES = ("plan", "sense", "communicate")


@dataclass(frozen=True, slots=True)
class Case:
    """A team in an environment.

    Attributes:
        name: for people. world, robots: which. aim: of a step, ms. plain: without compiled kernels.
    """

    name: str
    world: str
    robots: int
    aim: float
    plain: bool = False


CASES = (
    Case("4 robots, 505 x 304", "hall", 4, 11.6),
    Case("4 robots, 505 x 304, plain", "hall", 4, 60.0, plain=True),
    Case("8 robots, 200 x 150", "lab", 8, 1.0),
    Case("16 robots, 800 x 600", "campus", 16, 150.0),
    Case("64 robots, 800 x 600", "campus", 64, 150.0),
)
MEMORY_ROBOTS = 16
MEMORY_AIM = 300.0
"""MiB of the whole process with so many robots."""


@dataclass(frozen=True, slots=True)
class Cost:
    """What a case took.

    Attributes:
        steps: made. step: mean processor s of one. phases: of that, by `PHASES`.
        memory: most that the process had, bytes. knows: digest of all maps at the end.
    """

    steps: int
    step: float
    phases: tuple[float, ...]
    memory: int
    knows: str


def measure(case: Case, steps: int) -> Cost:
    """Run a case for so many steps, or until all are at home."""
    if case.plain:
        os.environ["USARSIM_EXPLORATION_PLAIN"] = "1"
    # only now: which kernels there are is settled at the first import
    from usarsim_exploration.cycle import Cycle, Member, set_up
    from usarsim_exploration.radio.families.ranges import Circle
    from usarsim_exploration.strategies.frontier import FrontierStrategy
    from usarsim_exploration.timing import Watch
    from usarsim_exploration.worlds import find

    world = find(case.world)
    team = [Member("base", "base", world.base, reach=0)]
    for number in range(case.robots):
        start = world.starts[number % len(world.starts)]
        team.append(Member(f"r{number + 1}", "explorer", start))

    def begin() -> Cycle:
        return set_up(world.environment, team, FrontierStrategy(), Circle(), 1)

    warm = begin()
    for _ in range(WARM_UP):
        warm.advance()
    cycle, watch = begin(), Watch()
    cycle.begin = watch.begin
    watch.begin("record")
    while cycle.step < steps and not all(
        body.home and body.view.cell == body.view.base for body in cycle.bodies[1:]
    ):
        cycle.advance()
    watch.begin("record")
    spent = watch.processor()
    phases = tuple(spent[phase] / cycle.step for phase in PHASES)
    knows = hashlib.sha256()
    for body in cycle.bodies:
        knows.update(body.view.known.bits.tobytes())
    memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return Cost(cycle.step, sum(phases), phases, memory, knows.hexdigest())


def measure_explore(plan: Plan) -> Section:
    """Cost of a step, by size of team and environment; `plan.seconds` x 10 steps for each."""
    steps = STEPS if plan.seconds is None else max(round(10 * plan.seconds), 1)
    figures, rows, known = list[Figure](), list[tuple[str, ...]](), dict[tuple[str, int], str]()
    for case in CASES[: 3 if plan.brief else None]:
        plan.say(f"explore: {case.name}")
        cost = run_apart(measure, case, steps)
        if known.setdefault((case.world, case.robots), cost.knows) != cost.knows:
            raise BenchError(f"{case.name}: plain and compiled kernels came to different maps")
        figures.append(in_ms(f"a step, {case.name}", cost.step, aim=Aim("<=", case.aim)))
        if case.robots == MEMORY_ROBOTS:
            size = cost.memory / 2**20
            figures.append(
                Figure(f"memory, {case.name}", size, "MiB", 0, Aim("<=", MEMORY_AIM)),
            )
        shares = (f"{1e3 * part:.2f}" for part in cost.phases)
        rows.append((case.name, str(cost.steps), f"{1 / cost.step:,.0f}", *shares))
    return Section(
        "explore",
        "Exploration on the grid",
        f"Teams of the frontier strategy, 3 cells a step, scanner of 100 cells, radio of 200, from "
        f"the start for {steps} steps or until all are back; processor time of one thread.",
        tuple(figures),
        table=(
            ("case", "steps", "steps per s", *(f"{phase}, ms a step" for phase in PHASES)),
            *rows,
        ),
    )
