"""How evenly a periodic stream arrives, and how evenly the simulation sends it."""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.procfs import load_between
from usarsim_bench.recording import between, sensor_samples
from usarsim_bench.robot_files import LASER_NAME, LASER_PERIOD, SCOUT, SCOUT_SENSORS, scouts
from usarsim_bench.server import SERVE, Server
from usarsim_bench.statistics import Sample, percentile, period_errors
from usarsim_bench.swarm import TOGETHER
from usarsim_bench.team import SETTLE, gather, load_figures

ROBOTS = 24
SECONDS = 60.0

TAIL_AIM = Aim("<", 5.0)
EXACT_AIM = Aim("<=", 0.001)
"""ms: simulated times are multiples of the time step, told to a tenth of a millisecond."""


def measure_jitter(plan: Plan) -> Section:
    """Scans of a team at real time; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"jitter: {robots} robots for {seconds:g} s")
    with (
        scouts() as classes,
        Server(plan.world, robots, (*SERVE, *classes)) as server,
        Crowd(server.port, plan.seed) as crowd,
    ):
        gather(crowd, robots, (SCOUT,), TOGETHER)
        crowd.run(SETTLE)
        before = server.usage()
        start, stop = crowd.run(seconds)
        load = load_between(before, server.usage())
        recorded = [
            between(sensor_samples(one.chunks, LASER_NAME), start, stop)
            for one in crowd.controllers
        ]
    return Section(
        "jitter",
        "Evenness of a periodic stream",
        f"{robots} {DEFAULT_CLASS} with {SCOUT_SENSORS} each in {plan.world}, random DRIVE "
        f"commands at 2 Hz each, {seconds:g} s; the time between two scans of a robot, as its "
        f"client in another process receives them, against {1e3 * LASER_PERIOD:g} ms.",
        (*jitter_figures(recorded), *load_figures(load)),
    )


def jitter_figures(recorded: Sequence[Sequence[Sample]]) -> list[Figure]:
    """What became of the periods of every robot's stream.

    Args:
        recorded: arrival and simulated time of every line, of each robot.

    Raises:
        BenchError: if a robot sent fewer than two.
    """
    if not recorded or min(map(len, recorded)) < 2:
        raise BenchError(f"a robot sent fewer than two lines of {LASER_NAME}")
    wall = [period_errors([moment for moment, _ in one], LASER_PERIOD) for one in recorded]
    simulated = [period_errors([time for _, time in one], LASER_PERIOD) for one in recorded]
    pooled = [error for one in wall for error in one]
    name = "Error of a period"
    return [
        Figure(f"{name}, 99th percentile", 1e3 * percentile(pooled, 99.0), "ms", 2, TAIL_AIM),
        Figure(f"{name}, median", 1e3 * median(pooled), "ms", 2),
        Figure(f"{name}, longest", 1e3 * max(pooled), "ms", 2),
        Figure(
            f"{name}, 99th percentile of the worst robot",
            1e3 * max(percentile(one, 99.0) for one in wall),
            "ms",
            2,
        ),
        Figure(
            f"{name} in simulated time, longest",
            1e3 * max(max(one) for one in simulated),
            "ms",
            3,
            EXACT_AIM,
        ),
        Figure("Periods measured", len(pooled), "", 0),
    ]
