"""Teams of what labs usually drive: a laser, sonars, odometry and INS on every robot.

Large ones at real time; how evenly the scans of each robot arrive, and how evenly the simulation
sends them; how fast a team can be simulated when nobody asks for real time.
"""

from __future__ import annotations

from collections.abc import Sequence
from statistics import median

from benchmarks.measures import p99, period_errors, sensor_samples
from benchmarks.plan import Plan
from benchmarks.robot_files import LASER_NAME, LASER_PERIOD, SCOUT, SCOUT_SENSORS
from benchmarks.server import load_between
from benchmarks.team import (
    FACTOR_AIM,
    SECONDS,
    SETTLE,
    TeamTrial,
    gather,
    load_figures,
    named,
    served,
    team_figures,
    try_team,
)
from usarsim_bench.crowd import DEFAULT_CLASS
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms
from usarsim_bench.recording import Sample, between, lines, real_time_factor, status_samples
from usarsim_server.base.errors import UsarsimError

ROBOTS = 64
STRETCH = 128
"""A size that is tried, too, without an aim."""
TOGETHER = 8
"""Robots that come at the same time until all are there."""

CORES_AIM = Aim("<=", 1.2)


def measure_swarm(plan: Plan) -> Section:
    """Large teams at real time; `plan.seconds` of wall time are watched for each size."""
    seconds = plan.seconds or SECONDS
    figures: list[Figure] = []
    remarks = ""
    for robots in plan.sizes((ROBOTS, STRETCH), ROBOTS):
        plan.say(f"swarm: {robots} robots for {seconds:g} s")
        try:
            figures += swarm_figures(_trial(plan, robots, seconds))
        except UsarsimError as error:
            if robots <= ROBOTS:
                raise
            # Of what a server says at its end the last line tells why.
            remarks = f" {robots} robots could not be measured: {str(error).splitlines()[-1]}."
    return Section(
        "swarm",
        "Large teams",
        f"{DEFAULT_CLASS} with {SCOUT_SENSORS} each in {plan.world}, random DRIVE commands at 2 Hz "
        f"each, clients in another process, {seconds:g} s for each size.{remarks}",
        tuple(figures),
    )


def _trial(plan: Plan, robots: int, seconds: float) -> TeamTrial:
    with served(plan, robots) as (server, crowd):
        gather(crowd, robots, (SCOUT,), TOGETHER)
        return try_team(server, crowd, 0, seconds)


def swarm_figures(trial: TeamTrial) -> list[Figure]:
    """The figures of one size; sizes beyond the usual one have no aims."""
    aims = (FACTOR_AIM, CORES_AIM) if trial.robots <= ROBOTS else ()
    return named(f"{trial.robots} robots", team_figures(trial, *aims))


LOCKSTEP_ROBOTS = 16
LOCKSTEP_SECONDS = 20.0

SPEED_AIM = Aim(">=", 6.0)


def slowest(recorded: Sequence[Sequence[Sample]]) -> float:
    """Simulated seconds per wall second of the robot that had the lowest.

    What is recorded are arrival and simulated time of every STA line, of each robot.

    Raises:
        BenchError: if a robot hardly said anything.
    """
    try:
        return min(real_time_factor(samples) for samples in recorded)
    except ValueError as error:
        raise BenchError(f"too few STA lines: {error}") from None


def measure_lockstep(plan: Plan) -> Section:
    """A team at `--speed max`; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or LOCKSTEP_ROBOTS, plan.seconds or LOCKSTEP_SECONDS
    plan.say(f"lockstep: {robots} robots as fast as can be for {seconds:g} s")
    with served(plan, robots, "--speed", "max") as (server, crowd):
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


JITTER_ROBOTS = 24
JITTER_SECONDS = 60.0

TAIL_AIM = Aim("<", 5.0)
EXACT_AIM = Aim("<=", 0.001)
"""ms: simulated times are multiples of the time step, told to a tenth of a millisecond."""


def measure_jitter(plan: Plan) -> Section:
    """Scans of a team at real time; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or JITTER_ROBOTS, plan.seconds or JITTER_SECONDS
    plan.say(f"jitter: {robots} robots for {seconds:g} s")
    with served(plan, robots) as (server, crowd):
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

    What is recorded are arrival and simulated time of every line, of each robot.

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
        in_ms(f"{name}, 99th percentile", p99(pooled), 2, TAIL_AIM),
        in_ms(f"{name}, median", median(pooled)),
        in_ms(f"{name}, longest", max(pooled)),
        in_ms(f"{name}, 99th percentile of the worst robot", max(map(p99, wall))),
        in_ms(f"{name} in simulated time, longest", max(map(max, simulated)), 3, EXACT_AIM),
        Figure("Periods measured", len(pooled), "", 0),
    ]
