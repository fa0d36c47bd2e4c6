"""One reading of some sensors of a robot, in two halves: which rays they need, and the lines."""

from __future__ import annotations

from collections.abc import Sequence

from usarsim_server.protocol.values import Dialect
from usarsim_server.sensors.assembly import sen_lines
from usarsim_server.sensors.base import Sensor
from usarsim_server.simulation.rays.fans import RayFan, RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Survey"]


class Survey:
    """A reading under way.

    Attributes:
        fans: the rays of all sensors.
    """

    def __init__(self, sensors: Sequence[Sensor], state: RobotState) -> None:
        """Ask the sensors for their rays.

        Args:
            sensors: in mount order.
            state: of their robot.
        """
        self._sensors = sensors
        self._state = state
        wanted = [sensor.rays(state) for sensor in sensors]
        self._counts = [len(rays) for rays in wanted]
        self.fans: list[RayFan] = [fan for rays in wanted for fan in rays]

    def lines(self, hits: Sequence[RayHits], dialect: Dialect) -> list[str]:
        """Take the readings, given the answers to `fans` in order, and write them down."""
        measured, begin = [], 0
        for sensor, count in zip(self._sensors, self._counts, strict=True):
            if sensor.measure(self._state, hits[begin : begin + count]):
                measured.append(sensor)
            begin += count
        return sen_lines(measured, self._state.time, dialect)
