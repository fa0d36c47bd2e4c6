"""Tracks: a belt around rollers, as robot files describe it and as a shape.

Seen from the side a belt is the convex hull of its rollers: straight runs that touch two rollers
from outside, and arcs. Whatever it touches it drags along its own direction, so a belt that drives
the robot ahead pulls its front down onto a step and the step under the robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from usarsim_server.base.fields import field
from usarsim_server.base.tables import Table
from usarsim_server.protocol.values import Vector
from usarsim_server.robots.description import ActuatorDescription, home_pose
from usarsim_server.robots.keys import (
    CHANNELS,
    LONGEST,
    ORIGIN,
    POINT,
    Color,
    read_link,
)
from usarsim_server.robots.reading.parts import read_all
from usarsim_server.simulation.frames import Pose

SMALLEST = 1e-3
"""m: smallest radius and width."""
_EXACT = 1e-9
"""m: rollers in line touch the same run."""
RUBBER: Color = (0.08, 0.08, 0.08, 1.0)


def _up(down: float) -> float:
    return 0.0 - down


@dataclass(frozen=True, slots=True)
class Roller:
    """What a belt runs around; its axis lies ahead of and above the origin of the track's frame."""

    radius: float = field(low=SMALLEST, high=LONGEST, unit="m")
    x: float = field(default=0.0, low=-LONGEST, high=LONGEST, unit="m")
    z: float = field(default=0.0, low=-LONGEST, high=LONGEST, unit="m", convert=_up)


@dataclass(frozen=True, slots=True)
class Run:
    """A straight part of a belt, in the plane of its track (x ahead, z up, m)."""

    start: tuple[float, float]
    """Where it leaves one roller and meets the next, in the direction in which the belt moves when
    the robot is driven ahead."""
    end: tuple[float, float]
    normal: tuple[float, float]  # unit vector that points outwards
    depth: float  # radius of the smaller one of the two rollers

    @property
    def length(self) -> float:
        """m."""
        return math.dist(self.start, self.end)


@dataclass(frozen=True, slots=True)
class Track:
    """One belt."""

    side: str  # `left` or `right`; the sprocket of that side drives it
    link: str | None  # name of the link that carries it, such as a flipper; None: the chassis
    rollers: tuple[Roller, ...]  # at least two
    width: float = field(low=SMALLEST, high=LONGEST, unit="m")
    position: Vector = field(
        default=ORIGIN,
        **POINT,
        help="of the track's frame relative to the link or to the reference point",
    )
    friction: float = field(
        default=1.0, low=0.0, high=100.0, help="against ground that has none of its own"
    )
    color: Color = field(default=RUBBER, **CHANNELS)

    def place(self, actuators: Sequence[ActuatorDescription]) -> Pose:
        """Pose of its frame relative to the reference point when the robot appears."""
        return home_pose(actuators, self.link) @ Pose(self.position)


def runs(rollers: Sequence[Roller]) -> tuple[Run, ...]:
    """The straight parts of the belt around rollers, in no particular order.

    The belt runs clockwise in a picture with x to the right and z upwards, so that it moves back
    where it lies on the ground.
    """
    found: dict[tuple[int, int], Run] = {}
    for one in rollers:
        for other in rollers:
            run = _tangent(one, other)
            if run is None or not all(_inside(run, roller) for roller in rollers):
                continue
            # Rollers in line: the longest of all tangents with one direction covers the others.
            key = (round(run.normal[0] * 1e6), round(run.normal[1] * 1e6))
            if key not in found or run.length > found[key].length:
                found[key] = run
    return tuple(found.values())


def touching(rollers: Sequence[Roller]) -> tuple[Roller, ...]:
    """The rollers that the belt touches."""
    straight = runs(rollers)
    return tuple(
        roller for roller in rollers if any(_reach(run, roller) > -_EXACT for run in straight)
    )


def lowest(track: Track, actuators: Sequence[ActuatorDescription]) -> float:
    """Height of the track's lowest point above the reference point when the robot appears, m."""
    place = track.place(actuators)
    level = math.hypot(*place.rotate((0.0, 1.0, 0.0))[:2])
    return place.position[2] + min(
        place.rotate((roller.x, 0.0, roller.z))[2] - roller.radius * level
        for roller in track.rollers
    )


def _tangent(one: Roller, other: Roller) -> Run | None:
    """The outer tangent from a roller to another, with both on its right; None if there is none."""
    along, up = other.x - one.x, other.z - one.z
    apart = math.hypot(along, up)
    if apart <= abs(one.radius - other.radius) + _EXACT:
        return None
    sine = (one.radius - other.radius) / apart
    cosine = math.sqrt(1.0 - sine * sine)
    normal = (
        (sine * along - cosine * up) / apart,
        (sine * up + cosine * along) / apart,
    )
    start, end = (
        (roller.x + roller.radius * normal[0], roller.z + roller.radius * normal[1])
        for roller in (one, other)
    )
    return Run(start, end, normal, min(one.radius, other.radius))


def _reach(run: Run, roller: Roller) -> float:
    """How far a roller stands out beyond a run, m; negative if it stays inside."""
    (x, z), (across, up) = run.start, run.normal
    return (roller.x - x) * across + (roller.z - z) * up + roller.radius


def _inside(run: Run, roller: Roller) -> bool:
    return _reach(run, roller) <= _EXACT


def read_tracks(
    reader: Table,
    parent: Sequence[Track],
    actuators: Sequence[ActuatorDescription],
) -> tuple[Track, ...]:
    """`[[track]]` tables; without any, those of the robot that is extended.

    Raises:
        RobotDescriptionError: if one cannot be used, or a side has none.
    """
    links = [link.body for actuator in actuators for link in actuator.links]
    if reader.has("track"):
        tracks = tuple(_track(table, links, actuators) for table in reader.tables("track"))
    else:
        tracks = tuple(parent)
    for track in tracks:
        if track.link is not None and track.link not in links:
            raise reader.error(
                "track",
                f"an inherited one sits on {track.link!r}, which is gone",
                "keep the link's name, or describe the tracks anew",
            )
    for side in ("left", "right"):
        if not any(track.side == side for track in tracks):
            raise reader.error("track", f"no track on the {side}", "add a [[track]] table there")
    return tracks


def _track(table: Table, links: Sequence[str], actuators: Sequence[ActuatorDescription]) -> Track:
    track = table.read(
        Track,
        side="",
        link=read_link(table, links),
        rollers=read_all(table.tables("roller"), Roller),
    )
    if len(runs(track.rollers)) < 2:
        raise table.error(
            "roller",
            f"{len(track.rollers)} rollers do not hold a belt",
            "write at least two, none of them inside another",
        )
    track = replace(track, side=_side(table, track.place(actuators).position[1]))
    table.finish()
    return track


def _side(table: Table, y: float) -> str:
    """Which side drives the belt: said, or that on which it stands."""
    sides = ("left", "right")
    if abs(y) < _EXACT:
        return table.choice("side", sides)
    by_position = "left" if y > 0.0 else "right"
    side = table.choice("side", sides, by_position)
    if side != by_position:
        raise table.error("side", f"is {side!r}, but the track is on the {by_position}", "drop it")
    return side
