"""The helper of the soccer robots: it knows where the ball is (protocol reference 4.5).

Only one client's reader is known of the original (RDK). It shifts the position by a fixed offset,
which makes sense for a place on the field and not for one relative to a robot; so Pos3D is the
place in the world.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.protocol.numbers import vector
from usarsim_server.protocol.values import Dialect, Segment, Vector
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.human_motion import within_cone
from usarsim_server.sensors.registry import register
from usarsim_server.sensors.sight import in_sight, sight_lines
from usarsim_server.simulation.frames import flip_point
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["BallHelper"]


@register("Helper")
class BallHelper(Sensor):
    """Place of a ball and whether it can be seen from here; silent in a world without it.

    Parameters: `object` (name of the ball's body in the scene), `fov` (rad, full cone),
    `max_range` (m).
    """

    wire_type: ClassVar[str] = "Helper"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        read = self.parameters
        name = read.raw("object")
        if name is not None and not isinstance(name, str):
            raise read.error("object", f"{name!r} is not a name", 'for example object = "ball"')
        self.ball = name or "ball"
        self.fov = read.number("fov", math.tau, above=0.0, maximum=math.tau)
        self.max_range = read.number("max_range", 20.0, above=0.0)
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
