"""What the robots that are there notice when another one comes."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import median

from usarsim_bench.crowd import DEFAULT_CLASS, Controller, Crowd
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Aim, Figure, Plan, Section
from usarsim_bench.procfs import load_between
from usarsim_bench.recording import streams
from usarsim_bench.server import Server
from usarsim_bench.statistics import longest_extra_gap
from usarsim_bench.team import ROBOTS, SETTLE, load_figures

SECONDS = 2.0
"""s of wall time after each INIT in which gaps are looked for."""
NEW_CLASSES = ("P2AT", "P2DX", "P3AT_real")
"""Classes with bodies of their own: each one's first robot makes the server compile its model."""

GAP_AIM = Aim("<", 200.0)


@dataclass(frozen=True, slots=True)
class Arrival:
    """A span in which a robot came, or in which nobody came, for comparison.

    Attributes:
        name: for people.
        start, stop: the span, wall time.
        delay: s from INIT to the newcomer's first STA line; None if nobody came.
    """

    name: str
    start: float
    stop: float
    delay: float | None = None


def disturbance(recorded: list[dict[str, list[float]]], start: float, stop: float) -> float:
    """The longest silence beyond its period of any stream of any robot within a span, s.

    Args:
        recorded: arrivals of every stream of every robot that was there before.
        start, stop: the span.

    Raises:
        BenchError: if a stream has hardly any lines.
    """
    gaps = []
    for robot in recorded:
        for name, times in robot.items():
            try:
                gaps.append(longest_extra_gap(times, start, stop))
            except ValueError as error:
                raise BenchError(f"too few lines of {name}: {error}") from None
    if not gaps:
        raise BenchError("nobody was there to be disturbed")
    return max(gaps)


def measure_spawn(plan: Plan) -> Section:
    """Disturbance by newcomers; `plan.seconds` of wall time are watched for each of them."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or SECONDS
    plan.say(f"spawn: number {robots} and {len(NEW_CLASSES)} new classes, {seconds:g} s each")
    with (
        Server(plan.world, robots + len(NEW_CLASSES)) as server,
        Crowd(server.port, plan.seed) as crowd,
    ):
        present = []
        for _ in range(max(1, robots - 1)):
            present.append(crowd.join())
            crowd.wait_until_speaking(present[-1:])
        crowd.run(SETTLE)
        before = server.usage()
        arrivals = [_quiet(crowd, seconds), _arrival(crowd, DEFAULT_CLASS, seconds)]
        arrivals += [_arrival(crowd, name, seconds) for name in NEW_CLASSES]
        # The last span has to be followed by lines, else every stream would end in it.
        crowd.run(SETTLE / 2)
        load = load_between(before, server.usage())
        recorded = [streams(one.chunks) for one in present]
    return _section(plan, present, seconds, arrivals, recorded, load_figures(load))


def _quiet(crowd: Crowd, seconds: float) -> Arrival:
    return Arrival("nobody comes, for comparison", *crowd.run(seconds))


def _arrival(crowd: Crowd, robot_class: str, seconds: float) -> Arrival:
    newcomer = crowd.join(robot_class)
    crowd.run(seconds)
    stop = newcomer.joined + seconds
    crowd.wait_until_speaking([newcomer])
    known = "one more" if robot_class == DEFAULT_CLASS else "the first"
    delay = streams(newcomer.chunks)["STA"][0] - newcomer.joined
    return Arrival(f"{known} {robot_class}", newcomer.joined, stop, delay)


def _section(
    plan: Plan,
    present: list[Controller],
    seconds: float,
    arrivals: list[Arrival],
    recorded: list[dict[str, list[float]]],
    load: list[Figure],
) -> Section:
    gaps = {one.name: 1e3 * disturbance(recorded, one.start, one.stop) for one in arrivals}
    came = [one for one in arrivals if one.delay is not None]
    delays = [1e3 * one.delay for one in came if one.delay is not None]
    return Section(
        "spawn",
        "Disturbance by newcomers",
        f"{len(present)} {DEFAULT_CLASS} driving around in {plan.world}; for {seconds:g} s after "
        "an INIT, the longest silence of any of their streams beyond its period. The first robot "
        "of a class makes the server compile its model again.",
        (
            Figure(
                "Longest extra gap, all newcomers",
                max(gaps[one.name] for one in came),
                "ms",
                1,
                GAP_AIM,
            ),
            *(Figure(f"Longest extra gap, {name}", gap, "ms", 1) for name, gap in gaps.items()),
            Figure("INIT to the newcomer's first STA line, median", median(delays), "ms", 0),
            Figure("INIT to the newcomer's first STA line, longest", max(delays), "ms", 0),
            *load,
        ),
    )
