"""What a world is, as plain values. `loader.py` reads them from a world folder.

Poses in world files and here are in the simulation frame: x forward, y left, z up, metres.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as plain_field
from pathlib import Path

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy, wire_from_pose
from usarsim_server.simulation.ground import Surface
from usarsim_server.worlds.machinery.machinery import Machinery, read_heading
from usarsim_server.worlds.polygons import Corner

POSTURES = ("standing", "sitting", "lying")

PARTS = ("Head", "Arm", "Hand", "Chest", "Pelvis", "Leg", "Foot")
"""The body parts that a victim sensor can name (robots reference 2.9)."""

MAX_TAG_ID = 2**31 - 1
"""Clients read tag numbers into 32-bit integers."""

MAX_LOUDNESS = 194.0
"""dB: the loudest undistorted sound in air."""

HEADING = ("yaw_degrees", "a number", "0", "heading; or `rotation_degrees = [roll, pitch, yaw]`")
_FACING = (
    *HEADING[:3],
    "where the person faces, or where the feet point; or `rotation_degrees` "
    "(roll 180: lying face down)",
)
"""The rows of a page for what `read_pose` reads beside the position."""

LOWER: Vector = (-1000.0, -1000.0, -50.0)
UPPER: Vector = (1000.0, 1000.0, 200.0)
"""Bounds (m) of a world that names none."""

_MAX_SIZE = 10_000.0
_DAY = 86400.0
"""s."""


def read_pose(table: Table, key: str = "position") -> Pose:
    """Position and `yaw_degrees`, or `rotation_degrees` as roll, pitch, yaw (x ahead, z up)."""
    position = table.vector(key)
    if table.has("rotation_degrees"):
        if table.has("yaw_degrees"):
            problem = "stands beside yaw_degrees"
            raise table.error("rotation_degrees", problem, "keep one of the two")
        turn = table.vector("rotation_degrees")
    else:
        turn = (0.0, 0.0, table.number("yaw_degrees", 0.0))
    return Pose(position, quaternion_from_rpy(*map(math.radians, turn)))


def _read_memory(table: Table, key: str) -> str:
    text = table.text(key, "", lines=True)
    if not text.isascii() or not (text.isprintable() or not text) or set(text) & set("{}"):
        problem = f"{text!r} cannot travel on the wire"
        raise table.error(key, problem, "use plain text without braces")
    return text


@dataclass(frozen=True, slots=True)
class StartPose:
    """A place where robots may start."""

    tag: str = field(
        parse=Table.word,
        expects="a name",
        help="what INIT calls it; no two alike, whatever their capitals",
    )
    pose: Pose = field(
        key="position",
        parse=read_pose,
        expects="3 numbers in m",
        help="0.25 m above the floor; the robot is let down",
        rows=(HEADING,),
    )
    turns: int = field(
        default=0,
        low=-1000,
        high=1000,
        help="whole turns added to the yaw that clients are told: the original passed on whatever "
        "angle its editor had saved (worlds reference 2.3)",
    )

    @property
    def announced(self) -> tuple[Vector, Vector]:
        """Location (m) and roll, pitch, yaw (rad) on the wire."""
        location, (roll, pitch, yaw) = wire_from_pose(self.pose)
        return location, (roll, pitch, yaw + math.tau * self.turns)


@dataclass(frozen=True, slots=True)
class Victim:
    """A person to be found; what the server knows of its properties is read by `life.traits_of`."""

    name: str = field(
        parse=Table.word,
        expects="a name",
        help="clients know `MaleVictim_0`, `FemaleVictim_1`, ...",
    )
    pose: Pose = field(
        key="position",
        parse=read_pose,
        expects="3 numbers in m",
        help="of the pelvis: 0.93 m above the ground for `standing`, 0.12 m for `sitting` and "
        "`lying`",
        rows=(_FACING,),
    )
    posture: str = field(choices=POSTURES, help="of the figure")
    status: str = field(
        default="Alive",
        parse=Table.word,
        expects="a word",
        help="told by victim sensors: Alive, Injured, Unconscious, Dead, ...",
    )
    properties: Mapping[str, object] = field(
        factory=dict, help="free table, see [Signs of life](#signs-of-life)"
    )
    scale: float = field(
        default=1.0,
        low=0.1,
        high=10.0,
        help="size of the figure, 1 is an adult of 1.70 m; multiply the height of the pelvis, too",
    )


@dataclass(frozen=True, slots=True)
class Noise:
    """A sound that comes again and again."""

    loudness: float = field(
        default=70.0,
        unit="dB",
        low=0.0,
        high=MAX_LOUDNESS,
        help="1 m away; it falls by 6 dB with every doubling of the distance",
    )
    duration: float = field(
        default=1.0, unit="s", low=0.01, high=3600.0, help="that it lasts; victims: 1.5"
    )
    period: float = field(
        default=0.0,
        unit="s",
        low=0.0,
        high=_DAY,
        help="from one beginning to the next; 0: it sounds once (victims: 6); equal to "
        "`duration`: all the time",
    )
    delay: float = field(
        default=0.0, unit="s", low=0.0, high=_DAY, help="before the first; victims: differs"
    )


@dataclass(frozen=True, slots=True)
class SoundSource:
    """A noise at a place."""

    position: Vector = field(unit="m", help="place of the source")
    noise: Noise = plain_field(default_factory=Noise)


@dataclass(frozen=True, slots=True)
class RfidTag:
    """An RFID tag: unique number, place, text in its memory."""

    id: int = field(low=0, high=MAX_TAG_ID, help="no two alike, victims' tags included")
    position: Vector = field(unit="m", help="place of the tag")
    memory: str = field(
        default="", parse=_read_memory, expects="text without braces", help="text in the tag"
    )
    single_shot: bool = field(
        default=False, help="every reader hears the tag only once, from within 1 m"
    )


@dataclass(frozen=True, slots=True)
class FalseAlarm:
    """A box that victim sensors sometimes take for part of a victim."""

    part: str = field(choices=PARTS, help="what they take it for")
    lower: Vector = field(unit="m", help="one corner of the box")
    upper: Vector = field(unit="m", help="the opposite corner, above `lower` along each axis")


@dataclass(frozen=True, slots=True)
class SmokeVolume:
    """Regional smoke: it weakens light along the way through it.

    The part of the light that gets through s metres is exp(-density s); an object is seen from
    about 3.9 / density metres away (Koschmieder's contrast of 2 %).
    """

    name: str = field(help="no two alike")
    shape: str = field(absent="box", choices=("box", "ellipsoid"), help="of the body")
    pose: Pose = field(
        key="position",
        parse=read_heading,
        expects="3 numbers in m",
        help="its middle",
        rows=(("yaw_degrees", "a number", "0", "heading of the body"),),
    )
    size: Vector = field(
        unit="m", above=0.0, high=_MAX_SIZE, help="full extents along its own axes"
    )
    density: float = field(
        unit="1/m",
        low=1e-6,
        high=100.0,
        help="`exp(-density * metres)` of the light gets through; one sees about 3.9 / density "
        "metres far",
    )


@dataclass(frozen=True, slots=True)
class SmokePuff:
    """Local smoke: particles that light does not get through."""

    name: str = field(help="no two alike")
    position: Vector = field(unit="m", help="middle of the cloud")
    size: Vector = field(unit="m", above=0.0, high=_MAX_SIZE, help="its full extents")
    particles: int = field(default=60, low=1, high=5000, help="how many there are at a time")
    radius: float = field(
        # 32 Unreal units, as the particles of the original had (robots reference 1.12).
        default=0.128,
        unit="m",
        low=0.001,
        high=10.0,
        help="of a particle, as in the original",
    )
    seed: int = field(default=0, low=0, high=2**31, help="chooses the places of the particles")
    lifetime: float = field(
        default=0.0,
        unit="s",
        low=0.0,
        high=3600.0,
        help="0: the particles stand still; else the time in which one rises through the cloud, "
        "from a narrow foot to the full width at the top, where it starts again. The original's "
        "fires had 200 particles that lived for 10 s",
    )


@dataclass(frozen=True, slots=True)
class Haze:
    """Global smoke: it weakens light everywhere below a height."""

    name: str = field(help="no two alike")
    density: float = field(unit="1/m", low=1e-6, high=100.0, help="as of a volume")
    top: float = field(default=math.inf, unit="m", help="height up to which it reaches")


@dataclass(frozen=True, slots=True)
class Smoke:
    """All smoke of a world."""

    volumes: tuple[SmokeVolume, ...] = ()  # regional smoke
    puffs: tuple[SmokePuff, ...] = ()  # local smoke
    haze: float = 0.0  # density everywhere below `haze_top`, 1/m
    haze_top: float = math.inf  # m

    @property
    def clear(self) -> bool:
        """Whether there is none."""
        return not (self.volumes or self.puffs or self.haze)


@dataclass(frozen=True, slots=True)
class Zone:
    """A named area of the floor, for example a difficulty zone; where several lie on one another
    the first one counts."""

    name: str = field(help="no two alike")
    kind: str = field(help="such as yellow, orange, red or blue")
    x: tuple[float, float] = field(parse=Table.interval, expects="[from, to]", help="m")
    y: tuple[float, float] = field(
        parse=Table.interval,
        expects="[from, to]",
        help="m",
        rows=(("polygon", "a list of [x, y]", "", "corners in m, instead of `x` and `y`"),),
    )
    polygon: tuple[Corner, ...] = ()
    floor: float = field(default=0.0, unit="m", help="height of its floor, for the strip")
    strip: bool = field(
        default=False,
        help="paint a strip of the zone's colour on its walls and along its border; "
        "of yellow, orange, red and blue zones",
    )

    @property
    def corners(self) -> tuple[Corner, ...]:
        """Of the area; `x` and `y` are its bounds."""
        (west, east), (south, north) = self.x, self.y
        return self.polygon or ((west, south), (east, south), (east, north), (west, north))


@dataclass(frozen=True, slots=True)
class PathNode:
    """A node of the walking graph."""

    tag: str = field(parse=Table.word, expects="a name", help="no two alike")
    position: Vector = field(unit="m", help="on the floor")
    neighbours: tuple[str, ...] = field(
        default=(), parse=Table.words, expects="a list of names", help="tags of other nodes"
    )


@dataclass(frozen=True, slots=True)
class NamedObject:
    """A thing of the scene that has a history: what it was called in the map it comes from."""

    name: str = field(help="of its body or first geom in the scene, unique")
    original: str = field(default="", help="name in the map; several things may share one")
    tag: str = field(default="", help="in the map")
    kind: str = field(default="", help="class in the map")
    movable: bool = field(default=False, help="it can be pushed")


@dataclass(frozen=True, slots=True)
class GeographicOrigin:
    """Latitude and longitude of the wire frame's origin.

    Defaults: 39 deg 8.0273 min north, 77 deg 12.998 min west (robots reference 2.6).
    """

    latitude: float = field(
        default=39.0 + 8.0273 / 60.0,
        unit="degrees",
        low=-90.0,
        high=90.0,
        help="of (0, 0), north is positive",
    )
    longitude: float = field(
        default=-(77.0 + 12.998 / 60.0),
        unit="degrees",
        low=-180.0,
        high=180.0,
        help="of (0, 0), east is positive",
    )


@dataclass(frozen=True, slots=True)
class WorldDescription:
    """One world.

    Attributes:
        name: folder name, also the default Level of the greeting.
        level: map name told to clients.
        title: one line for listings.
        description: a paragraph.
        folder: the world folder.
        scene: MJCF file with the geometry.
        starts, victims, zones, path_nodes: see there.
        tags, sounds, false_alarms: what sensors of life find, beside the victims.
        smoke: what weakens or stops light; sound passes.
        surfaces: patches of water, mud, sand, ice.
        machinery: doors, belts, lifts and moving obstacles.
        objects: things of the scene with their names in the map they come from.
        origin: geographic origin.
        north: wire-frame yaw of map north, rad (0: the x axis points north).
        time_limit: minutes, told in the greeting; 0 means none.
        lower, upper: corners of the box that robots start in, and aircraft stay in, m.
        extra: remaining top-level tables, for rooms that come later.
    """

    name: str
    level: str
    title: str
    description: str
    folder: Path
    scene: Path
    starts: tuple[StartPose, ...]
    victims: tuple[Victim, ...] = ()
    zones: tuple[Zone, ...] = ()
    path_nodes: tuple[PathNode, ...] = ()
    origin: GeographicOrigin = GeographicOrigin()
    north: float = 0.0
    time_limit: int = 20
    lower: Vector = LOWER
    upper: Vector = UPPER
    extra: Mapping[str, object] = plain_field(default_factory=dict)
    tags: tuple[RfidTag, ...] = ()
    sounds: tuple[SoundSource, ...] = ()
    false_alarms: tuple[FalseAlarm, ...] = ()
    smoke: Smoke = Smoke()
    surfaces: tuple[Surface, ...] = ()
    machinery: Machinery = Machinery()  # noqa: RUF009 - immutable
    objects: tuple[NamedObject, ...] = ()

    def objects_called(self, original: str) -> tuple[NamedObject, ...]:
        """All things that had this name or tag in the map, whatever its capitals."""
        wanted = original.strip().lower()
        return tuple(
            thing
            for thing in self.objects
            if wanted in (thing.original.lower(), thing.name.lower(), thing.tag.lower())
        )

    def start(self, tag: str) -> StartPose | None:
        """The first start pose with this tag, whatever its case; None if there is none."""
        wanted = tag.strip().lower()
        return next((start for start in self.starts if start.tag.lower() == wanted), None)
