"""How fast a team can be simulated when nobody asks for real time."""

from __future__ import annotations

from collections.abc import Sequence

from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.procfs import load_between
from usarsim_bench.recording import between, lines, status_samples
from usarsim_bench.robot_files import SCOUT, SCOUT_SENSORS, scouts
from usarsim_bench.server import SERVE, Server
from usarsim_bench.statistics import Sample, real_time_factor
from usarsim_bench.team import SETTLE, gather, load_figures

ROBOTS = 16
SECONDS = 20.0

SPEED_AIM = Aim(">=", 6.0)


def slowest(recorded: Sequence[Sequence[Sample]]) -> float:
    """Simulated seconds per wall second of the robot that had the lowest.

    Args:
        recorded: arrival and simulated time of every STA line, of each robot.

    Raises:
        BenchError: if a robot hardly said anything.
    """
    try:
        return min(real_time_factor(samples) for samples in recorded)
    except ValueError as error:
        raise BenchError(f"too few STA lines: {error}") from None


def measure_lockstep(plan: Plan) -> Section:
    """A team at `--speed max`; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"lockstep: {robots} robots as fast as can be for {seconds:g} s")
    with (
        scouts() as classes,
        Server(plan.world, robots, (*SERVE, *classes, "--speed", "max")) as server,
        Crowd(server.port, plan.seed) as crowd,
    ):
        gather(crowd, robots, (SCOUT,))
        crowd.run(SETTLE)
        before = server.usage()
        start, stop = crowd.run(seconds)
        load = load_between(before, server.usage())
        told = [
            [line for line in lines(one.chunks) if line[0] >= start] for one in crowd.controllers
        ]
        factor = slowest(
            [between(status_samples(one.chunks), start, stop) for one in crowd.controllers]
        )
    sent = sum(map(len, told)) / (stop - start)
    return Section(
        "lockstep",
        "As fast as it can",
        f"{robots} {DEFAULT_CLASS} with {SCOUT_SENSORS} each in {plan.world} with --speed max: the "
        "world waits for every robot's thread, not for the clock. Random DRIVE commands at 2 Hz of "
        f"wall time each; clients in another process on the same cores read all lines, "
        f"{seconds:g} s.",
        (
            Figure("Simulated seconds per second", factor, "", 2, SPEED_AIM),
            Figure("Lines sent", sent, "1/s", 0),
            Figure("Processor use of the server", load.process, "cores", 2),
            *load_figures(load),
        ),
    )
