"""Acceleration of the robot by finite differences, as the original computed it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.snapshot import RobotState

__all__ = ["AccelerationMeter"]

Array = NDArray[np.float64]


class AccelerationMeter:
    """Mean acceleration of the robot's reference point between calls.

    Attributes:
        value: (3,) in the simulation's world frame, m/s^2, without gravity.
        ready: whether two calls at different times have been made.
    """

    def __init__(self) -> None:
        self.value: Array = np.zeros(3)
        self.ready = False
        self._time: float | None = None
        self._velocity: Array = np.zeros(3)

    def update(self, robot: RobotState) -> float:
        """Take one sample; returns the seconds since the last one, 0 for the first."""
        velocity = np.array(robot.linear_velocity)
        elapsed = 0.0 if self._time is None else robot.time - self._time
        if elapsed > 0.0:
            self.value = (velocity - self._velocity) / elapsed
            self.ready = True
        if self._time is None or elapsed > 0.0:
            self._time, self._velocity = robot.time, velocity
        return elapsed
