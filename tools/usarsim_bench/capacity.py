"""What this machine holds: robots in real time, cameras at their rate, and INITs at once."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from statistics import median

import psutil

from usarsim_bench.crowd import Controller, Crowd
from usarsim_bench.figures import Aim, BenchError, Figure, Section, in_ms
from usarsim_bench.recording import between, first_reading, real_time_factor, status_samples
from usarsim_bench.watching import waits, watching
from usarsim_server.base.launch import OwnServer

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

REAL_TIME = 0.99
"""Real-time factor from which on a team counts as kept."""
ROBOTS_AIM = Aim(">=", 16)
PICTURES_AIM = Aim(">=", 0.9 * RATE)
INIT_AIM = Aim("<", 300.0)
CROWD_AIM = Aim("<", 3.0)


def measure_robots(world: str, only: int | None, seconds: float | None) -> Section:
    """The largest team of P3AT that keeps real time; `seconds` of wall time for each size."""
    seconds = seconds or SECONDS
    figures, kept = [], 0
    for robots in (only,) if only else TEAMS:
        say(f"robots: {robots} for {seconds:g} s")
        with _team(world, robots) as (server, crowd):
            start, stop, cores = _watched(server, crowd, seconds)
            told = [between(status_samples(one.chunks), start, stop) for one in crowd.controllers]
        try:
            factor = min(real_time_factor(one, EDGE * seconds) for one in told)
        except ValueError as error:
            raise BenchError(f"too few STA lines: {error}") from None
        figures.append(Figure(f"{robots} robots: real-time factor", factor, "", 3))
        figures.append(Figure(f"{robots} robots: processor use", cores, "cores"))
        if factor < REAL_TIME:
            break
        kept = robots
    aim = None if only else ROBOTS_AIM
    figures.insert(0, Figure("Most robots in real time", kept, "robots", 0, aim))
    return Section(
        "robots",
        "Robots",
        f"P3AT with all their sensors in {world}, random DRIVE commands at 2 Hz each, clients "
        f"in another process, {seconds:g} s for each size; real time is a factor of "
        f"{REAL_TIME:g} or more for every robot.",
        tuple(figures),
    )


def measure_cameras(world: str, only: int | None, seconds: float | None) -> Section:
    """Pictures that each of many image clients gets."""
    seconds = seconds or SECONDS
    figures = []
    for wanted in (only,) if only else (1, 4, MOST_CAMERAS):
        cameras = min(wanted, MOST_CAMERAS)
        say(f"cameras: {cameras} for {seconds:g} s")
        tiles = [(320 * (n % 4), 240 * (n // 4), 320, 240) for n in range(cameras)]
        with (
            _team(world, cameras) as (server, crowd),
            watching(server.ports["images"], tiles, RATE) as found,
        ):
            start, stop, cores = _watched(server, crowd, seconds)
        seen = [[one for one in views if start <= one.come <= stop] for views in found]
        name, aim = f"{cameras} watched: ", PICTURES_AIM if cameras <= 4 else None
        changes = [sum(a.content != b.content for a, b in pairwise(views)) for views in seen]
        news = min(changes) / (stop - start)
        taken = [median(waits(views, start, stop)) for views in found]
        figures += [
            Figure(f"{name}pictures of a camera, fewest", news, "1/s", 1, aim),
            in_ms(f"{name}time to answer, median", median(taken), 0),
            Figure(f"{name}processor use", cores, "cores"),
        ]
    return Section(
        "cameras",
        "Cameras",
        f"A client for each camera of 320 x 240 asks {RATE:g} times a second in {world}; "
        f"pictures count that differ from the one before, {seconds:g} s.",
        tuple(figures),
    )


def measure_inits(world: str, only: int | None, seconds: float | None) -> Section:
    """How soon newcomers are served, alone and `only` at once."""
    crowded, alone = only or TEAMS[1], []
    say(f"inits: {NEWCOMERS} alone, {crowded} at once")
    with _team(world, PRESENT, NEWCOMERS + crowded) as (_, crowd):
        for _ in range(NEWCOMERS):
            alone.append(crowd.join())
            crowd.run(SETTLE)
        at_once = [crowd.join() for _ in range(crowded)]
        crowd.wait_until_speaking(at_once)
        crowd.run(SETTLE)
    slowest = max(map(_delay, at_once))
    return Section(
        "inits",
        "Newcomers",
        f"{PRESENT} P3AT drive around in {world} while others send INIT.",
        (
            in_ms("INIT to the first SEN, median", median(map(_delay, alone)), 0, INIT_AIM),
            Figure(f"{crowded} INITs at once: all served after", slowest, "s", 2, CROWD_AIM),
        ),
    )


@contextmanager
def _team(world: str, robots: int, more: int = 0) -> Iterator[tuple[OwnServer, Crowd]]:
    """A server whose robots drive around and have settled, with room for some more."""
    options = (f"--world={world}", f"--max-robots={robots + more}", "--image-port=0")
    with OwnServer(*options) as server, Crowd(server.ports["control"]) as crowd:
        crowd.wait_until_speaking([crowd.join() for _ in range(robots)])
        crowd.run(SETTLE)
        yield server, crowd


def _watched(server: OwnServer, crowd: Crowd, seconds: float) -> tuple[float, float, float]:
    """When a stretch of driving began and ended, and the processors that the server kept busy."""

    def busy() -> float:
        try:
            times = psutil.Process(server.process.pid).cpu_times()
        except psutil.Error:
            raise BenchError(f"the server died: {server.said}") from None
        return times.user + times.system

    before = busy()
    start, stop = crowd.run(seconds)
    return start, stop, (busy() - before) / (stop - start)


def _delay(newcomer: Controller) -> float:
    """s from INIT to the first SEN."""
    came = first_reading(newcomer.chunks)
    if came is None:
        raise BenchError(f"no SEN line for {newcomer.name} after {SETTLE:g} s")
    return came - newcomer.joined


def say(text: str) -> None:
    """Print a line of progress to standard error."""
    print(text, file=sys.stderr, flush=True)
