"""What a world is, as plain values. `loader.py` reads them from a world folder.

Poses in world files and here are in the simulation frame: x forward, y left, z up, metres.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from usarsim_server.simulation.frames import Pose, Vector, wire_from_pose
from usarsim_server.simulation.ground import Surface
from usarsim_server.worlds.machinery.machinery import Machinery


@dataclass(frozen=True, slots=True)
class StartPose:
    """A place where robots may start.

    Attributes:
        tag: what INIT's Start names (no blanks).
        pose: in the world.
        turns: whole turns that the announced yaw is beyond [-pi, pi]: the original passed on
            whatever angle its editor had saved (worlds reference 2.3).
    """

    tag: str
    pose: Pose
    turns: int = 0

    @property
    def announced(self) -> tuple[Vector, Vector]:
        """Location (m) and roll, pitch, yaw (rad) on the wire."""
        location, (roll, pitch, yaw) = wire_from_pose(self.pose)
        return location, (roll, pitch, yaw + math.tau * self.turns)


@dataclass(frozen=True, slots=True)
class Victim:
    """A person to be found.

    Attributes:
        name: unique in the world.
        pose: of the body's reference point (the pelvis) in the world.
        posture: standing, sitting or lying.
        status: for example Alive, Injured, Unconscious or Dead.
        properties: free keys; those that the server knows (sound, co2, rfid, motion, figure) are
            read by `life.traits_of`.
        scale: size; 1 is an adult of 1.70 m.
    """

    name: str
    pose: Pose
    posture: str
    status: str
    properties: Mapping[str, object] = field(default_factory=dict)
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Noise:
    """A sound that comes again and again.

    Attributes:
        loudness: sound level 1 m away, dB.
        duration: s that it lasts.
        period: s from one beginning to the next; 0: it sounds once.
        delay: s of simulated time before the first.
    """

    loudness: float
    duration: float
    period: float = 0.0
    delay: float = 0.0


@dataclass(frozen=True, slots=True)
class SoundSource:
    """A noise at a place."""

    position: Vector
    noise: Noise


@dataclass(frozen=True, slots=True)
class RfidTag:
    """An RFID tag: unique number, place, text in its memory.

    `single_shot` tags answer every reader only once, and only from near.
    """

    id: int
    position: Vector
    memory: str = ""
    single_shot: bool = False


@dataclass(frozen=True, slots=True)
class FalseAlarm:
    """A box (opposite corners, m) that victim sensors sometimes take for part of a victim."""

    part: str
    lower: Vector
    upper: Vector


@dataclass(frozen=True, slots=True)
class SmokeVolume:
    """Regional smoke: it weakens light along the way through it.

    Attributes:
        name: for the author.
        shape: box or ellipsoid.
        pose: of its middle.
        size: full extents along its own axes, m.
        density: 1/m. The part of the light that gets through s metres is exp(-density s); an
            object is seen from about 3.9 / density metres away (Koschmieder's contrast of 2 %).
    """

    name: str
    shape: str
    pose: Pose
    size: Vector
    density: float


@dataclass(frozen=True, slots=True)
class SmokePuff:
    """Local smoke: particles that light does not get through.

    Attributes:
        name: for the author.
        position: middle of the cloud.
        size: its full extents, m.
        particles: how many there are at a time.
        radius: of a particle, m.
        seed: chooses their places.
        lifetime: s that a particle takes from the foot of the cloud to its top, where it vanishes
            and another starts; 0: they stand still.
    """

    name: str
    position: Vector
    size: Vector
    particles: int
    radius: float
    seed: int
    lifetime: float = 0.0


@dataclass(frozen=True, slots=True)
class Smoke:
    """All smoke of a world.

    Attributes:
        volumes: regional smoke.
        puffs: local smoke.
        haze: density everywhere below `haze_top`, 1/m.
        haze_top: m.
    """

    volumes: tuple[SmokeVolume, ...] = ()
    puffs: tuple[SmokePuff, ...] = ()
    haze: float = 0.0
    haze_top: float = math.inf

    @property
    def clear(self) -> bool:
        """Whether there is none."""
        return not (self.volumes or self.puffs or self.haze)


@dataclass(frozen=True, slots=True)
class Zone:
    """A named rectangle of the floor, for example a difficulty zone: x and y limits in metres."""

    name: str
    kind: str
    x: tuple[float, float]
    y: tuple[float, float]


@dataclass(frozen=True, slots=True)
class PathNode:
    """A node of the walking graph."""

    tag: str
    position: Vector
    neighbours: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class NamedObject:
    """A thing of the scene that has a history: what it was called in the map it comes from.

    Attributes:
        name: of its body or first geom in the scene, unique.
        original: name in the map; several things may share one.
        tag: in the map, empty if there is none.
        kind: class in the map.
        movable: it can be pushed.
    """

    name: str
    original: str
    tag: str = ""
    kind: str = ""
    movable: bool = False


@dataclass(frozen=True, slots=True)
class GeographicOrigin:
    """Latitude and longitude (degrees, north and east positive) of the wire frame's origin.

    Defaults: 39 deg 8.0273 min north, 77 deg 12.998 min west (robots reference 2.6).
    """

    latitude: float = 39.0 + 8.0273 / 60.0
    longitude: float = -(77.0 + 12.998 / 60.0)


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
    lower: Vector = (-1000.0, -1000.0, -50.0)
    upper: Vector = (1000.0, 1000.0, 200.0)
    extra: Mapping[str, object] = field(default_factory=dict)
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
