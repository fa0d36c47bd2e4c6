"""What is in front of the robot: objects (robots reference 2.9, protocol reference 4.6), and the
ball of the soccer robots (protocol reference 4.5).

Only one client's reader is known of the original's ball helper (RDK). It shifts the position by a
fixed offset, which makes sense for a place on the field and not for one relative to a robot; so
Pos3D is the place in the world.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from usarsim_server.base.fields import field
from usarsim_server.protocol.messages.text import token
from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import NOWHERE, Sensor, SensorContext, register
from usarsim_server.sensors.people import in_sight, sight_lines, within_cone
from usarsim_server.sensors.ranges import fan_at, wire_directions
from usarsim_server.sensors.scanners import MIN_RESOLUTION, beam_count, check_resolution
from usarsim_server.simulation.frames import Vector, flip_point, wire_from_pose
from usarsim_server.simulation.objects import ObjectFacts
from usarsim_server.simulation.rays.query import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState


@register("Helper")
class BallHelper(Sensor):
    """Place of a ball and whether it can be seen from here; silent in a world without it."""

    wire_type: ClassVar[str] = "Helper"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    ball: str = field(default="ball", key="object", help="name of the ball's body in the scene")
    fov: float = field(default=math.tau, above=0.0, high=math.tau, unit="rad", help="full cone")
    max_range: float = field(default=20.0, above=0.0, unit="m")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._objects = context.objects
        self._place: Vector | None = None
        self.visible = False

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray to the middle of the ball."""
        facts = self._objects(self.ball, robot.snapshot)
        self._place = None if facts is None else facts.pose.position
        return () if self._place is None else sight_lines(self.world_pose(robot), [self._place])

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep place and visibility; False if there is no ball."""
        if self._place is None:
            return False
        pose = self.world_pose(robot)
        free = in_sight(pose, [self._place], hits)[0]
        self.visible = free and within_cone(pose, self._place, self.fov, self.max_range)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Pos3D in the world, and Visible, the only boolean in lower case."""
        place = flip_point(self._place or (0.0, 0.0, 0.0))
        return (("Pos3D", vector(place, 2)), ("Visible", "true" if self.visible else "false"))


@dataclass(frozen=True, slots=True)
class _Sighting:
    facts: ObjectFacts
    point: Vector
    """Where the first beam met it, m in the world."""


@register("ObjectSensor")
class ObjectSensor(Sensor):
    """Lists each object that a small fan of beams meets, once, in the order from right to left.

    An object is a piece of the scenery, a movable body, a victim or another robot. Things without
    a name in the scene are not listed. All poses and points are in the world frame.
    """

    wire_type: ClassVar[str] = "ObjectSensor"
    timed: ClassVar[frozenset[Dialect]] = NOWHERE
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.5, Dialect.UDK: 0.5}
    scans = True

    fov: float = field(default=0.174, above=0.0, high=7.0, unit="rad")
    resolution: float = field(default=0.017, low=MIN_RESOLUTION, unit="rad", help="between beams")
    max_range: float = field(default=1000.0, above=0.0, unit="m")

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        check_resolution(self.parameters, self.resolution, self.fov)
        self.beams = beam_count(self.fov, self.resolution)
        steps = np.arange(self.beams, dtype=np.float64)
        self._directions = wire_directions(self.fov / 2 - self.resolution * steps)
        self._look_up = context.objects
        self._seen: tuple[_Sighting, ...] = ()

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """One ray per beam, to be identified."""
        pose = self.world_pose(robot)
        return (fan_at(pose, self._directions, self.max_range, identify=True),)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep what is seen."""
        answer, pose = hits[0], self.world_pose(robot)
        seen: dict[tuple[str, int | None], _Sighting] = {}
        for beam, name in enumerate(answer.names or ()):
            facts = None if name is None else self._look_up(name, robot.snapshot)
            if facts is None or (facts.name, facts.robot) in seen:
                continue
            along = self._directions[beam] * answer.distances[beam]
            x, y, z = (pose.matrix() @ along + np.array(pose.position)).tolist()
            seen[facts.name, facts.robot] = _Sighting(facts, (x, y, z))
        self._seen = tuple(seen.values())
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Object, Location, Orientation, HitLoc and Material of every object, two digits."""
        return tuple(segment for sighting in self._seen for segment in _segments(sighting))


def _segments(sighting: _Sighting) -> tuple[Segment, ...]:
    facts = sighting.facts
    location, orientation = wire_from_pose(facts.pose)
    return (
        ("Object", token(facts.name)),
        ("Location", vector(location, 2)),
        ("Orientation", vector(orientation, 2)),
        ("HitLoc", vector(flip_point(sighting.point), 2)),
        ("Material", "None" if facts.material is None else token(facts.material)),
    )
