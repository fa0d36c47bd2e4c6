"""The true pose, without noise (robots reference 2.5)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

from usarsim_server.protocol.dialects import FACETS
from usarsim_server.protocol.numbers import fixed, vector
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.angles import each_turn
from usarsim_server.sensors.base import Sensor, SensorContext
from usarsim_server.sensors.registry import register
from usarsim_server.simulation.frames import IDENTITY, wire_from_pose
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["GroundTruth", "GroundTruthMovable"]


@register("GroundTruth")
class GroundTruth(Sensor):
    """Pose of the robot's reference point in the world, or of the sensor itself.

    Parameter: `of` = "robot" or "sensor".
    """

    wire_type: ClassVar[str] = "GroundTruth"
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.05, Dialect.UDK: 0.1}
    default_of: ClassVar[str] = "robot"

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self.of = self.parameters.choice("of", self.default_of, ("robot", "sensor"))
        self._location, self._orientation = wire_from_pose(IDENTITY)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep the pose in the wire frame."""
        pose = robot.pose if self.of == "robot" else self.world_pose(robot)
        self._location, self._orientation = wire_from_pose(pose)
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Location and Orientation: two digits and whole turns, or three digits and signed."""
        facets = FACETS[dialect]
        digits = facets.ground_truth_digits
        signed = facets.ground_truth_signed
        orientation = self._orientation if signed else each_turn(self._orientation)
        location = vector(self._location, digits)
        return (("Location", location), ("Orientation", vector(orientation, digits)))

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """ScanInterval."""
        return (("ScanInterval", fixed(self.interval(dialect), 4)),)


@register("GroundTruthMovable")
class GroundTruthMovable(GroundTruth):
    """Pose of the sensor itself; on the wire it is a GroundTruth like the other."""

    default_of: ClassVar[str] = "sensor"
