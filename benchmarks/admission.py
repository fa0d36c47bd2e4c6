"""How soon a newcomer is served, what those who are there notice of it, and a crowd at the door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from benchmarks.measures import longest_extra_gap, streams
from benchmarks.plan import Plan
from benchmarks.robot_files import SCOUT, SCOUT_SENSORS
from benchmarks.server import Server, load_between
from benchmarks.team import ROBOTS, SETTLE, gather, load_figures, served
from usarsim_bench.crowd import DEFAULT_CLASS, Controller, Crowd
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms
from usarsim_bench.recording import first_reading

SECONDS = 2.0
"""s of wall time after each INIT in which gaps are looked for."""
NEW_CLASSES = ("P2AT", "P2DX", "P3AT_real")
"""Classes with bodies of their own: each one's first robot makes the server compile its model."""

GAP_AIM = Aim("<", 200.0)


@dataclass(frozen=True, slots=True)
class Arrival:
    """A span in which a robot came, or in which nobody came, for comparison."""

    name: str  # for people
    start: float  # the span, wall time
    stop: float
    delay: float | None = None  # s from INIT to the newcomer's first STA line; None if nobody came


def disturbance(recorded: list[dict[str, list[float]]], start: float, stop: float) -> float:
    """The longest silence beyond its period of any stream within a span, s.

    What is recorded are the arrivals of every stream of every robot that was there before.

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
        gather(crowd, max(1, robots - 1), (DEFAULT_CLASS,))
        present = list(crowd.controllers)
        crowd.run(SETTLE)
        before = server.usage()
        arrivals = [_quiet(crowd, seconds), _arrival(crowd, DEFAULT_CLASS, seconds)]
        arrivals += [_arrival(crowd, name, seconds) for name in NEW_CLASSES]
        # The last span has to be followed by lines, else every stream would end in it.
        crowd.run(SETTLE / 2)
        load = load_between(before, server.usage())
        recorded = [streams(one.chunks) for one in present]
    gaps = {one.name: disturbance(recorded, one.start, one.stop) for one in arrivals}
    came = [one for one in arrivals if one.delay is not None]
    delays = [one.delay for one in came if one.delay is not None]
    longest = max(gaps[one.name] for one in came)
    return Section(
        "spawn",
        "Disturbance by newcomers",
        f"{len(present)} {DEFAULT_CLASS} driving around in {plan.world}; for {seconds:g} s after "
        "an INIT, the longest silence of any of their streams beyond its period. The first robot "
        "of a class makes the server compile its model again.",
        (
            in_ms("Longest extra gap, all newcomers", longest, 1, GAP_AIM),
            *(in_ms(f"Longest extra gap, {name}", gap, 1) for name, gap in gaps.items()),
            in_ms("INIT to the newcomer's first STA line, median", median(delays), 0),
            in_ms("INIT to the newcomer's first STA line, longest", max(delays), 0),
            *load_figures(load),
        ),
    )


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


ADMISSION_ROBOTS = 24
ADMISSION_SECONDS = 30.0
WATCHED = 1.0
"""s after an INIT in which the others' streams are watched."""
PAUSE = 0.5
"""s between a departure and the next INIT."""
FEWEST = 2
"""Newcomers at least."""

WAIT_AIM = Aim("<", 300.0)
LATE_AIM = Aim("<", 20.0)
STORM_AIM = Aim("<", 3.0)

Span = tuple[float, float]
Streams = list[dict[str, list[float]]]


@dataclass(frozen=True, slots=True)
class Visits:
    """Newcomers to a team, one at a time, and spans in which nobody came."""

    waits: list[float]  # s from INIT to the first sensor line, of each newcomer
    busy: list[Span]  # wall times of the second after each INIT
    quiet: list[Span]  # as many spans of that length in which nobody came


def waits(controllers: Sequence[Controller]) -> list[float]:
    """Seconds from the INIT of each to its first sensor line.

    Raises:
        BenchError: if one has had none.
    """
    firsts = [(one, first_reading(one.chunks)) for one in controllers]
    silent = [one.name for one, first in firsts if first is None]
    if silent:
        raise BenchError(f"no sensor line after INIT for {', '.join(silent)}")
    return [first - one.joined for one, first in firsts if first is not None]


def measure_admission(plan: Plan) -> Section:
    """All INITs of a team at once, then newcomers one by one for `plan.seconds` of wall time."""
    robots, seconds = plan.robots or ADMISSION_ROBOTS, plan.seconds or ADMISSION_SECONDS
    number = max(FEWEST, round(seconds / (2.0 * WATCHED + PAUSE)))
    plan.say(f"admission: {robots} robots at once, then {number} newcomers")
    with served(plan, robots + 1) as (server, crowd):
        team = _storm(crowd, robots)
        storm = waits(team)
        last = max(wait + one.joined for wait, one in zip(storm, team, strict=True))
        crowd.run(SETTLE)
        before = server.usage()
        visits = _visits(crowd, number)
        # The last span has to be followed by lines, else every stream would end in it.
        crowd.run(SETTLE / 2)
        load = load_between(before, server.usage())
        recorded = [streams(one.chunks) for one in team]
    return Section(
        "admission",
        "Newcomers, one by one and all at once",
        f"{DEFAULT_CLASS} with {SCOUT_SENSORS} each in {plan.world}. First {robots} INITs at once, "
        f"of a class that the server has not seen before; then, while these {robots} drive around, "
        f"{number} newcomers of that class, one at a time. Late: the longest silence of any stream "
        f"of any robot beyond its period, within {WATCHED:g} s after an INIT.",
        (
            *admission_figures(
                robots, storm, last - min(one.joined for one in team), visits, recorded
            ),
            *load_figures(load),
        ),
    )


def _storm(crowd: Crowd, robots: int) -> list[Controller]:
    """All of a team ask at once; returns when each has had its first sensor line."""
    team = [crowd.join(SCOUT) for _ in range(robots)]
    crowd.wait_until_speaking(team)
    crowd.run(PAUSE)
    return team


def _visits(crowd: Crowd, number: int) -> Visits:
    """Newcomers come and go one at a time; before each a span in which nobody comes."""
    taken: list[float] = []
    busy: list[Span] = []
    quiet: list[Span] = []
    for _ in range(number):
        crowd.run(PAUSE)
        quiet.append(crowd.run(WATCHED))
        newcomer = crowd.join(SCOUT)
        crowd.run(WATCHED)
        busy.append((newcomer.joined, newcomer.joined + WATCHED))
        crowd.wait_until_speaking([newcomer])
        if first_reading(newcomer.chunks) is None:
            crowd.run(PAUSE)
        taken += waits([newcomer])
        crowd.leave(newcomer)
    return Visits(taken, busy, quiet)


def admission_figures(
    robots: int, storm: Sequence[float], served: float, visits: Visits, recorded: Streams
) -> list[Figure]:
    """What became of the storm and of the newcomers; times in s.

    Args:
        robots: size of the team.
        storm: from INIT to the first sensor line, of each of the team.
        served: from the first INIT of the team until the last of them had its first line.
        visits: those who came later.
        recorded: arrivals of every stream of every robot of the team.

    Raises:
        BenchError: if a stream has hardly any lines.
    """
    late = [disturbance(recorded, *span) for span in visits.busy]
    usual = [disturbance(recorded, *span) for span in visits.quiet]
    at_once, name = f"{robots} INITs at once", "INIT to first SEN"
    running = f"{name}, {robots} robots running"
    return [
        Figure(f"{at_once}: all served after", served, "s", 2, STORM_AIM),
        Figure(f"{at_once}: {name}, median", median(storm), "s"),
        in_ms(f"{running}, longest", max(visits.waits), 0, WAIT_AIM),
        in_ms(f"{running}, median", median(visits.waits), 0),
        in_ms("Others late meanwhile, longest of all newcomers", max(late), 1, LATE_AIM),
        in_ms("Others late meanwhile, median newcomer", median(late), 1),
        in_ms("Others late while nobody comes, longest", max(usual), 1),
        in_ms("Others late while nobody comes, median", median(usual), 1),
        Figure("Newcomers", len(visits.waits), "", 0),
    ]
