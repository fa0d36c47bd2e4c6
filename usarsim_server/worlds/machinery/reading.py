"""Reads machinery of a world folder: `[[door]]`, `[[belt]]`, `[[lift]]`, `[[obstacle]]`."""

from __future__ import annotations

import itertools
import math

from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.worlds.machinery.machinery import (
    Belt,
    Door,
    Drive,
    Lift,
    Machinery,
    Obstacle,
    Spring,
    Timetable,
)
from usarsim_server.worlds.tables import Table

KINDS = ("sliding", "hinged")
OPENERS = ("approach", "timetable", "push")
SIDES = ("left", "right")
RUNS = ("timetable", "load")
SHAPES = ("box", "cylinder", "sphere")
WAYS = ("back and forth", "ring", "once")

SMALLEST, LARGEST = 0.02, 50.0
"""m: extents of what moves."""
FASTEST = 5.0
"""m/s."""
LONGEST = 86400.0
"""s."""
MOST_POINTS = 1000
NEAREST = 0.05
"""m between two points of a way."""

LEAF_WEIGHT = 15.0
"""kg: a light door of a flat, 0.9 x 2 m."""
LEAF_SPRING = 3.0
"""N m/rad: a weak door closer, which a robot of 10 kg can push open."""


def read_machinery(table: Table) -> Machinery:
    """All machinery of a world.

    Raises:
        WorldError: naming table, key, what is wrong and what to write instead.
    """
    machinery = Machinery(
        doors=tuple(_door(entry) for entry in table.tables("door")),
        belts=tuple(_belt(entry) for entry in table.tables("belt")),
        lifts=tuple(_lift(entry) for entry in table.tables("lift")),
        obstacles=tuple(_obstacle(entry) for entry in table.tables("obstacle")),
    )
    _check_names(table, machinery)
    return machinery


def _check_names(table: Table, machinery: Machinery) -> None:
    seen: dict[str, str] = {}
    for kind in ("door", "belt", "lift", "obstacle"):
        for number, one in enumerate(getattr(machinery, f"{kind}s"), start=1):
            place = f"[[{kind}]] {number}"
            first = seen.setdefault(one.name.lower(), place)
            if first != place:
                raise table.error(
                    f"{place}: name",
                    f"{one.name!r} is already the name of {first}",
                    "give everything that moves its own name; capitals make no difference",
                )


# -- doors -------------------------------------------------------------------------------------


def _door(table: Table) -> Door:
    name = table.word("name")
    sliding = table.choice("kind", KINDS) == "sliding"
    opener = _choice(table, "opens", OPENERS)
    if sliding and opener == "push":
        raise table.error(
            "opens", "a sliding door cannot be pushed open", 'write kind = "hinged", or "approach"'
        )
    width = table.number("width", default=1.0, low=0.2, high=LARGEST)
    leaves = table.integer("leaves", default=1, low=1, high=2)
    if leaves == 2 and table.has("side"):
        raise table.error("side", "a door with two leaves opens to both sides", "leave it out")
    if sliding:
        travel = table.number("travel", default=width / leaves, low=0.05, high=width)
    else:
        travel = math.radians(table.number("angle_degrees", default=90.0, low=-170.0, high=170.0))
        if abs(travel) < math.radians(5.0):
            raise table.error("angle_degrees", "does not open", "write 90.0, or -90.0")
    door = Door(
        name=name,
        pose=_place(table),
        width=width,
        height=table.number("height", default=2.0, low=0.1, high=LARGEST),
        thickness=table.number("thickness", default=0.05, low=SMALLEST, high=1.0),
        sliding=sliding,
        leaves=leaves,
        left=_choice(table, "side", SIDES) == "left",
        travel=travel,
        mechanism=(
            _spring(table, width / leaves) if opener == "push" else _drive(table, sliding, opener)
        ),
        material=table.word("material", default="wood"),
    )
    table.finish()
    return door


def _drive(table: Table, sliding: bool, opener: str) -> Drive:
    if sliding:
        speed = table.number("speed", default=0.7, low=0.01, high=FASTEST)
        acceleration = table.number("acceleration", default=1.5, low=0.05, high=20.0)
    else:
        speed = math.radians(table.number("speed_degrees", default=60.0, low=1.0, high=360.0))
        acceleration = 2.0 * speed
    return Drive(
        speed=speed,
        acceleration=acceleration,
        reach=_reach(table, 2.0) if opener == "approach" else 0.0,
        hold=table.number("hold", default=2.0, low=0.0, high=LONGEST),
        timetable=_timetable(table) if opener == "timetable" else None,
    )


def _spring(table: Table, width: float) -> Spring:
    mass = table.number("mass", default=LEAF_WEIGHT, low=0.1, high=1000.0)
    stiffness = table.number("spring", default=LEAF_SPRING, low=0.0, high=1000.0)
    # So that it closes without swinging: a thin plate on a hinge, critically damped.
    critical = 2.0 * math.sqrt(max(stiffness, 0.1) * mass * width * width / 3.0)
    return Spring(
        mass=mass,
        stiffness=stiffness,
        damping=table.number("damping", default=critical, low=0.01, high=10_000.0),
        both_ways=table.flag("both_ways", default=False),
    )


def _timetable(table: Table) -> Timetable:
    duration = table.number("duration", default=None, low=0.1, high=LONGEST)
    period = table.number("period", default=0.0, low=0.0, high=LONGEST)
    if 0.0 < period <= duration:
        raise table.error(
            "period", f"{period} is not longer than the duration {duration}", "write a longer one"
        )
    return Timetable(table.number("delay", default=0.0, low=0.0, high=LONGEST), duration, period)


# -- belts, lifts, obstacles -------------------------------------------------------------------


def _belt(table: Table) -> Belt:
    name = table.word("name")
    belt = Belt(
        name=name,
        tag=table.word("tag", default=name),
        pose=_place(table, table.number("slope_degrees", default=0.0, low=-60.0, high=60.0)),
        size=_size(table),
        speed=table.number("speed", default=None, low=-FASTEST, high=FASTEST),
        friction=table.number("friction", default=1.0, low=0.0, high=10.0),
        material=table.word("material", default="rubber"),
    )
    if belt.speed == 0.0:
        raise table.error("speed", "a belt at 0 m/s is a table", "write its speed in m/s")
    table.finish()
    return belt


def _lift(table: Table) -> Lift:
    called = _choice(table, "runs", RUNS) == "load"
    lift = Lift(
        name=table.word("name"),
        yaw=math.radians(table.number("yaw_degrees", default=0.0)),
        size=_size(table),
        stops=_points(table, "stops"),
        called=called,
        pause=table.number("pause", default=2.0 if called else 5.0, low=0.1, high=LONGEST),
        reach=_reach(table, 1.5) if called else 0.0,
        speed=table.number("speed", default=0.3, low=0.01, high=FASTEST),
        acceleration=table.number("acceleration", default=0.5, low=0.05, high=5.0),
        material=table.word("material", default="metal"),
    )
    table.finish()
    return lift


def _obstacle(table: Table) -> Obstacle:
    points = _points(table, "points")
    way = _choice(table, "way", WAYS)
    ahead = table.flag("faces_ahead", default=False)
    if ahead and table.has("yaw_degrees"):
        raise table.error("yaw_degrees", "stands beside faces_ahead", "keep one of the two")
    obstacle = Obstacle(
        name=table.word("name"),
        shape=_choice(table, "shape", SHAPES),
        size=_size(table),
        points=points,
        speeds=_speeds(table, len(points) - (way != "ring")),
        way=way,
        pause=table.number("pause", default=1.0 if ahead else 0.0, low=0.0, high=LONGEST),
        delay=table.number("delay", default=0.0, low=0.0, high=LONGEST),
        ahead=ahead,
        yaw=math.radians(table.number("yaw_degrees", default=0.0)),
        distance=table.number("distance", default=0.0, low=0.0, high=10.0),
        material=table.word("material", default="plastic"),
    )
    if ahead and obstacle.pause < 0.1:
        raise table.error("pause", "leaves no time to turn round", "write at least 0.1 s")
    if way == "ring" and math.dist(points[0], points[-1]) < NEAREST:
        raise table.error("points", "the last is the first", "leave it out; a ring closes itself")
    table.finish()
    return obstacle


def _speeds(table: Table, legs: int) -> tuple[float, ...]:
    value = table.raw("speed")
    if not isinstance(value, list):
        return (table.number("speed", default=0.5, low=0.01, high=FASTEST),) * legs
    if len(value) != legs:
        raise table.error(
            "speed", f"{len(value)} speeds for {legs} ways", "write one for each way, or one number"
        )
    return tuple(_number(table, "speed", one, 0.01, FASTEST) for one in value)


def _points(table: Table, key: str) -> tuple[Vector, ...]:
    value = table.raw(key)
    wanted = f"write a list of places such as {key} = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]"
    if value is None:
        raise table.error(key, "is missing", wanted)
    if not isinstance(value, list) or not all(isinstance(one, list) for one in value):
        raise table.error(key, f"{value!r} is no list of places", wanted)
    if not 2 <= len(value) <= MOST_POINTS:
        raise table.error(key, f"{len(value)} of them", f"write 2 to {MOST_POINTS} places")
    points = [_point(table, key, one) for one in value]
    for number, (one, other) in enumerate(itertools.pairwise(points), start=1):
        if math.dist(one, other) < NEAREST:
            raise table.error(
                key,
                f"places {number} and {number + 1} are nearer than {NEAREST} m",
                "leave one of them out",
            )
    return tuple(points)


def _point(table: Table, key: str, value: list[object]) -> Vector:
    if len(value) != 3:
        raise table.error(key, f"{value!r} is no place", "write three numbers: x, y, z in metres")
    x, y, z = (_number(table, key, one, -1e5, 1e5) for one in value)
    return x, y, z


def _number(table: Table, key: str, value: object, low: float, high: float) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise table.error(key, f"{value!r} is not a number", "write a number")
    if not low <= value <= high:  # what is not finite, too
        raise table.error(key, f"{value} is out of range", f"write a number from {low} to {high}")
    return float(value)


def _size(table: Table) -> Vector:
    size = table.vector("size")
    if not all(SMALLEST <= edge <= LARGEST for edge in size):
        raise table.error(
            "size", f"{size} is out of range", f"write edges from {SMALLEST} to {LARGEST} m"
        )
    return size


def _reach(table: Table, default: float) -> float:
    return table.number("range", default=default, low=0.1, high=20.0)


def _choice(table: Table, key: str, options: tuple[str, ...]) -> str:
    """One of several words, the first if nothing is written."""
    return table.choice(key, options) if table.has(key) else options[0]


def _place(table: Table, slope: float = 0.0) -> Pose:
    yaw = math.radians(table.number("yaw_degrees", default=0.0))
    turn = quaternion_from_rpy(0.0, -math.radians(slope), yaw)
    return Pose(table.vector("position"), turn)
