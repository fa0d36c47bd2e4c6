"""Speed and angle of all driven wheels (robots reference 2.4)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from usarsim_server.protocol.numbers import fixed, ranges
from usarsim_server.protocol.values import Dialect, Segment
from usarsim_server.robots.description import ItemDescription
from usarsim_server.sensors.base import Sensor, SensorContext, SetResult
from usarsim_server.sensors.registry import register
from usarsim_server.sensors.wheels import has_wheel_sensors
from usarsim_server.simulation.rays.fans import RayHits
from usarsim_server.simulation.snapshot import RobotState

__all__ = ["Tachometer"]

Array = NDArray[np.float64]


@register("Tachometer")
class Tachometer(Sensor):
    """Vel: mean spin since the last report (rad/s); Pos: angle since start or RESET (rad).

    As in the original, Pos is the state at the last report and so lags by one interval. The first
    report has no interval to look back on and gives the momentary spin.
    """

    wire_type: ClassVar[str] = "Tachometer"
    timed: ClassVar[frozenset[Dialect]] = frozenset({Dialect.UDK})
    intervals: ClassVar[Mapping[Dialect, float]] = {Dialect.UT2004: 0.2, Dialect.UDK: 0.2}

    def __init__(self, item: ItemDescription, context: SensorContext) -> None:
        super().__init__(item, context)
        wheels = len(context.robot.driven_wheels)
        self._works = has_wheel_sensors(context.robot) and wheels > 0
        self._time = 0.0
        self._angles: Array | None = None
        self._turned: Array = np.zeros(wheels)
        self._vel: Array = np.zeros(wheels)
        self._pos: Array = np.zeros(wheels)

    def measure(self, robot: RobotState, hits: Sequence[RayHits]) -> bool:
        """Keep mean spins and lagging angles."""
        if not self._works:
            return False
        angles = np.array(robot.wheel_angles, dtype=np.float64)
        if self._angles is None:
            self._vel = np.array(robot.wheel_speeds, dtype=np.float64)
        elif robot.time > self._time:
            self._vel = (angles - self._angles) / (robot.time - self._time)
            self._pos = self._turned
            self._turned = self._turned + (angles - self._angles)
        self._angles, self._time = angles, robot.time
        return True

    def data(self, dialect: Dialect) -> tuple[Segment, ...]:
        """Vel and Pos, four digits, wheels in part order."""
        return (("Vel", ranges(self._vel, 4)), ("Pos", ranges(self._pos, 4)))

    def configuration(self, dialect: Dialect) -> tuple[Segment, ...]:
        """ScanInterval."""
        return (("ScanInterval", fixed(self.interval(dialect), 4)),)

    def set(self, opcode: str, params: str, robot: RobotState) -> SetResult:
        """RESET makes the present angles zero."""
        if opcode != "RESET":
            return SetResult.UNKNOWN
        self._angles = np.array(robot.wheel_angles, dtype=np.float64)
        self._time = robot.time
        self._turned = np.zeros(len(self._angles))
        self._pos = self._turned
        return SetResult.OK
