"""How the cost of a server grows: with robots, beams of a laser, geoms of the world, cameras."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from usarsim_bench.boxes import STARTS, write_boxes
from usarsim_bench.crowd import DEFAULT_CLASS
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Figure, Plan, Section
from usarsim_bench.plot import Plot, Series
from usarsim_bench.robot_files import (
    CAMERA_RATE,
    LASER_NAME,
    SCOUT,
    SCOUT_SENSORS,
    SURVEYOR,
    SURVEYOR_CAMERAS,
    scouts,
    write_class,
)
from usarsim_bench.thread_cost import Cost, Team, Watching, measure_cost
from usarsim_bench.watched import TILE_SIZE, grid, tiles_of

ROBOTS = (1, 4, 16, 32, 64)
BEAMS = (31, 181, 361, 1081)
GEOMS = (10, 100, 1000, 3000)
CAMERAS = (1, 4, 8, 16)
TEAM = 8
"""Robots with which beams and geoms are varied."""
CAMERA_TEAM = 4
SECONDS = 6.0
LASER_INTERVAL = 0.1
"""s between two scans whose beams are varied."""

_SHOWN = ("physics", "reports", "sockets")
_FOV = math.pi
_DIGIT = 1e-4
"""rad: the last digit of an angle that is announced, so that clients count as many beams."""

Costs = Mapping[int, Cost]
"""What was measured, by the number that was varied."""


def measure_growth(plan: Plan) -> Section:
    """Four curves; `plan.seconds` of wall time for each point.

    `plan.robots` is the largest team; fewer robots than usual carry lasers and cameras then.
    """
    seconds = plan.seconds or SECONDS
    robots = sizes_up_to(ROBOTS, plan.robots)
    team, surveyors = (min(n, plan.robots or n) for n in (TEAM, CAMERA_TEAM))
    cameras = tuple(n for n in CAMERAS if n <= surveyors * SURVEYOR_CAMERAS)
    with scouts() as words, tempfile.TemporaryDirectory(prefix="usarsim-bench-") as name:
        classes, folder = Path(words[1]), Path(name)
        by_robots = _taken(
            plan, seconds, "robots", robots, lambda n: Team(n, SCOUT, classes, plan.world)
        )
        by_beams = _taken(
            plan, seconds, "beams", BEAMS, lambda n: _scanning(classes, team, n, plan.world)
        )
        by_geoms = _taken(
            plan, seconds, "geoms", GEOMS, lambda n: _among_boxes(classes, team, n, folder)
        )
        by_cameras = _taken(
            plan, seconds, "cameras", cameras, lambda n: _seen(classes, surveyors, n, plan.world)
        )
    width, height = TILE_SIZE
    return Section(
        "growth",
        "How cost grows",
        f"Processor time of the server's threads at real time, random DRIVE commands at 2 Hz each, "
        f"clients in another process, {seconds:g} s for each point. Robots: {DEFAULT_CLASS} with "
        f"{SCOUT_SENSORS} each in {plan.world}. Beams: {team} of them, the laser's beams varied, "
        f"{1.0 / LASER_INTERVAL:g} scans a second. Geoms: {team} of them in a field of fixed boxes "
        f"that is always equally dense. Cameras: {surveyors} robots with {SURVEYOR_CAMERAS} "
        f"cameras of {width} x {height} each and nothing else, {CAMERA_RATE:g} pictures a second, "
        "so many of them watched.",
        (
            *figures_of("robots", by_robots),
            each_more("robot", by_robots),
            *figures_of("beams", by_beams),
            *figures_of("geoms", by_geoms),
            *_camera_figures(by_cameras),
        ),
        plots=(
            curve("robots", f"{DEFAULT_CLASS} with laser and sonars", "robots", by_robots),
            curve("beams", f"Lasers of {team} robots at 10 Hz", "beams of a scan", by_beams),
            curve(
                "geoms", f"{team} robots among boxes", "fixed geoms of the world", by_geoms, True
            ),
            _camera_curve(by_cameras),
        ),
    )


def sizes_up_to(usual: Sequence[int], largest: int | None) -> tuple[int, ...]:
    """The usual sizes, or those below a largest one and that itself."""
    if largest is None:
        return tuple(usual)
    return (*(size for size in usual if size < largest), largest)


def _taken(
    plan: Plan, seconds: float, what: str, sizes: Sequence[int], team: Callable[[int], Team]
) -> Costs:
    costs = {}
    for size in sizes:
        plan.say(f"growth: {size} {what} for {seconds:g} s")
        costs[size] = measure_cost(team(size), plan, seconds)
    return costs


# -- what is varied --------------------------------------------------------------------------


def beam_keys(beams: int) -> str:
    """Keys of a scanner with so many beams over half a turn, or nearly.

    Raises:
        ValueError: for fewer than two, or for more than announced angles can tell apart.
    """
    if beams < 2 or _FOV / (beams - 1) < _DIGIT:
        raise ValueError(f"no scanner has {beams} beams")
    resolution = math.floor(_FOV / (beams - 1) / _DIGIT) * _DIGIT
    return f"fov = {resolution * (beams - 1):.4f}, resolution = {resolution:.4f}"


def _scanning(classes: Path, robots: int, beams: int, world: str) -> Team:
    name = f"{SCOUT}{beams}"
    laser = (
        f'{{ type = "SICK", name = "{LASER_NAME}", position = [0.2085, 0, -0.2], '
        f"interval = {LASER_INTERVAL:g}, {beam_keys(beams)} }}"
    )
    write_class(classes, name, parent=SCOUT, sensors=[laser])
    return Team(robots, name, classes, world)


def _among_boxes(classes: Path, robots: int, geoms: int, folder: Path) -> Team:
    if robots > STARTS:
        raise BenchError(f"{robots} robots: among boxes there is room for {STARTS}")
    return Team(robots, SCOUT, classes, str(write_boxes(folder, geoms)))


def _seen(classes: Path, robots: int, cameras: int, world: str) -> Team:
    watching = Watching(tiles_of(robots * SURVEYOR_CAMERAS)[:cameras], CAMERA_RATE)
    return Team(robots, SURVEYOR, classes, world, camera_options(robots), watching)


def camera_options(robots: int) -> tuple[str, ...]:
    """Words of the command line by which all cameras of surveyors have tiles and a rate."""
    columns, rows = grid(robots * SURVEYOR_CAMERAS)
    return (
        *("--tiles", f"{columns}x{rows}", "--tile-size", "x".join(map(str, TILE_SIZE))),
        *("--camera-rate", f"{CAMERA_RATE:g}"),
    )


# -- what came out ---------------------------------------------------------------------------


def figures_of(what: str, costs: Costs) -> list[Figure]:
    """Cores of each thread for each number."""
    figures = []
    for number, cost in costs.items():
        name = f"{number} {what if number != 1 else what.removesuffix('s')}"
        figures += [Figure(f"{name}: {role}", cost.spent[role], "cores", 3) for role in _SHOWN]
        figures.append(Figure(f"{name}: whole server", cost.whole, "cores", 3))
        figures.append(Figure(f"{name}: real-time factor", cost.factor, "", 3))
    return figures


def each_more(what: str, costs: Costs) -> Figure:
    """What one more costs, between the least and the greatest number; 0 for a single one."""
    least, most = min(costs), max(costs)
    rise = costs[most].whole - costs[least].whole
    value = 1e3 * rise / (most - least) if most > least else 0.0
    return Figure(f"One more {what}", value, "ms/s", 1)


def per_picture(cost: Cost) -> float:
    """Processor seconds of a picture, from drawing to JPEG.

    Raises:
        BenchError: if there were no pictures.
    """
    if cost.pictures <= 0.0:
        raise BenchError("no new picture came")
    # Costs are per simulated second, pictures per second of wall time.
    return cost.pictured * cost.factor / cost.pictures


def _camera_figures(costs: Costs) -> list[Figure]:
    figures = []
    for number, cost in costs.items():
        name = f"{number} camera{'s' if number != 1 else ''}"
        figures += [
            Figure(f"{name}: drawing and encoding", cost.pictured, "cores", 3),
            Figure(f"{name}: new pictures", cost.pictures, "1/s", 1),
            Figure(f"{name}: one picture", 1e3 * per_picture(cost), "ms", 1),
            Figure(f"{name}: whole server", cost.whole, "cores", 3),
            Figure(f"{name}: real-time factor", cost.factor, "", 3),
        ]
    return figures


def curve(key: str, title: str, x: str, costs: Costs, log_x: bool = False) -> Plot:
    """The threads' costs over a number."""
    series = [
        Series(role, tuple((n, cost.spent[role]) for n, cost in costs.items())) for role in _SHOWN
    ]
    whole = Series("whole server", tuple((n, cost.whole) for n, cost in costs.items()))
    return Plot(key, title, x, "processors used at real time", (*series, whole), log_x)


def _camera_curve(costs: Costs) -> Plot:
    width, height = TILE_SIZE
    return Plot(
        "cameras",
        f"Cameras of {width} x {height} at {CAMERA_RATE:g} Hz",
        "cameras watched",
        "processors used at real time",
        (
            Series("drawing and encoding", tuple((n, c.pictured) for n, c in costs.items())),
            Series("sockets", tuple((n, c.spent["sockets"]) for n, c in costs.items())),
            Series("whole server", tuple((n, c.whole) for n, c in costs.items())),
        ),
    )
