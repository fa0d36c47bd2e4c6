"""Large teams of what labs usually drive: a laser, sonars, odometry and INS on every robot."""

from __future__ import annotations

from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.robot_files import SCOUT, SCOUT_SENSORS, scouts
from usarsim_bench.server import SERVE, Server
from usarsim_bench.team import FACTOR_AIM, MIB, SECONDS, TeamTrial, gather, load_figures, try_team

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
        except BenchError as error:
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
    with (
        scouts() as classes,
        Server(plan.world, robots, (*SERVE, *classes)) as server,
        Crowd(server.port, plan.seed) as crowd,
    ):
        gather(crowd, robots, (SCOUT,), TOGETHER)
        return try_team(server, crowd, 0, seconds)


def swarm_figures(trial: TeamTrial) -> list[Figure]:
    """The figures of one size; sizes beyond the usual one have no aims."""
    aimed = trial.robots <= ROBOTS
    name = f"{trial.robots} robots"
    return [
        Figure(
            f"{name}: real-time factor, lowest of all",
            trial.factor,
            "",
            4,
            FACTOR_AIM if aimed else None,
        ),
        Figure(f"{name}: real-time factor, worst second of any", trial.worst, "", 4),
        Figure(
            f"{name}: processor use of the server",
            trial.load.process,
            "cores",
            2,
            CORES_AIM if aimed else None,
        ),
        Figure(f"{name}: memory of the server", trial.resident / MIB, "MiB", 0),
        Figure(f"{name}: lines sent", trial.lines, "1/s", 0),
        Figure(f"{name}: data sent", trial.octets / 1e6, "MB/s", 2),
        *(
            Figure(f"{name}: {one.name[0].lower()}{one.name[1:]}", one.value, one.unit, one.digits)
            for one in load_figures(trial.load)
        ),
    ]
