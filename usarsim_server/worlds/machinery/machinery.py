"""What moves in a building, as plain values: doors, belts, lifts, obstacles.

`machine_tables.py` reads them from a world file, `machine_bodies.py` puts them into a scene,
`doors.py`, `lifts.py` and `obstacles.py` run them. Angles are radians, lengths metres.
"""

from __future__ import annotations

from dataclasses import dataclass

from usarsim_server.simulation.frames import Pose, Vector


@dataclass(frozen=True, slots=True)
class Timetable:
    """Something that is so from `delay` (s) on for `duration` s, again every `period` s.

    A period of 0: only once.
    """

    delay: float
    duration: float
    period: float

    def holds(self, time: float) -> bool:
        """Whether it is so at a simulated time (s)."""
        passed = time - self.delay
        if self.period > 0.0 and passed >= 0.0:
            passed %= self.period
        return 0.0 <= passed < self.duration


@dataclass(frozen=True, slots=True)
class Drive:
    """What opens and closes a door.

    Attributes:
        speed: of a leaf, m/s or rad/s.
        acceleration: m/s^2 or rad/s^2.
        reach: whoever is nearer than this (m) on either side opens it.
        hold: s that it stays open when nobody is near any more, or after it met something.
        timetable: when it is open; None: whenever somebody is near.
    """

    speed: float
    acceleration: float
    reach: float
    hold: float
    timetable: Timetable | None = None


@dataclass(frozen=True, slots=True)
class Spring:
    """What closes a door that is pushed open.

    Attributes:
        mass: of a leaf, kg.
        stiffness: N m/rad.
        damping: N m s/rad.
        both_ways: it opens to either side.
    """

    mass: float
    stiffness: float
    damping: float
    both_ways: bool


@dataclass(frozen=True, slots=True)
class Door:
    """A door.

    Attributes:
        name: unique in the world.
        pose: of the middle of the doorway on the floor; one goes through along x.
        width, height: of the doorway.
        thickness: of a leaf.
        sliding: its leaves slide along y; otherwise they hang on hinges at the sides.
        leaves: 1 or 2.
        left: a single leaf slides to the left, or hangs on the left, as seen along x.
        travel: how far a leaf opens, m or rad; hinged leaves turn toward x, or away if negative.
        mechanism: drive or spring.
        material: of the leaves.
    """

    name: str
    pose: Pose
    width: float
    height: float
    thickness: float
    sliding: bool
    leaves: int
    left: bool
    travel: float
    mechanism: Drive | Spring
    material: str


@dataclass(frozen=True, slots=True)
class Belt:
    """A conveyor belt.

    Attributes:
        name: unique in the world.
        tag: belts of one tag obey together.
        pose: of the middle of its top; it runs along x.
        size: length, width, thickness.
        speed: m/s; negative: backward.
        friction: of its surface.
        material: of it.
    """

    name: str
    tag: str
    pose: Pose
    size: Vector
    speed: float
    friction: float
    material: str

    @property
    def geom(self) -> str:
        """Name of its geom: the name, or `tag:name` (see `simulation/ground.py`)."""
        return self.name if self.tag == self.name else f"{self.tag}:{self.name}"


@dataclass(frozen=True, slots=True)
class Lift:
    """A platform that goes from stop to stop and back.

    Attributes:
        name: unique in the world.
        yaw: of the platform, rad.
        size: length, width, thickness.
        stops: places of the middle of its top; it begins at the first.
        called: it goes when somebody is on it, and comes to who waits; otherwise all the time.
        pause: s at a stop before it goes on, or after somebody has come onto it.
        reach: m beside a stop in which somebody waits for it.
        speed: m/s.
        acceleration: m/s^2.
        material: of it.
    """

    name: str
    yaw: float
    size: Vector
    stops: tuple[Vector, ...]
    called: bool
    pause: float
    reach: float
    speed: float
    acceleration: float
    material: str


@dataclass(frozen=True, slots=True)
class Obstacle:
    """Something that goes its way: there and back, round, or once.

    Attributes:
        name: unique in the world.
        shape: box, cylinder or sphere.
        size: extents along its own axes.
        points: places of the middle of its underside; it begins at the first.
        speeds: m/s on the way to each further point, and in a ring back to the first.
        way: back and forth, ring or once.
        pause: s at every point.
        delay: s before it sets out.
        ahead: it faces where it goes and turns round in the pauses; otherwise it keeps its yaw.
        yaw: rad.
        distance: it waits as long as somebody is nearer than this before it, m; 0: it never does.
        material: of it.
    """

    name: str
    shape: str
    size: Vector
    points: tuple[Vector, ...]
    speeds: tuple[float, ...]
    way: str
    pause: float
    delay: float
    ahead: bool
    yaw: float
    distance: float
    material: str


@dataclass(frozen=True, slots=True)
class Machinery:
    """Everything that moves in the building of a world."""

    doors: tuple[Door, ...] = ()
    belts: tuple[Belt, ...] = ()
    lifts: tuple[Lift, ...] = ()
    obstacles: tuple[Obstacle, ...] = ()
