"""The work that every simulator is given, and running it in a process of its own.

A world of boxes, robots, a laser, wheel speeds: one JSON text says all of it, so that a workload
script of another simulator needs nothing of ours, and our own server is given the same:
`write_world` and `write_robots` make its files.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import random
import signal
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from usarsim_bench.figures import BenchError

HALF_X, HALF_Y = 12.0, 10.0
"""m: half of the hall's inner length and width, those of the shipped arena."""
WALL, HEIGHT = 0.2, 1.2
"""m: thickness and height of walls."""
CRATE = 0.5
"""m: edge of a crate; crates do not move, since not every simulator could move them."""
COLUMNS, ROWS = 8, 8
"""Cells of the hall; a robot starts in each."""
MOST = COLUMNS * ROWS
WALL_CHANCE, CRATE_CHANCE = 0.35, 0.6
GAP = 0.15
"""Part of a wall between two cells that is left open at either end."""

ROVER = "PeerRover"
"""Class of our robot in this comparison: the P3AT of 0.8 m/s with nothing but a laser."""
RADIUS, WIDTH, WHEEL_MASS = 0.098, 0.08, 0.1
WHEELS = ((0.124, 0.18), (0.124, -0.18), (-0.124, 0.18), (-0.124, -0.18))
"""m: centres, x forward and y left, left wheels first in either pair (robots reference 1.2)."""
AXLE_TO_CHASSIS = 0.078
"""m from the axles up to the centre of the chassis."""
CHASSIS = (0.58, 0.26, 0.14)
CHASSIS_MASS = 11.5
HOUSING, HOUSING_FORWARD = (0.14, 0.14, 0.16), 0.15
"""m: the laser's housing, on top of the chassis; other robots' lasers see it."""
TOP_SPEED = 8.17
"""rad/s, which is 0.80 m/s."""
TORQUE = 10.0
"""N m of a wheel, at most, in simulators that ask."""
FLOOR_FRICTION = 1.0

BEAMS, FOV, REACH, LASER_RATE = 181, math.pi, 20.0, 10.0
LASER = (0.2085, 0.346)
"""m: forward of the robot's middle and above the floor."""

COMMAND_PERIOD = 0.5
"""Simulated s between two commands to a robot."""
WARM_UP = 1.0
"""Simulated s before the measurement begins."""


@dataclass(frozen=True, slots=True)
class Box:
    """Something upright that does not move."""

    center: tuple[float, float, float]  # x, y, z of its middle, m
    half: tuple[float, float, float]  # half of its edges, m
    yaw: float = 0.0  # rad, anticlockwise


@dataclass(frozen=True, slots=True)
class Work:
    """Everything that a run is told."""

    robots: int  # how many
    seconds: float  # simulated s to measure
    wall_limit: float  # s of wall time after which a run that is slow may stop early
    warm_up: float  # simulated s before
    half_x: float  # of the hall, which is centred on the origin, m
    half_y: float
    boxes: tuple[Box, ...]  # walls and crates
    starts: tuple[tuple[float, float, float], ...]  # x, y (m), yaw (rad) of each robot
    command_period: float
    commands: tuple[tuple[tuple[float, float], ...], ...]
    """For every `command_period` of simulated time from the start of the warm-up, each robot's left
    and right wheel speed, rad/s; begins again when it is at its end."""

    def as_json(self) -> str:
        """One JSON object with the attributes, and what the robots and their lasers are like."""
        robot = {
            "chassis": CHASSIS,
            "chassis_mass": CHASSIS_MASS,
            "chassis_height": RADIUS + AXLE_TO_CHASSIS,
            "housing": HOUSING,
            "housing_forward": HOUSING_FORWARD,
            "wheels": WHEELS,
            "wheel_radius": RADIUS,
            "wheel_width": WIDTH,
            "wheel_mass": WHEEL_MASS,
            "wheel_torque": TORQUE,
            "track": 2.0 * WHEELS[0][1],
            "top_speed": TOP_SPEED,
            "friction": FLOOR_FRICTION,
        }
        laser = {
            "beams": BEAMS,
            "fov": FOV,
            "range": REACH,
            "rate": LASER_RATE,
            "forward": LASER[0],
            "height": LASER[1],
        }
        return json.dumps({**asdict(self), "robot": robot, "laser": laser})


def arena(seed: int = 0) -> tuple[Box, ...]:
    """The hall: four outer walls, walls between some of the cells, crates in corners of cells."""
    dice = random.Random(f"arena {seed}")
    boxes = [
        Box((0.0, side * (HALF_Y + WALL / 2), HEIGHT / 2), (HALF_X + WALL, WALL / 2, HEIGHT / 2))
        for side in (-1.0, 1.0)
    ]
    boxes += [
        Box((side * (HALF_X + WALL / 2), 0.0, HEIGHT / 2), (WALL / 2, HALF_Y, HEIGHT / 2))
        for side in (-1.0, 1.0)
    ]
    long, wide = 2.0 * HALF_X / COLUMNS, 2.0 * HALF_Y / ROWS
    for column in range(COLUMNS):
        for row in range(ROWS):
            x, y = _middle(column, row)
            if column + 1 < COLUMNS and dice.random() < WALL_CHANCE:
                half = (WALL / 2, (0.5 - GAP) * wide, HEIGHT / 2)
                boxes.append(Box((x + long / 2, y, HEIGHT / 2), half))
            if row + 1 < ROWS and dice.random() < WALL_CHANCE:
                half = ((0.5 - GAP) * long, WALL / 2, HEIGHT / 2)
                boxes.append(Box((x, y + wide / 2, HEIGHT / 2), half))
            if dice.random() < CRATE_CHANCE:
                corner = (x - 0.3 * long, y - 0.3 * wide, CRATE / 2)
                boxes.append(Box(corner, (CRATE / 2,) * 3, dice.uniform(0.0, math.pi / 2)))
    return tuple(boxes)


def _middle(column: int, row: int) -> tuple[float, float]:
    return (
        (column + 0.5) * 2.0 * HALF_X / COLUMNS - HALF_X,
        (row + 0.5) * 2.0 * HALF_Y / ROWS - HALF_Y,
    )


def plan_work(robots: int, seconds: float, wall_limit: float, seed: int = 0) -> Work:
    """The work for a team; equal arguments give equal work.

    Raises:
        ValueError: if there are more robots than cells.
    """
    if not 1 <= robots <= MOST:
        raise ValueError(f"robots must be from 1 to {MOST}, not {robots}")
    dice = random.Random(f"work {seed}")
    cells = [(column, row) for column in range(COLUMNS) for row in range(ROWS)]
    dice.shuffle(cells)
    starts = [(*_middle(*cell), dice.uniform(-math.pi, math.pi)) for cell in cells[:robots]]
    periods = math.ceil((WARM_UP + seconds) / COMMAND_PERIOD)
    commands = [tuple((_speed(dice), _speed(dice)) for _ in range(robots)) for _ in range(periods)]
    return Work(
        robots=robots,
        seconds=seconds,
        wall_limit=wall_limit,
        warm_up=WARM_UP,
        half_x=HALF_X,
        half_y=HALF_Y,
        boxes=arena(seed),
        starts=tuple(starts),
        command_period=COMMAND_PERIOD,
        commands=tuple(commands),
    )


def _speed(dice: random.Random) -> float:
    return round(dice.uniform(-TOP_SPEED, TOP_SPEED), 3)


def write_world(folder: Path, work: Work) -> Path:
    """Write the work's hall as a world folder of our server; returns it."""
    world = folder / "peer_arena"
    world.mkdir(parents=True, exist_ok=True)
    geoms = [
        f'    <geom type="box" pos="{_numbers(box.center)}" size="{_numbers(box.half)}" '
        f'euler="0 0 {math.degrees(box.yaw):.9g}"/>\n'
        for box in work.boxes
    ]
    (world / "scene.xml").write_text(
        '<mujoco model="peer_arena">\n  <worldbody>\n'
        f'    <geom type="plane" size="0 0 1" friction="{FLOOR_FRICTION:g}"/>\n'
        f"{''.join(geoms)}  </worldbody>\n</mujoco>\n",
        encoding="utf-8",
    )
    starts = [
        f'[[start]]\ntag = "Start{number}"\nposition = [{x:.9g}, {y:.9g}, 0.25]\n'
        f"yaw_degrees = {math.degrees(yaw):.9g}\n"
        for number, (x, y, yaw) in enumerate(work.starts, start=1)
    ]
    bounds = f"{work.half_x:.9g}, {work.half_y:.9g}"
    (world / "world.toml").write_text(
        'title = "Hall of the comparison"\n[bounds]\n'
        f"lower = [-{bounds.replace(', ', ', -')}, -2.0]\nupper = [{bounds}, 30.0]\n"
        f"{''.join(starts)}",
        encoding="utf-8",
    )
    return world


def write_robots(folder: Path) -> Path:
    """Write our robot class of the comparison, `ROVER`, into a folder; returns it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{ROVER}.toml").write_text(_rover(), encoding="utf-8")
    return folder


def _rover() -> str:
    names = ["GndTruth", "InsTest", "TachTest", "W1", "W2", "battery", "Odometer", "Camera"]
    return (
        f'name = "{ROVER}"\nextends = "P3AT"\nwithout = {json.dumps(names)}\nsensor = [\n'
        f'  {{ type = "SICK", name = "lms200", position = [{LASER[0]}, 0, -0.2], '
        f"max_range = {REACH}, interval = {1.0 / LASER_RATE:g} }},\n]\n"
        f"[drive]\nmax_wheel_speed = {TOP_SPEED}\n"
    )


def _numbers(values: tuple[float, ...]) -> str:
    return " ".join(f"{value:.9g}" for value in values)


_SHOWN_ERRORS = 300
_FOREIGN = ("PYTHONPATH", "PYTHONHOME", "PYTHONSTARTUP")


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run of the work."""

    version: str  # of the simulator
    simulated: float  # s of simulated time measured
    wall: float  # s of wall time that they took
    cpu: float  # s of processor time that they took
    counts: Mapping[str, float]  # what was done meanwhile, by name

    @property
    def factor(self) -> float:
        """Simulated s per s of wall time."""
        return ratio(self.simulated, self.wall)

    @property
    def cost(self) -> float:
        """Processor s per simulated s."""
        return ratio(self.cpu, self.simulated)

    def per_second(self, name: str) -> float:
        """A count per simulated s; not a number if it was not counted."""
        return ratio(self.counts.get(name, math.nan), self.simulated)


def ratio(one: float, other: float) -> float:
    """A quotient; not a number where there is none."""
    return one / other if other else math.nan


def read_outcome(text: str) -> Outcome:
    """What a workload wrote.

    Raises:
        BenchError: if it is not what a workload should write.
    """
    try:
        found = json.loads(text)
        outcome = Outcome(
            version=str(found["version"]),
            simulated=float(found["simulated"]),
            wall=float(found["wall"]),
            cpu=float(found["cpu"]),
            counts={str(name): float(value) for name, value in found["counts"].items()},
        )
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        raise BenchError(f"its result is not to be understood: {error!r}") from None
    numbers = (outcome.simulated, outcome.wall, outcome.cpu)
    if not all(math.isfinite(number) for number in numbers) or min(numbers[:2]) <= 0.0:
        raise BenchError(f"its result has impossible times: {', '.join(map(str, numbers))}")
    return outcome


def run_workload(
    command: Sequence[str],
    work: str,
    timeout: float,
    after: Sequence[str] = (),
    foreign: bool = True,
) -> Outcome:
    """Run a program with the work's file and the result's file as arguments.

    Whatever it started is ended with it.

    Args:
        command: program and first arguments.
        work: text of the work's file.
        timeout: s of wall time after which it is killed.
        after: arguments behind the two files.
        foreign: keep our Python paths from it.

    Raises:
        BenchError: if it fails, takes too long or writes no result; with what it said last.
    """
    with tempfile.TemporaryDirectory(prefix="usarsim-peers-") as name:
        given, result = Path(name, "work.json"), Path(name, "result.json")
        given.write_text(work, encoding="utf-8")
        line = [*command, str(given), str(result), *after]
        hidden = _FOREIGN if foreign else ()
        environment = {key: value for key, value in os.environ.items() if key not in hidden}
        code, said = _run(line, timeout, environment, name if foreign else None)
        if code != 0:
            raise BenchError(f"it ended with code {code}: {said}")
        try:
            return read_outcome(result.read_text(encoding="utf-8"))
        except OSError:
            raise BenchError(f"it wrote no result: {said}") from None


def _run(
    line: Sequence[str], timeout: float, environment: Mapping[str, str], folder: str | None
) -> tuple[int, str]:
    try:
        process = subprocess.Popen(
            line,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        )
    except OSError as error:
        raise BenchError(f"it cannot be started: {error.strerror}") from None
    with process:
        try:
            _, errors = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            raise BenchError(f"it took more than {timeout:g} s") from None
        finally:
            # A workload may have processes of its own; the session's leader may be gone already.
            _kill_group(process.pid)
    return process.returncode, _last_words(errors)


def _kill_group(group: int) -> None:
    """Kill what is left of a process group that we started."""
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(group, signal.SIGKILL)


def _last_words(errors: str) -> str:
    lines = [line.strip() for line in errors.splitlines() if line.strip()]
    return lines[-1][-_SHOWN_ERRORS:] if lines else "it said nothing"
