"""Range finders with one ray along the mount axis (robots reference 2.2)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import SensorContext
from usarsim_server.sensors.fans import AHEAD, fan_at
from usarsim_server.sensors.ranging import SingleRange
from usarsim_server.sensors.registry import register
from usarsim_server.sensors.smoke import SmokeSight
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["InfraredSensor", "RangeSensor"]


@register("RangeSensor")
class RangeSensor(SingleRange):
    """One ray; the minimum range is announced but not applied.

    Parameters: those of `Ranging`; `smoke` and `smoke_budget`, see `SmokeSight`.
    Source: RangeSensor.uc of robocup-usarsim, whose item type is `Range`.
    """

    wire_type: ClassVar[str] = "Range"
    default_max_range: ClassVar[float] = 3.0
    through_glass: ClassVar[bool] = False

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        self._sight = SmokeSight(self.parameters, context, "ignore")

    def rays(self, robot: RobotState) -> Sequence[RayFan]:
        """The single ray along the mount axis."""
        pose = self.world_pose(robot)
        fan = fan_at(pose, AHEAD, self.max_range, through_glass=self.through_glass)
        return (self._sight.send(fan, robot.time),)

    def distance(self, hits: Sequence[RayHits]) -> float:
        """The distance as it is, or as smoke lets it appear."""
        distances = self._sight.receive(hits[0].distances)
        return float(self._sight.blank(self.echoes(distances))[0])


@register("IR", "IRSensor")
class InfraredSensor(RangeSensor):
    """Looks through glass and keeps its reading within both limits."""

    wire_type: ClassVar[str] = "IR"
    default_min_range: ClassVar[float] = 0.2
    default_max_range: ClassVar[float] = 1.5
    through_glass: ClassVar[bool] = True

    def distance(self, hits: Sequence[RayHits]) -> float:
        """The distance, at least the minimum range."""
        return max(super().distance(hits), self.min_range)

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """The limits; UDK sent the pair twice (protocol reference 4.8), and so do we there."""
        return self.limits() * 2 if dialect is Dialect.UDK else self.limits()
