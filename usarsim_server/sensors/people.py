"""Sensors of people: the victim sensor of the UT2004 generation, detectors of motion, lines of
sight (robots reference 2.9, protocol reference 4.6).

The victim sensor looks for people with the rays of a grid. A quarter of the grid is probed at each
interval, so a report is complete, and sent, at every fourth. Of the detector of moving people only
the form of the message is known of the original; the model here is a starting value: like a
pyroelectric detector it is surer of what is near and moves fast.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.fields import field
from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.values import Dialect, Item, Segment, Vector
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext, register
from usarsim_server.sensors.ranges import fan_at, wire_directions
from usarsim_server.simulation.frames import Pose, flip_point
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState
from usarsim_server.worlds.description import PARTS, FalseAlarm
from usarsim_server.worlds.victims import part_of

Array = NDArray[np.float64]

FOV = math.radians(40.0)
STEP = math.radians(4.0)
"""rad; VictSensor.uc."""

PATTERNS = ((0.0, 0.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5))
"""Shifts of the four quarters of the grid, in steps of yaw and pitch. Source: VictSensor.uc."""

MAX_PAIRS = 16
"""Most parts of one line, the nearest victims first: lines stay below 1024 bytes (protocol
reference 6.7 number 107)."""

MARGIN = 0.2
"""m: what a ray meets this near its end belongs to what it was sent to, such as a head to a
mouth."""


def relative(sensor: Pose, point: Vector) -> Vector:
    """A point of the world in the sensor's wire frame, m."""
    return flip_point((sensor.inverse() @ Pose(point)).position)


def sight_lines(sensor: Pose, points: Sequence[Vector]) -> tuple[RayFan, ...]:
    """The fan with one ray to each point; no fan for no points."""
    if not points:
        return ()
    origin = np.array(sensor.position)
    ways = np.array(points) - origin
    lengths = np.linalg.norm(ways, axis=1)
    there = lengths < 1e-6
    ways[there] = (1.0, 0.0, 0.0)
    directions = ways / np.where(there, 1.0, lengths)[:, None]
    return (RayFan(origin, directions, max(float(lengths.max()), MARGIN), identify=True),)


def in_sight(
    sensor: Pose,
    points: Sequence[Vector],
    hits: Sequence[RayHits],
    victims: Sequence[str | None] | None = None,
) -> list[bool]:
    """Which points can be seen.

    Args:
        sensor: as for `sight_lines`.
        points: as for `sight_lines`.
        hits: the answers to the fan.
        victims: for each point the victim that it belongs to, if any; nobody hides himself.
    """
    if not points:
        return []
    lengths = np.linalg.norm(np.array(points) - np.array(sensor.position), axis=1)
    free = [bool(far) for far in hits[0].distances >= lengths - MARGIN]
    names = hits[0].names
    if victims is None or names is None:
        return free
    return [
        seen or (victim is not None and _belongs(name, victim))
        for seen, name, victim in zip(free, names, victims, strict=True)
    ]


def _belongs(geom: str | None, victim: str) -> bool:
    found = None if geom is None else part_of(geom)
    return found is not None and found[0] == victim


@register("VictSensor")
class VictimSensor(Sensor):
    """Names the body parts that are in view, left and right ones apart, and where they are.

    Locations are those of the parts' centres in the sensor's frame, each axis with a Gaussian
    error in proportion to the distance. Boxes of the world file (`[[false_alarm]]`) are taken for
    parts now and then, the more often the farther away they are. Clients know no `Head`, so a
    head in view is left out (protocol reference 4.6).
    """

    wire_type: ClassVar[str] = "VictSensor"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}
    announces = (
        ("MaxRange", "max_range"),
        ("HorizontalFOV", "horizontal_fov"),
        ("VerticalFOV", "vertical_fov"),
    )

    max_range: float = field(default=4.0, above=0.0, high=100.0, unit="m")
    horizontal_fov: float = field(default=FOV, above=0.0, high=math.tau, unit="rad")
    vertical_fov: float = field(default=FOV, above=0.0, high=math.pi, unit="rad")
    step: float = field(
        default=STEP, low=0.01, high=math.pi, unit="rad", help="between rays of a quarter of a grid"
    )
    noise: float = field(
        default=0.05, low=0.0, high=1.0, help="standard deviation as a share of the distance"
    )
    send_head: bool = field(default=False, help="for clients that know Head")
    name_without_victims: bool = field(
        default=True, help="false: `{Type VictSensor} {Status NoVictims}`, as the original"
    )

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._life = context.life
        self._victims = {victim.name: victim for victim in self._life.victims}
        self._rng = context.rng
        self._grids = [self._grid(*shift) for shift in PATTERNS]
        self._turn = 0
        self._seen: set[tuple[str, str, str]] = set()
        self._alarms: set[int] = set()
        self._report: list[tuple[str, Vector]] = []

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """The next quarter of the grid."""
        pose = self.world_pose(robot)
        return (fan_at(pose, self._grids[self._turn], self.max_range, identify=True),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Collect what a quarter of the grid has met; report after the fourth."""
        self._collect(hits[0])
        pose = self.world_pose(robot)
        self._collect_alarms(pose, hits[0])
        self._turn = (self._turn + 1) % len(PATTERNS)
        if self._turn:
            return False
        self._report = self._locate(pose, robot.time)
        self._seen.clear()
        self._alarms.clear()
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """PartName and Location, again and again, or Status NoVictims."""
        if not self._report:
            return (("Status", "NoVictims"),)
        pairs = [
            (("PartName", part), ("Location", vector(place, 2))) for part, place in self._report
        ]
        return tuple(segment for pair in pairs for segment in pair)

    def item(self, dialect: Dialect) -> Item:
        """The report; without a name if there is nobody and the robot file wants it so."""
        if self._report or self.name_without_victims:
            return super().item(dialect)
        return Item("", self.data(dialect))

    def _grid(self, yaw_shift: float, pitch_shift: float) -> Array:
        yaws = _angles(self.horizontal_fov, self.step, yaw_shift)
        pitches = _angles(self.vertical_fov, self.step, pitch_shift)
        yaw, pitch = np.meshgrid(yaws, pitches, indexing="ij")
        return wire_directions(yaw.ravel(), pitch.ravel())

    def _collect(self, hits: RayHits) -> None:
        for name in set(hits.names or ()):
            found = None if name is None else part_of(name)
            if name is not None and found is not None:
                side = next((side for side in ("Left", "Right") if name.endswith(side)), "")
                self._seen.add((*found, side))

    def _collect_alarms(self, pose: Pose, hits: RayHits) -> None:
        """Let chance decide about every box in view: one draw for each quarter of the grid."""
        alarms = self._life.false_alarms
        if not alarms:
            return
        origin, directions = np.array(pose.position), self._grids[self._turn] @ pose.matrix().T
        free = np.minimum(hits.distances, self.max_range)
        for index, alarm in enumerate(alarms):
            if (_entry(alarm, origin, directions) < free).any():
                distance = math.dist(_middle(alarm), pose.position)
                error = distance * self.noise * self._rng.standard_normal()
                if abs(error) > self.noise * self.max_range / 3.0:
                    self._alarms.add(index)

    def _locate(self, pose: Pose, time: float) -> list[tuple[str, Vector]]:
        """Parts in view and false alarms with erroneous places, the nearest victims first."""
        groups = [
            [
                (part.name, part.position)
                for part in sorted(victim.parts(time), key=lambda part: PARTS.index(part.name))
                if (name, part.name, part.side) in self._seen
            ]
            for name, victim in self._victims.items()
        ]
        alarms = [self._life.false_alarms[index] for index in sorted(self._alarms)]
        groups += [[(alarm.part, _middle(alarm))] for alarm in alarms]
        wanted = [
            [entry for entry in group if self.send_head or entry[0] != "Head"] for group in groups
        ]
        wanted = [group for group in wanted if group]
        wanted.sort(key=lambda group: math.dist(group[0][1], pose.position))
        found = [entry for group in wanted for entry in group][:MAX_PAIRS]
        return [(part, self._err(relative(pose, place))) for part, place in found]

    def _err(self, place: Vector) -> Vector:
        distance = math.hypot(*place)
        x, y, z = (np.array(place) + distance * self.noise * self._rng.standard_normal(3)).tolist()
        return x, y, z


def _angles(fov: float, step: float, shift: float) -> Array:
    """From one edge of the field of view to the other, or as far as the step reaches."""
    count = math.floor((fov - shift * step) / step + 1e-6) + 1
    angles: Array = fov / 2 - step * (shift + np.arange(max(count, 1), dtype=np.float64))
    return angles


def _middle(alarm: FalseAlarm) -> Vector:
    x, y, z = ((low + high) / 2 for low, high in zip(alarm.lower, alarm.upper, strict=True))
    return x, y, z


def _entry(alarm: FalseAlarm, origin: Array, directions: Array) -> Array:
    """Distances (n,) at which rays enter a box, 0 from inside, inf for a miss (slab method)."""
    safe = np.where(directions == 0.0, 1e-12, directions)
    ends = np.stack(
        [(np.array(alarm.lower) - origin) / safe, (np.array(alarm.upper) - origin) / safe]
    )
    enter, leave = ends.min(axis=0).max(axis=1), ends.max(axis=0).min(axis=1)
    return np.where((enter <= leave) & (leave >= 0.0), np.maximum(enter, 0.0), np.inf)


@dataclass(frozen=True, slots=True)
class _Mover:
    """Somebody who moves: name of a victim, or number of an avatar; place (m) and speed (m/s)."""

    who: str | int
    place: Vector
    speed: float


@register("HumanMotion", "HumanMotionSensor")
class HumanMotionSensor(Sensor):
    """Probability that somebody moves in the field of view; 0 if nobody does.

    It falls linearly from 1 at the sensor to 0 at `max_range`, and with the speed below
    `full_speed`. Walls hide people. Of several people the likeliest counts. Victims and avatars
    are people; an avatar's speed is that since the last reading.
    """

    wire_type: ClassVar[str] = "HumanMotion"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    max_range: float = field(default=5.0, above=0.0, unit="m")
    fov: float = field(
        default=math.radians(100.0), above=0.0, high=math.tau, unit="rad", help="full cone"
    )
    full_speed: float = field(default=0.3, above=0.0, unit="m/s", help="and above is as likely")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._life = context.life
        self._objects = context.objects
        self._victims = [victim for victim in self._life.victims if victim.moves]
        self._before: dict[int, tuple[float, Vector]] = {}
        self._moving: list[_Mover] = []
        self.probability = 0.0

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray to everybody who moves in range and field of view."""
        pose = self.world_pose(robot)
        victims = [_Mover(one.name, *one.motion(robot.time)) for one in self._victims]
        self._moving = [
            one
            for one in (*victims, *self._passers(robot))
            if one.speed > 0.0 and within_cone(pose, one.place, self.fov, self.max_range)
        ]
        return sight_lines(pose, [one.place for one in self._moving])

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the highest probability."""
        pose = self.world_pose(robot)
        names = [one.who if isinstance(one.who, str) else None for one in self._moving]
        seen = in_sight(pose, [one.place for one in self._moving], hits, names)
        met = hits[0].names if hits else ()
        self.probability = max(
            (
                self._likeliness(math.dist(one.place, pose.position), one.speed)
                for one, visible, name in zip(self._moving, seen, met or (), strict=True)
                if visible or self._is_part(name, one, robot)
            ),
            default=0.0,
        )
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Prob, four digits."""
        return (("Prob", fixed(self.probability, 4)),)

    def _passers(self, robot: RobotState) -> list[_Mover]:
        """Avatars, by how far they came since the last reading."""
        before, self._before = self._before, {}
        found = []
        for one in self._life.passers(robot.snapshot):
            since, place = before.get(one.number, (robot.time, one.chest))
            passed = robot.time - since
            speed = math.dist(place, one.chest) / passed if passed > 0.0 else 0.0
            found.append(_Mover(one.number, one.chest, speed))
            self._before[one.number] = robot.time, one.chest
        return found

    def _is_part(self, name: str | None, one: _Mover, robot: RobotState) -> bool:
        """Whether an avatar's own arm is what a ray to his chest met."""
        if name is None or isinstance(one.who, str):
            return False
        facts = self._objects(name, robot.snapshot)
        return facts is not None and facts.robot == one.who

    def _likeliness(self, distance: float, speed: float) -> float:
        return (1.0 - distance / self.max_range) * min(1.0, speed / self.full_speed)


def within_cone(sensor: Pose, point: Vector, fov: float, max_range: float) -> bool:
    """Whether a point is in range and within half the field of view (rad) of the mount axis."""
    x, y, z = relative(sensor, point)
    return math.hypot(x, y, z) <= max_range and math.atan2(math.hypot(y, z), x) <= fov / 2
