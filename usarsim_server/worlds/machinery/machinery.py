"""What moves in a building: doors, belts, lifts, obstacles, as plain values and as a file has them.

`bodies.py` puts them into a scene; `doors.py`, `lifts.py` and `obstacles.py` run them. Angles are
radians, lengths metres.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

from usarsim_server.base.fields import Limits, field
from usarsim_server.base.tables import Table
from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy

KINDS = ("sliding", "hinged")
OPENERS = ("approach", "timetable", "push")
SIDES = ("left", "right")
RUNS = ("timetable", "load")

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


@dataclass(frozen=True, slots=True)
class Timetable:
    """Something that is so from `delay` on for `duration`, again every `period`; 0: only once."""

    delay: float = field(absent=0.0, unit="s", low=0.0, high=LONGEST, help="before the first time")
    duration: float = field(unit="s", low=0.1, high=LONGEST, help="that it stays open")
    period: float = field(
        absent=0.0, unit="s", low=0.0, high=LONGEST, help="from one opening to the next; 0: once"
    )

    def holds(self, time: float) -> bool:
        """Whether it is so at a simulated time (s)."""
        passed = time - self.delay
        if self.period > 0.0 and passed >= 0.0:
            passed %= self.period
        return 0.0 <= passed < self.duration


@dataclass(frozen=True, slots=True)
class Drive:
    """What opens and closes a door."""

    speed: float  # of a leaf, m/s or rad/s
    acceleration: float  # m/s^2 or rad/s^2
    reach: float  # whoever is nearer than this (m) on either side opens it
    hold: float  # s that it stays open when nobody is near any more, or after it met something
    timetable: Timetable | None = None  # when it is open; None: whenever somebody is near


@dataclass(frozen=True, slots=True)
class Spring:
    """What closes a door that is pushed open."""

    damping: float  # N m s/rad
    mass: float = field(absent=LEAF_WEIGHT, unit="kg", low=0.1, high=1000.0, help="of a leaf")
    stiffness: float = field(
        absent=LEAF_SPRING,
        key="spring",
        unit="N m/rad",
        low=0.0,
        high=1000.0,
        help="that closes it",
    )
    both_ways: bool = field(default=False, help="it opens to either side")


@dataclass(frozen=True, slots=True)
class Door:
    """A door."""

    name: str  # unique in the world
    pose: Pose  # of the middle of the doorway on the floor; one goes through along x
    width: float  # of the doorway
    height: float
    thickness: float  # of a leaf
    sliding: bool  # its leaves slide along y; otherwise they hang on hinges at the sides
    leaves: int  # 1 or 2
    left: bool  # a single leaf slides to the left, or hangs on the left, as seen along x
    travel: float
    """How far a leaf opens, m or rad; hinged leaves turn toward x, or away if negative."""
    mechanism: Drive | Spring  # drive or spring
    material: str  # of the leaves


def _read_points(table: Table, key: str) -> tuple[Vector, ...]:
    value = table.raw(key)
    wanted = f"a list of places such as {key} = [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]"
    if not isinstance(value, list) or not all(isinstance(one, list) for one in value):
        raise table.error(key, f"{value!r} is no list of places", f"write {wanted}")
    if not 2 <= len(value) <= MOST_POINTS:
        raise table.error(key, f"{len(value)} of them", f"write 2 to {MOST_POINTS} places")
    points = tuple(_read_point(table, key, one) for one in value)
    for number, (one, other) in enumerate(itertools.pairwise(points), start=1):
        if math.dist(one, other) < NEAREST:
            problem = f"places {number} and {number + 1} are nearer than {NEAREST} m"
            raise table.error(key, problem, "leave one of them out")
    return points


def _read_point(table: Table, key: str, value: list[object]) -> Vector:
    if len(value) != 3:
        raise table.error(key, f"{value!r} is no place", "write three numbers: x, y, z in metres")
    x, y, z = (table.check_number(key, one, Limits(-FARTHEST, FARTHEST, unit="m")) for one in value)
    return x, y, z


def read_heading(table: Table, key: str = "position", slope: float = 0.0) -> Pose:
    """Position and `yaw_degrees`, rising along x by a slope (rad)."""
    yaw = math.radians(table.number("yaw_degrees", 0.0))
    return Pose(table.vector(key), quaternion_from_rpy(0.0, -slope, yaw))


def _read_place(table: Table, key: str) -> Pose:
    slope = table.number("slope_degrees", 0.0, low=-60.0, high=60.0)
    return read_heading(table, key, math.radians(slope))


@dataclass(frozen=True, slots=True)
class Belt:
    """A conveyor belt, which runs along x."""

    name: str = field(parse=Table.word, expects="a name", help="unique in the world")
    tag: str = field(
        absent="",
        parse=Table.word,
        expects="a name",
        help="what [CONTROL Conveyor](world-controller.md) calls it, its name unless written; "
        "belts of one tag obey together",
    )
    pose: Pose = field(
        key="position",
        parse=_read_place,
        expects="3 numbers in m",
        help="middle of its top",
        rows=(
            ("yaw_degrees", "a number", "0", "where it runs to"),
            ("slope_degrees", "a number from -60 to 60", "0", "how steeply it rises"),
        ),
    )
    size: Vector = field(unit="m", low=SMALLEST, high=LARGEST, help="length, width, thickness")
    speed: float = field(unit="m/s", low=-FASTEST, high=FASTEST, help="negative: backward")
    friction: float = field(absent=1.0, low=0.0, high=10.0, help="of its surface")
    material: str = field(
        absent="rubber", parse=Table.word, expects="a material", help="its looks, see above"
    )

    @property
    def geom(self) -> str:
        """Name of its geom: the name, or `tag:name` (see `simulation/ground.py`)."""
        return self.name if self.tag == self.name else f"{self.tag}:{self.name}"


@dataclass(frozen=True, slots=True)
class Lift:
    """A platform that goes from stop to stop and back."""

    name: str = field(parse=Table.word, expects="a name", help="unique in the world")
    yaw: float = field(absent=0.0, key="yaw_degrees", convert=math.radians, help="of the platform")
    size: Vector = field(unit="m", low=SMALLEST, high=LARGEST, help="length, width, thickness")
    stops: tuple[Vector, ...] = field(
        parse=_read_points,
        expects="a list of places",
        help="two or more of the middle of its top; it begins at the first. Sideways is fine, too",
    )
    called: bool = field(
        absent=False,
        key="runs",
        parse=lambda table, key: table.choice(key, RUNS) == "load",
        expects=f"one of {', '.join(RUNS)}",
        shown='"timetable"',
        help="there and back through all stops; `load`: when something is on it, and to where "
        "somebody waits",
    )
    pause: float = field(
        absent=5.0,
        unit="s",
        low=0.1,
        high=LONGEST,
        help="at a stop; `load`: after something has come onto it, by default 2",
    )
    reach: float = field(
        absent=1.5,
        key="range",
        unit="m",
        low=0.1,
        high=20.0,
        help="`load`: beside a stop in which a robot waits for it",
    )
    speed: float = field(absent=0.3, unit="m/s", low=0.01, high=FASTEST, help="at the most")
    acceleration: float = field(absent=0.5, unit="m/s^2", low=0.05, high=5.0, help="and braking")
    material: str = field(
        absent="metal", parse=Table.word, expects="a material", help="its looks, see above"
    )


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Something that goes its way: there and back, round, or once."""

    name: str = field(parse=Table.word, expects="a name", help="unique in the world")
    shape: str = field(absent="box", choices=("box", "cylinder", "sphere"), help="of its body")
    size: Vector = field(unit="m", low=SMALLEST, high=LARGEST, help="extents along its own axes")
    points: tuple[Vector, ...] = field(
        parse=_read_points,
        expects="a list of places",
        help="of the middle of its underside; it begins at the first",
    )
    speeds: tuple[float, ...] = field(
        absent=(0.5,),
        key="speed",
        parse=lambda table, key: table.raw(key),
        expects=f"a number from 0.01 to {FASTEST:g} m/s, or a list",
        shown="0.5",
        help="a list has one for each way from point to point, in a ring also back to the first",
    )
    way: str = field(
        absent="back and forth",
        choices=("back and forth", "ring", "once"),
        help="a ring goes from the last point straight to the first",
    )
    pause: float = field(absent=0.0, unit="s", low=0.0, high=LONGEST, help="at every point")
    delay: float = field(absent=0.0, unit="s", low=0.0, high=LONGEST, help="before it sets out")
    ahead: bool = field(
        absent=False,
        key="faces_ahead",
        help="it turns to where it goes, in the pauses (1 s if you do not say)",
    )
    yaw: float = field(
        absent=0.0,
        key="yaw_degrees",
        convert=math.radians,
        help="heading of what does not face ahead",
    )
    distance: float = field(
        absent=0.0,
        unit="m",
        low=0.0,
        high=10.0,
        help="it waits while anything is nearer before it; 0: it waits for nobody and pushes",
    )
    material: str = field(
        absent="plastic", parse=Table.word, expects="a material", help="its looks, see above"
    )


@dataclass(frozen=True, slots=True)
class Machinery:
    """Everything that moves in the building of a world."""

    doors: tuple[Door, ...] = ()
    belts: tuple[Belt, ...] = ()
    lifts: tuple[Lift, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()


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
        pose=read_heading(table),
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
        reach=table.number("range", 2.0, low=0.1, high=20.0) if opener == "approach" else 0.0,
        hold=table.number("hold", 2.0, low=0.0, high=LONGEST),
        timetable=_timetable(table) if opener == "timetable" else None,
    )


def _spring(table: Table, width: float) -> Spring:
    spring = table.read(Spring, damping=0.0)
    # So that it closes without swinging: a thin plate on a hinge, critically damped.
    critical = 2.0 * math.sqrt(max(spring.stiffness, 0.1) * spring.mass * width * width / 3.0)
    return replace(spring, damping=table.number("damping", critical, low=0.01, high=10_000.0))


def _timetable(table: Table) -> Timetable:
    times = table.read(Timetable)
    if 0.0 < times.period <= times.duration:
        problem = f"{times.period} is not longer than the duration {times.duration}"
        raise table.error("period", problem, "write a longer one")
    return times


def _belt(table: Table) -> Belt:
    belt = table.read(Belt)
    if belt.speed == 0.0:
        raise table.error("speed", "a belt at 0 m/s is a table", "write its speed in m/s")
    return belt if belt.tag else replace(belt, tag=belt.name)


def _lift(table: Table) -> Lift:
    if table.raw("runs") != "load":
        return table.read(Lift, reach=0.0)
    lift = table.read(Lift)
    return lift if table.has("pause") else replace(lift, pause=2.0)


def _obstacle(table: Table) -> Obstacle:
    one = table.read(Obstacle)
    if one.ahead and table.has("yaw_degrees"):
        raise table.error("yaw_degrees", "stands beside faces_ahead", "keep one of the two")
    if one.ahead and not table.has("pause"):
        one = replace(one, pause=1.0)
    if one.ahead and one.pause < 0.1:
        raise table.error("pause", "leaves no time to turn round", "write at least 0.1 s")
    if one.way == "ring" and math.dist(one.points[0], one.points[-1]) < NEAREST:
        raise table.error("points", "the last is the first", "leave it out; a ring closes itself")
    return replace(one, speeds=_speeds(table, len(one.points) - (one.way != "ring")))


def _speeds(table: Table, legs: int) -> tuple[float, ...]:
    value = table.raw("speed")
    if not isinstance(value, list):
        return (table.number("speed", 0.5, low=0.01, high=FASTEST, unit="m/s"),) * legs
    if len(value) != legs:
        cure = "write one for each way, or one number"
        raise table.error("speed", f"{len(value)} speeds for {legs} ways", cure)
    return table.numbers("speed", low=0.01, high=FASTEST, unit="m/s")
