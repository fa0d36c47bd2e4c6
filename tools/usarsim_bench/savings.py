"""What it brings to turn something down: one change at a time, against the same team without it."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from usarsim_bench.boxes import STARTS, write_boxes
from usarsim_bench.crowd import DEFAULT_CLASS
from usarsim_bench.errors import BenchError
from usarsim_bench.figures import Figure, Plan, Section
from usarsim_bench.growth import beam_keys, camera_options, per_picture
from usarsim_bench.robot_files import (
    CAMERA_RATE,
    LASER_NAME,
    SCOUT,
    SCOUT_SENSORS,
    SURVEYOR,
    SURVEYOR_CAMERAS,
    scouts,
    sonars,
    write_class,
)
from usarsim_bench.thread_cost import ROLES, Cost, Team, Watching, measure_cost
from usarsim_bench.watched import tiles_of

ROBOTS = 16
CAMERA_TEAM = 1
SECONDS = 6.0
TURNS_PER_SECOND = 2.0
"""Of simulated time."""
FIXED, MOVABLE = 100, 50
"""Boxes of the two worlds that are compared."""

USUAL, SURVEYED, BOXED = "as it is", "cameras as they are", "boxes as they are"
"""What changes are compared with."""

_NAMES = tuple(f"F{number}" for number in range(1, 9))
"""Sonars of a scout."""
_OTHERS = (("GroundTruth", "GndTruth"), ("INS", "InsTest"), ("Odometry", "Odometer"))
_INSTRUMENT = "usarsim_bench.instruments.teams"
_SHOWN_ERRORS = 2000
_BASE = "position = [0.2085, 0, -0.2]"


@dataclass(frozen=True, slots=True)
class Change:
    """One thing turned down, or up.

    Attributes:
        name: for people.
        team: who is measured then.
        against: name of the change that it is compared with; None for those themselves.
    """

    name: str
    team: Team
    against: str | None = USUAL


def measure_savings(plan: Plan) -> Section:
    """One team after the other; `plan.seconds` are watched for each."""
    robots, seconds = min(plan.robots or ROBOTS, STARTS), plan.seconds or SECONDS
    costs: dict[str, Cost] = {}
    with scouts() as words, tempfile.TemporaryDirectory(prefix="usarsim-bench-") as name:
        classes = Path(words[1])
        write_variants(classes)
        changes = teams(robots, classes, plan.world, Path(name))
        for change in changes:
            if change.team.watching.tiles:
                plan.say(f"savings: {change.name} for {seconds:g} s")
                costs[change.name] = measure_cost(change.team, plan, seconds)
        driving = [change for change in changes if not change.team.watching.tiles]
        plan.say(f"savings: {len(driving)} teams in turns for {seconds:g} simulated s each")
        found = _in_turns([one.team for one in driving], seconds, plan.seed, Path(name))
        costs |= {one.name: cost for one, cost in zip(driving, found, strict=True)}
    return Section(
        "savings",
        "What turning something down brings",
        f"{robots} {DEFAULT_CLASS} with {SCOUT_SENSORS} each in {plan.world}, random DRIVE "
        "commands at 2 Hz each, one change at a time, all teams in turns in one process without "
        f"sockets, {seconds:g} simulated s each, medians. Cameras: at real time, one robot with "
        f"{SURVEYOR_CAMERAS} cameras of 320 x 240 at {CAMERA_RATE:g} Hz, all watched. Boxes: the "
        f"same team in a field of {FIXED} fixed boxes. Processor time of the whole server.",
        tuple(saving_figures(changes, costs)),
    )


def _in_turns(teams: Sequence[Team], seconds: float, seed: int, folder: Path) -> list[Cost]:
    """Costs without sockets and clock, in the order of the teams."""
    works = []
    for one in teams:
        work: dict[str, object] = {
            "world": one.world,
            "classes": str(one.classes),
            "robot_class": one.robot_class,
            "robots": one.robots,
            "room": one.room or one.robots,
        }
        if one.options[:1] == ("--timestep",):
            work["timestep"] = float(one.options[1])
        works.append(work)
    file = folder / "works.json"
    turns = max(1, round(TURNS_PER_SECOND * seconds))
    file.write_text(json.dumps({"works": works, "turns": turns, "seed": seed}))
    command = [sys.executable, "-m", _INSTRUMENT, str(file)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise BenchError(f"the teams instrument failed: {done.stderr[-_SHOWN_ERRORS:].strip()}")
    nobody = dict.fromkeys(ROLES, 0.0)
    return [Cost({**nobody, **spent}, 1.0, 0.0, 0.0, 0, None) for spent in json.loads(done.stdout)]


def write_variants(folder: Path) -> None:
    """Write the classes that differ from a scout in one thing."""
    write_class(folder, "SlowLaser", parent=SCOUT, sensors=[_laser("interval = 0.2")])
    few = _laser(f"interval = 0.1, {beam_keys(91)}")
    write_class(folder, "FewBeams", parent=SCOUT, sensors=[few])
    write_class(folder, "SlowSonars", parent=SCOUT, sensors=sonars("interval = 0.5"))
    write_class(folder, "ThinSonars", parent=SCOUT, sensors=sonars("cones = 0"))
    write_class(
        folder, "FineSonars", parent=SCOUT, sensors=sonars("cones = 10, rays_per_cone = 16")
    )
    write_class(folder, "NoSonars", parent=SCOUT, without=_NAMES)
    slow = [f'{{ type = "{kind}", name = "{name}", interval = 1.0 }}' for kind, name in _OTHERS]
    write_class(folder, "SlowPoses", parent=SCOUT, sensors=slow)
    everything = (*_NAMES, LASER_NAME, *(name for _, name in _OTHERS))
    write_class(folder, "NoSensors", parent=SCOUT, without=everything)


def _laser(keys: str) -> str:
    return f'{{ type = "SICK", name = "{LASER_NAME}", {_BASE}, {keys} }}'


def teams(robots: int, classes: Path, world: str, folder: Path) -> list[Change]:
    """What is measured, each kind behind what it is compared with."""

    def scouting(name: str, kind: str = SCOUT, options: Sequence[str] = ()) -> Change:
        against = None if name == USUAL else USUAL
        return Change(name, Team(robots, kind, classes, world, tuple(options)), against)

    def watched(name: str, options: Sequence[str] = (), rate: float = CAMERA_RATE) -> Change:
        size = options[1] if options and options[0] == "--tile-size" else ""
        words = (*camera_options(CAMERA_TEAM), *options)
        team = Team(CAMERA_TEAM, SURVEYOR, classes, world, words, Watching(_tiles(size), rate))
        return Change(name, team, None if name == SURVEYED else SURVEYED)

    def boxed(name: str, movable: int) -> Change:
        place = str(write_boxes(folder, FIXED, movable))
        return Change(name, Team(robots, SCOUT, classes, place), None if name == BOXED else BOXED)

    return [
        scouting(USUAL),
        scouting("no sensors at all", "NoSensors"),
        scouting("no sonars", "NoSonars"),
        scouting("sonars of one ray instead of 17", "ThinSonars"),
        scouting("sonars of 161 rays", "FineSonars"),
        scouting("sonars at 2 Hz instead of 5", "SlowSonars"),
        scouting("laser at 5 Hz instead of 10", "SlowLaser"),
        scouting("laser of 91 beams instead of 181", "FewBeams"),
        scouting("odometry, INS and ground truth at 1 Hz", "SlowPoses"),
        scouting("all sensors of the shipped class", DEFAULT_CLASS),
        Change("--max-robots 128", Team(robots, SCOUT, classes, world, room=128)),
        scouting("--timestep 0.005 instead of 0.004", SCOUT, ("--timestep", "0.005")),
        boxed(BOXED, 0),
        boxed(f"{MOVABLE} boxes more that can be pushed", MOVABLE),
        watched(SURVEYED),
        watched("--camera-rate 2.5", ("--camera-rate", "2.5"), 2.5),
        watched("--tile-size 160x120", ("--tile-size", "160x120")),
        watched("--tile-size 640x480", ("--tile-size", "640x480")),
        watched("--shadows 1024", ("--shadows", "1024")),
        watched("--multisample 4", ("--multisample", "4")),
    ]


def _tiles(size: str) -> list[tuple[int, int, int, int]]:
    """The tiles of the surveyors in a grid whose tiles may have another size."""
    tiles = tiles_of(CAMERA_TEAM * SURVEYOR_CAMERAS)
    if not size:
        return tiles
    width, height = map(int, size.split("x"))
    _, _, usual_width, usual_height = tiles[0]
    return [
        (x // usual_width * width, y // usual_height * height, width, height)
        for x, y, _, _ in tiles
    ]


def saving_figures(changes: Iterable[Change], costs: Mapping[str, Cost]) -> list[Figure]:
    """Cores with every change, and the part that it takes away; less than 0 if it adds."""
    figures = []
    for change in changes:
        cost = costs[change.name]
        figures.append(Figure(change.name, cost.whole, "cores", 3))
        if change.team.watching.tiles:
            figures.append(Figure(f"{change.name}: one picture", 1e3 * per_picture(cost), "ms", 1))
        if change.against is None:
            continue
        usual = costs[change.against].whole
        part = 100.0 * (usual - cost.whole) / usual if usual > 0.0 else 0.0
        figures.append(Figure(f"{change.name}: less than {change.against} by", part, "%", 0))
    return figures
