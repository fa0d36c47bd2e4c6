"""Reads machinery of a world folder: `[[door]]`, `[[belt]]`, `[[lift]]`, `[[obstacle]]`."""

from __future__ import annotations

import itertools
import math

from usarsim_server.fields import Limits
from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.tables import Table
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
FARTHEST = 1e5
"""m from the origin."""
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
        doors=table.all("door", _door),
        belts=table.all("belt", _belt),
        lifts=table.all("lift", _lift),
        obstacles=table.all("obstacle", _obstacle),
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
    opener = table.choice("opens", OPENERS, OPENERS[0])
    if sliding and opener == "push":
        raise table.error(
            "opens", "a sliding door cannot be pushed open", 'write kind = "hinged", or "approach"'
        )
    width = table.number("width", 1.0, low=0.2, high=LARGEST)
    leaves = table.count("leaves", 1, low=1, high=2)
    if leaves == 2 and table.has("side"):
        raise table.error("side", "a door with two leaves opens to both sides", "leave it out")
    if sliding:
        travel = table.number("travel", width / leaves, low=0.05, high=width)
    else:
        travel = math.radians(table.number("angle_degrees", 90.0, low=-170.0, high=170.0))
        if abs(travel) < math.radians(5.0):
            raise table.error("angle_degrees", "does not open", "write 90.0, or -90.0")
    return Door(
        name=name,
        pose=_place(table),
        width=width,
        height=table.number("height", 2.0, low=0.1, high=LARGEST),
        thickness=table.number("thickness", 0.05, low=SMALLEST, high=1.0),
        sliding=sliding,
        leaves=leaves,
        left=table.choice("side", SIDES, SIDES[0]) == "left",
        travel=travel,
        mechanism=(
            _spring(table, width / leaves) if opener == "push" else _drive(table, sliding, opener)
        ),
        material=table.word("material", "wood"),
    )


def _drive(table: Table, sliding: bool, opener: str) -> Drive:
    if sliding:
        speed = table.number("speed", 0.7, low=0.01, high=FASTEST)
        acceleration = table.number("acceleration", 1.5, low=0.05, high=20.0)
    else:
        speed = math.radians(table.number("speed_degrees", 60.0, low=1.0, high=360.0))
        acceleration = 2.0 * speed
    return Drive(
        speed=speed,
        acceleration=acceleration,
        reach=_reach(table, 2.0) if opener == "approach" else 0.0,
        hold=table.number("hold", 2.0, low=0.0, high=LONGEST),
        timetable=_timetable(table) if opener == "timetable" else None,
    )


def _spring(table: Table, width: float) -> Spring:
    mass = table.number("mass", LEAF_WEIGHT, low=0.1, high=1000.0)
    stiffness = table.number("spring", LEAF_SPRING, low=0.0, high=1000.0)
    # So that it closes without swinging: a thin plate on a hinge, critically damped.
    critical = 2.0 * math.sqrt(max(stiffness, 0.1) * mass * width * width / 3.0)
    return Spring(
        mass=mass,
        stiffness=stiffness,
        damping=table.number("damping", critical, low=0.01, high=10_000.0),
        both_ways=table.flag("both_ways", False),
    )


def _timetable(table: Table) -> Timetable:
    duration = table.number("duration", low=0.1, high=LONGEST)
    period = table.number("period", 0.0, low=0.0, high=LONGEST)
    if 0.0 < period <= duration:
        raise table.error(
            "period", f"{period} is not longer than the duration {duration}", "write a longer one"
        )
    return Timetable(table.number("delay", 0.0, low=0.0, high=LONGEST), duration, period)


# -- belts, lifts, obstacles -------------------------------------------------------------------


def _belt(table: Table) -> Belt:
    name = table.word("name")
    belt = Belt(
        name=name,
        tag=table.word("tag", name),
        pose=_place(table, table.number("slope_degrees", 0.0, low=-60.0, high=60.0)),
        size=_size(table),
        speed=table.number("speed", low=-FASTEST, high=FASTEST),
        friction=table.number("friction", 1.0, low=0.0, high=10.0),
        material=table.word("material", "rubber"),
    )
    if belt.speed == 0.0:
        raise table.error("speed", "a belt at 0 m/s is a table", "write its speed in m/s")
    return belt


def _lift(table: Table) -> Lift:
    called = table.choice("runs", RUNS, RUNS[0]) == "load"
    return Lift(
        name=table.word("name"),
        yaw=math.radians(table.number("yaw_degrees", 0.0)),
        size=_size(table),
        stops=_points(table, "stops"),
        called=called,
        pause=table.number("pause", 2.0 if called else 5.0, low=0.1, high=LONGEST),
        reach=_reach(table, 1.5) if called else 0.0,
        speed=table.number("speed", 0.3, low=0.01, high=FASTEST),
        acceleration=table.number("acceleration", 0.5, low=0.05, high=5.0),
        material=table.word("material", "metal"),
    )


def _obstacle(table: Table) -> Obstacle:
    points = _points(table, "points")
    way = table.choice("way", WAYS, WAYS[0])
    ahead = table.flag("faces_ahead", False)
    if ahead and table.has("yaw_degrees"):
        raise table.error("yaw_degrees", "stands beside faces_ahead", "keep one of the two")
    obstacle = Obstacle(
        name=table.word("name"),
        shape=table.choice("shape", SHAPES, SHAPES[0]),
        size=_size(table),
        points=points,
        speeds=_speeds(table, len(points) - (way != "ring")),
        way=way,
        pause=table.number("pause", 1.0 if ahead else 0.0, low=0.0, high=LONGEST),
        delay=table.number("delay", 0.0, low=0.0, high=LONGEST),
        ahead=ahead,
        yaw=math.radians(table.number("yaw_degrees", 0.0)),
        distance=table.number("distance", 0.0, low=0.0, high=10.0),
        material=table.word("material", "plastic"),
    )
    if ahead and obstacle.pause < 0.1:
        raise table.error("pause", "leaves no time to turn round", "write at least 0.1 s")
    if way == "ring" and math.dist(points[0], points[-1]) < NEAREST:
        raise table.error("points", "the last is the first", "leave it out; a ring closes itself")
    return obstacle


def _speeds(table: Table, legs: int) -> tuple[float, ...]:
    value = table.raw("speed")
    if not isinstance(value, list):
        return (table.number("speed", 0.5, low=0.01, high=FASTEST),) * legs
    if len(value) != legs:
        raise table.error(
            "speed", f"{len(value)} speeds for {legs} ways", "write one for each way, or one number"
        )
    return table.numbers("speed", low=0.01, high=FASTEST)


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
    x, y, z = (table.check_number(key, one, Limits(-FARTHEST, FARTHEST, unit="m")) for one in value)
    return x, y, z


def _size(table: Table) -> Vector:
    return table.vector("size", low=SMALLEST, high=LARGEST)


def _reach(table: Table, default: float) -> float:
    return table.number("range", default, low=0.1, high=20.0)


def _place(table: Table, slope: float = 0.0) -> Pose:
    yaw = math.radians(table.number("yaw_degrees", 0.0))
    turn = quaternion_from_rpy(0.0, -math.radians(slope), yaw)
    return Pose(table.vector("position"), turn)
