"""What this machine holds: robots in real time, cameras at their rate, and INITs at once."""

from __future__ import annotations

from contextlib import ExitStack
from statistics import median

from usarsim_bench.camera_client import Viewer, summed_up
from usarsim_bench.crowd import Controller, Crowd
from usarsim_bench.figures import Aim, Figure, Plan, Section, in_ms
from usarsim_bench.recording import (
    between,
    first_reading,
    longest_extra_gap,
    real_time_factor,
    status_samples,
    streams,
)
from usarsim_bench.server import BenchError, Load, Server, load_between

TEAMS = (4, 8, 16, 24, 32, 48, 64, 96, 128)
"""Sizes that are tried in turn, until one does not keep real time."""
SECONDS = 10.0
SETTLE = 2.0
"""s between the last robot's first line and the beginning of a measurement."""
EDGE = 0.25
"""Part of a measurement at either end of which the promptest line is taken."""
MOST_CAMERAS = 16
"""Tiles of a server that is told nothing of them."""
RATE = 15.0
"""Pictures per second of a camera (15 in the original, side channels reference 2.6)."""
PRESENT = 8
"""Robots that are there while others come."""
NEWCOMERS = 3
PATIENCE = 30.0
"""s of wall time for newcomers."""

REAL_TIME = 0.99
"""Real-time factor from which on a team counts as kept."""
ROBOTS_AIM = Aim(">=", 16)
PICTURES_AIM = Aim(">=", 0.9 * RATE)
INIT_AIM = Aim("<", 300.0)
CROWD_AIM = Aim("<", 3.0)
LATE_AIM = Aim("<", 200.0)


def measure_robots(plan: Plan) -> Section:
    """The largest team of P3AT that keeps real time; `plan.seconds` of wall time for each size."""
    seconds = plan.seconds or SECONDS
    figures, kept = [], 0
    for robots in plan.sizes(TEAMS, TEAMS[0]):
        plan.say(f"robots: {robots} for {seconds:g} s")
        with Server(plan.world, robots) as server, Crowd(server.port, plan.seed) as crowd:
            _gather(crowd, robots)
            factor, load = _watched(server, crowd, seconds)
        figures.append(Figure(f"{robots} robots: real-time factor", factor, "", 3))
        figures.append(Figure(f"{robots} robots: processor use", load.process, "cores"))
        if factor < REAL_TIME:
            break
        kept = robots
    aim = ROBOTS_AIM if plan.robots is None and not plan.brief else None
    figures.insert(0, Figure("Most robots in real time", kept, "robots", 0, aim))
    return Section(
        "robots",
        "Robots",
        f"P3AT with all their sensors in {plan.world}, random DRIVE commands at 2 Hz each, clients "
        f"in another process, {seconds:g} s for each size; real time is a factor of "
        f"{REAL_TIME:g} or more for every robot.",
        tuple(figures),
    )


def measure_cameras(plan: Plan) -> Section:
    """Pictures that each of many image clients gets; `plan.seconds` of wall time for each size."""
    seconds = plan.seconds or SECONDS
    figures = []
    for wanted in plan.sizes((1, 4, MOST_CAMERAS), 1):
        cameras = min(wanted, MOST_CAMERAS)
        plan.say(f"cameras: {cameras} for {seconds:g} s")
        with ExitStack() as stack:
            server = stack.enter_context(Server(plan.world, cameras))
            crowd = stack.enter_context(Crowd(server.port, plan.seed))
            _gather(crowd, cameras)
            viewers = [
                stack.enter_context(
                    Viewer(
                        server.port_of("images"), (320 * (n % 4), 240 * (n // 4), 320, 240), RATE
                    )
                )
                for n in range(cameras)
            ]
            for viewer in viewers:
                viewer.wait()
            before = server.usage()
            start, stop = crowd.run(seconds)
            load = load_between(before, server.usage())
            seen = [summed_up(one.pictures, start, stop) for one in viewers]
        name = f"{cameras} watched: "
        aim = PICTURES_AIM if cameras <= 4 else None
        figures += [
            Figure(f"{name}pictures of a camera, fewest", min(s.news for s in seen), "1/s", 1, aim),
            in_ms(f"{name}time to answer, median", median(s.median for s in seen), 0),
            Figure(f"{name}processor use", load.process, "cores"),
        ]
    return Section(
        "cameras",
        "Cameras",
        f"A client for each camera of 320 x 240 asks {RATE:g} times a second in {plan.world}; "
        f"pictures count that differ from the one before, {seconds:g} s.",
        tuple(figures),
    )


def measure_inits(plan: Plan) -> Section:
    """How soon newcomers are served, alone and many at once, and how late others' lines get.

    Raises:
        BenchError: if a newcomer is not served, or those who are there say hardly anything.
    """
    crowded = plan.robots or TEAMS[1]
    plan.say(f"inits: {NEWCOMERS} alone, {crowded} at once")
    with (
        Server(plan.world, PRESENT + NEWCOMERS + crowded) as server,
        Crowd(server.port, plan.seed) as crowd,
    ):
        _gather(crowd, PRESENT)
        present = list(crowd.controllers)
        crowd.run(SETTLE)
        alone, gaps = [], []
        for _ in range(NEWCOMERS):
            newcomer = crowd.join()
            crowd.run(SETTLE)
            alone.append(_delay(newcomer))
            gaps.append((newcomer.joined, newcomer.joined + SETTLE))
        at_once = [crowd.join() for _ in range(crowded)]
        crowd.wait_until_speaking(at_once)
        crowd.run(SETTLE)
        slowest = max(_delay(one) for one in at_once)
        told = [times for one in present for times in streams(one.chunks).values()]
    try:
        late = max(longest_extra_gap(times, *gap) for times in told for gap in gaps)
    except ValueError as error:
        raise BenchError(f"too few lines of those who are there: {error}") from None
    return Section(
        "inits",
        "Newcomers",
        f"{PRESENT} P3AT drive around in {plan.world} while others send INIT. Late: the longest "
        "silence of any stream of those who are there beyond its period.",
        (
            in_ms("INIT to the first SEN, median", median(alone), 0, INIT_AIM),
            Figure(f"{crowded} INITs at once: all served after", slowest, "s", 2, CROWD_AIM),
            in_ms("Late meanwhile, longest", late, 0, LATE_AIM),
        ),
    )


def _gather(crowd: Crowd, robots: int) -> None:
    crowd.wait_until_speaking([crowd.join() for _ in range(robots)])
    crowd.run(SETTLE)


def _watched(server: Server, crowd: Crowd, seconds: float) -> tuple[float, Load]:
    """Real-time factor of the robot that has the lowest, and who used the processors.

    Raises:
        BenchError: if a robot hardly says anything.
    """
    before = server.usage()
    start, stop = crowd.run(seconds)
    load = load_between(before, server.usage())
    try:
        factor = min(
            real_time_factor(between(status_samples(one.chunks), start, stop), EDGE * seconds)
            for one in crowd.controllers
        )
    except ValueError as error:
        raise BenchError(f"too few STA lines: {error}") from None
    return factor, load


def _delay(newcomer: Controller) -> float:
    """s from INIT to the first SEN.

    Raises:
        BenchError: if there is none.
    """
    came = first_reading(newcomer.chunks)
    if came is None:
        raise BenchError(f"no SEN line for {newcomer.name} after {SETTLE:g} s")
    return came - newcomer.joined
