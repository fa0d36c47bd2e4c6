"""Detectors of moving people (robots reference 2.9).

Only the form of the message is known of the original; the model here is a starting value. Like a
pyroelectric detector it is surer of what is near and moves fast.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

from usarsim_server.protocol.numbers import fixed
from usarsim_server.protocol.values import Dialect, Segment, Vector
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.registry import register
from usarsim_server.sensors.sight import in_sight, relative, sight_lines
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["HumanMotionSensor", "within_cone"]


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

    Parameters: `max_range` (m), `fov` (rad, full cone), `full_speed` (m/s).
    """

    wire_type: ClassVar[str] = "HumanMotion"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        self.max_range = read.number("max_range", 5.0, above=0.0)
        self.fov = read.number("fov", math.radians(100.0), above=0.0, maximum=math.tau)
        self.full_speed = read.number("full_speed", 0.3, above=0.0)
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
