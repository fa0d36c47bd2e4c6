"""Wheel servos of all robots at once: speed ramps and parking brakes.

The velocity actuators of the model do the torque; here their set points are shaped, as a motor
controller would: they follow the commanded wheel speed with limited acceleration, and after a
while at zero the wheel is held at its angle, so that a robot parked on a slope does not creep
(robots reference 4.4).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.model import CompiledWorld

__all__ = ["WheelServos"]

HOLD_GAIN = 10.0
"""1/s: wheel speed asked for per radian of displacement while the brake holds."""
HOLD_SPEED = 2.0
"""rad/s: the brake never asks for more."""

Array = NDArray[np.float64]


class WheelServos:
    """Set points of every driven wheel of one model generation; used by the physics thread."""

    def __init__(self, world: CompiledWorld) -> None:
        first = np.cumsum([0, *(len(layout.wheel_actuators) for layout in world.layouts)])
        self._span = [slice(int(a), int(b)) for a, b in pairwise(first)]
        self._actuators = _join([layout.wheel_actuators for layout in world.layouts])
        self._angles = _join([layout.wheel_qpos for layout in world.layouts])
        count = len(self._actuators)
        counts = [len(layout.wheel_actuators) for layout in world.layouts]
        step = world.model.opt.timestep
        self._increment = (
            np.repeat([slot.wheel_acceleration for slot in world.slots], counts) * step
        )
        self._delay = np.repeat([slot.brake_delay for slot in world.slots], counts)
        self._timestep = float(step)
        self._target = np.zeros(count)
        self._setpoint = np.zeros(count)
        self._idle = np.zeros(count)
        self._hold = np.full(count, np.nan)
        self._engaged = np.zeros(count, dtype=bool)
        self._steady = True

    def command(self, slot: int, targets: Array) -> None:
        """Set the wheel speed targets (rad/s) of a slot, in part order."""
        self._target[self._span[slot]] = targets
        self._engaged[self._span[slot]] = True
        self._steady = False

    def release(self, slot: int) -> None:
        """Forget everything about a slot: its wheels stand still without a brake."""
        span = self._span[slot]
        for array in (self._target, self._setpoint, self._idle):
            array[span] = 0.0
        self._hold[span] = np.nan
        self._engaged[span] = False
        self._steady = False

    def targets(self, slot: int) -> Array:
        """Commanded wheel speeds of a slot (rad/s)."""
        copy: Array = self._target[self._span[slot]].copy()
        return copy

    def adopt(self, other: WheelServos) -> None:
        """Take over the state of the same slots of the previous generation."""
        for name in ("_target", "_setpoint", "_idle", "_hold", "_engaged"):
            old = getattr(other, name)
            getattr(self, name)[: len(old)] = old
        self._steady = False

    def update(self, qpos: Array, ctrl: Array) -> None:
        """Advance all set points by one time step and write the actuator controls."""
        if self._steady:
            return
        change = np.clip(self._target - self._setpoint, -self._increment, self._increment)
        self._setpoint += change
        still = (self._setpoint == 0.0) & (self._target == 0.0) & self._engaged
        self._idle = np.where(still, self._idle + self._timestep, 0.0)
        braked = still & (self._idle >= self._delay)
        angles = qpos[self._angles]
        self._hold = np.where(braked, np.where(np.isnan(self._hold), angles, self._hold), np.nan)
        back = np.clip(HOLD_GAIN * (self._hold - angles), -HOLD_SPEED, HOLD_SPEED)
        ctrl[self._actuators] = np.where(braked, back, self._setpoint)
        # While every wheel runs at its commanded speed there is nothing to update.
        self._steady = not (change.any() or still.any())


def _join(parts: list[NDArray[np.intp]]) -> NDArray[np.intp]:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)
