"""What image clients get, and what a team notices of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

from benchmarks.measures import ViewerTrial, summed_up
from benchmarks.plan import Plan
from benchmarks.robot_files import CAMERA_RATE, CAMERA_SCOUT, SCOUT_SENSORS
from benchmarks.server import Server
from benchmarks.swarm import TOGETHER
from benchmarks.team import (
    FACTOR_AIM,
    MIB,
    ROBOTS,
    SECONDS,
    TeamTrial,
    gather,
    load_figures,
    served,
    try_team,
)
from usarsim_bench.crowd import DEFAULT_CLASS, Crowd
from usarsim_bench.figures import Aim, Figure, Section, in_ms
from usarsim_bench.watching import watching

WATCHED_ROBOTS = 24
COLUMNS = 6
TILE_SIZE = 320, 240
"""Pixels of a camera."""

PICTURES_AIM = Aim(">=", 0.9 * CAMERA_RATE)
NEWS_AIM = Aim(">=", 0.8 * CAMERA_RATE)
"""A client whose clock runs beside that of the camera sees a picture twice now and then."""


def grid(cameras: int) -> tuple[int, int]:
    """Columns and rows of tiles for so many cameras."""
    return min(cameras, COLUMNS), -(-cameras // COLUMNS)


def tiles_of(cameras: int) -> list[tuple[int, int, int, int]]:
    """The rectangle of every camera in that grid, pixels: x, y, width and height."""
    columns, _ = grid(cameras)
    width, height = TILE_SIZE
    return [
        (width * (number % columns), height * (number // columns), width, height)
        for number in range(cameras)
    ]


def measure_watched(plan: Plan) -> Section:
    """A team at real time, all cameras watched; `plan.seconds` of wall time are watched."""
    robots, seconds = plan.robots or WATCHED_ROBOTS, plan.seconds or SECONDS
    plan.say(f"watched: {robots} robots, each with a camera that is watched, for {seconds:g} s")
    columns, rows = grid(robots)
    with served(plan, robots, "--tiles", f"{columns}x{rows}") as (server, crowd):
        port = server.port_of("images")
        # As many tiles as cameras: whoever has which, all of them are watched.
        gather(crowd, robots, (CAMERA_SCOUT,), TOGETHER)
        with watching(port, tiles_of(robots), CAMERA_RATE) as found:
            trial = try_team(server, crowd, 0, seconds)
        seen = [summed_up(one, trial.start, trial.stop) for one in found]
    width, height = TILE_SIZE
    return Section(
        "watched",
        "Cameras of a team, all of them watched",
        f"{robots} {DEFAULT_CLASS} with {SCOUT_SENSORS} and a camera of {width} x {height} at "
        f"{CAMERA_RATE:g} Hz each in {plan.world}, random DRIVE commands at 2 Hz each; an image "
        f"client for each camera asks {CAMERA_RATE:g} times a second, {seconds:g} s. New pictures "
        "are those that differ from the one before.",
        tuple(watched_figures(trial, seen)),
    )


def watched_figures(trial: TeamTrial, seen: Sequence[ViewerTrial]) -> list[Figure]:
    """The figures of the team and of all its viewers."""
    fewest, news = min(s.pictures for s in seen), [s.news for s in seen]
    return [
        Figure("Real-time factor, lowest of all robots", trial.factor, "", 4, FACTOR_AIM),
        Figure("Real-time factor, worst second of any robot", trial.worst, "", 4),
        Figure("Pictures of a camera, fewest", fewest, "1/s", 2, PICTURES_AIM),
        Figure("New pictures of a camera, median", median(news), "1/s", 2, NEWS_AIM),
        Figure("New pictures of a camera, fewest", min(news), "1/s"),
        Figure("New pictures of all cameras", sum(news), "1/s", 1),
        in_ms("Time to answer, median", median(s.median for s in seen), 1),
        in_ms("Time to answer, largest 99th percentile", max(s.tail for s in seen), 1),
        Figure("Processor use of the server", trial.load.process, "cores", 2),
        Figure("Memory of the server", trial.resident / MIB, "MiB", 0),
        *load_figures(trial.load),
    ]


LOOK_SECONDS = 20.0
TILE = (0, 0, 320, 240)
"""Where the first camera is seen in every grid of the default tiles."""
RATE = 15.0
"""Requests per second: a simulated camera of the original had 15 pictures per second."""

LOOK_FACTOR_AIM = Aim(">=", 0.999)


@dataclass(frozen=True, slots=True)
class Look:
    """One way of looking."""

    name: str  # for people
    rectangle: tuple[int, int, int, int] | None  # asked for, pixels; None for the full frame
    rate: float | None  # requests per second; None for as many as can be


LOOKS: Sequence[Look] = (
    Look("One tile", TILE, RATE),
    Look("Full frame", None, RATE),
    Look("Full frame without pause", None, None),
)


def measure_cameras(plan: Plan) -> Section:
    """A team at real time, unwatched and watched; `plan.seconds` of wall time for each look."""
    robots, seconds = plan.robots or ROBOTS, plan.seconds or LOOK_SECONDS
    figures: list[Figure] = []
    with Server(plan.world, robots) as server, Crowd(server.port, plan.seed) as crowd:
        port = server.port_of("images")
        plan.say(f"cameras: {robots} robots, unwatched, for {seconds:g} s")
        trial = try_team(server, crowd, robots, seconds)
        figures += _team_figures("Unwatched", trial)
        for look in LOOKS:
            plan.say(f"cameras: {look.name.lower()} for {seconds:g} s")
            trial, seen = _watched(server, crowd, port, look, seconds)
            figures += _team_figures(look.name, trial) + _viewer_figures(look, seen)
        figures.append(Figure("Memory of the server", trial.resident / MIB, "MiB", 0))
        figures += load_figures(trial.load)
    return Section(
        "cameras",
        "Cameras",
        f"{robots} {DEFAULT_CLASS} in {plan.world} at real time with random DRIVE commands; one "
        f"image client at a time asks at {RATE:g} Hz or without pause, {seconds:g} s each. New "
        "pictures are those that differ from the one before.",
        tuple(figures),
    )


def _watched(
    server: Server, crowd: Crowd, port: int, look: Look, seconds: float
) -> tuple[TeamTrial, ViewerTrial]:
    with watching(port, [look.rectangle], look.rate) as [views]:
        trial = try_team(server, crowd, 0, seconds)
    return trial, summed_up(views, trial.start, trial.stop)


def _team_figures(name: str, trial: TeamTrial) -> list[Figure]:
    return [
        Figure(f"{name}: real-time factor", trial.factor, "", 4, LOOK_FACTOR_AIM),
        Figure(f"{name}: worst second of any robot", trial.worst, "", 4),
        Figure(f"{name}: processor use of the server", trial.load.process, "cores", 2),
    ]


def _viewer_figures(look: Look, seen: ViewerTrial) -> list[Figure]:
    name = look.name
    # A client that keeps its rate got every picture that it asked for.
    aim = None if look.rate is None else Aim(">=", 0.9 * look.rate)
    return [
        Figure(f"{name}: pictures", seen.pictures, "1/s", 1, aim),
        Figure(f"{name}: new pictures", seen.news, "1/s", 1),
        in_ms(f"{name}: time to answer, median", seen.median, 1),
        in_ms(f"{name}: time to answer, 99th percentile", seen.tail, 1),
        Figure(f"{name}: data", seen.octets / 1e6, "MB/s", 2),
    ]
