"""Wheel servos of all robots at once: speed ramps, parking brakes, and the torque itself.

Set points follow the commanded wheel speeds with limited acceleration, as a motor controller
would have it, and after a while at zero a wheel is held at its angle, so that a robot parked on a
slope does not creep (robots reference 4.4).

A speed servo of limited torque is dry friction against a shaft that turns at the wanted speed.
That is how it is given to the solver: as the wheel joint's friction loss, whose reference
acceleration is shifted by the set point between the two halves of every step. MuJoCo's own
velocity actuators need an implicit integrator, which weakens their push after the solver has
balanced it against the friction of the tyres: while speeding up the robot then runs ahead of its
wheels (0.06 m/s at 10 rad/s^2, gain 20 and 4 ms), the more the longer the time step is.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.model import CompiledWorld, RobotModel
from usarsim_server.simulation.parts import Part

HOLD_GAIN = 10.0
"""1/s: wheel speed asked for per radian of displacement while the brake holds."""
HOLD_SPEED = 2.0
"""rad/s: the brake never asks for more."""

Array = NDArray[np.float64]
ServoState = tuple[NDArray[Any], ...]


class WheelServos(Part):
    """Set points of every driven wheel of one model generation; used by the physics thread."""

    def __init__(self, world: CompiledWorld) -> None:
        counts = [len(layout.wheel_dof) for layout in world.layouts]
        first = np.cumsum([0, *counts])
        self._span = [slice(int(a), int(b)) for a, b in pairwise(first)]
        self._dofs = _join([layout.wheel_dof for layout in world.layouts])
        self._losses = world.model.dof_frictionloss
        """Of the running model: 0 for a wheel that rolls freely."""
        self._torques: Array = self._losses[self._dofs]
        self._angles = _join([layout.wheel_qpos for layout in world.layouts])
        self._timestep = float(world.model.opt.timestep)
        self._increment = np.repeat(_accelerations(world.slots), counts) * self._timestep
        self._decrement = np.repeat(_decelerations(world.slots), counts) * self._timestep
        self._delay = np.repeat([slot.brake_delay for slot in world.slots], counts)
        count = len(self._dofs)
        self._target = np.zeros(count)
        self._setpoint = np.zeros(count)
        self._idle = np.zeros(count)
        self._hold = np.full(count, np.nan)
        self._engaged = np.zeros(count, dtype=bool)
        self._free = np.zeros(count, dtype=bool)
        self._steady = True
        self._speed = np.zeros(max(world.model.nv, world.model.ntendon))
        self._moving = False
        self._tendons = world.model.ntendon > 0

    def command(self, slot: int, targets: Array) -> None:
        """Set the wheel speed targets (rad/s; NaN: rolls freely) of a slot, in part order."""
        span = self._span[slot]
        self._target[span] = np.nan_to_num(targets, nan=0.0)
        self._free[span] = np.isnan(targets)
        self._engaged[span] = ~self._free[span]
        self._couple()
        self._steady = False

    def release(self, slot: int, data: mujoco.MjData) -> None:
        """Forget everything about a slot: its wheels stand still without a brake."""
        span = self._span[slot]
        for array in (self._target, self._setpoint, self._idle):
            array[span] = 0.0
        self._hold[span] = np.nan
        self._engaged[span] = self._free[span] = False
        self._couple()
        self._steady = False

    def _couple(self) -> None:
        """Give every wheel its drive, or none."""
        self._losses[self._dofs] = np.where(self._free, 0.0, self._torques)

    def targets(self, slot: int) -> Array:
        """Commanded wheel speeds of a slot (rad/s)."""
        copy: Array = self._target[self._span[slot]].copy()
        return copy

    def setpoints(self, slot: int) -> Array:
        """Wheel speeds (rad/s) that the servos of a slot hold at present."""
        copy: Array = self._speed[self._dofs[self._span[slot]]].copy()
        return copy

    def drives(self, slot: int) -> bool:
        """Whether a wheel of a slot is told to turn."""
        return bool(self._target[self._span[slot]].any())

    def state(self, data: mujoco.MjData) -> ServoState:
        """A copy of everything that changes, for `restore`."""
        return tuple(array.copy() for array in self._arrays())

    def restore(self, data: mujoco.MjData, state: ServoState) -> None:
        """Go back to a copied state of this generation."""
        for array, kept in zip(self._arrays(), state, strict=True):
            array[:] = kept
        self._couple()
        self._steady = False

    def inherit(
        self, older: WheelServos, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Take over slots, which are the same there and here, from another generation."""
        for array, former in zip(self._arrays(), older._arrays(), strict=True):
            for slot in slots:
                array[self._span[slot]] = former[older._span[slot]]
        for slot in slots:
            speed = older._speed[older._dofs[older._span[slot]]]
            self._speed[self._dofs[self._span[slot]]] = speed
        self._moving = bool(self._speed.any())
        self._couple()
        self._steady = False

    def _arrays(self) -> tuple[NDArray[Any], ...]:
        return (
            self._target,
            self._setpoint,
            self._idle,
            self._hold,
            self._engaged,
            self._free,
        )

    def before(self, data: mujoco.MjData) -> None:
        """Advance all set points, see `update`."""
        self.update(data.qpos)

    def update(self, qpos: Array) -> None:
        """Advance all set points by one time step."""
        if self._steady:
            return
        missing = self._target - self._setpoint
        limit = np.where(missing * self._setpoint < 0.0, self._decrement, self._increment)
        change = np.clip(missing, -limit, limit)
        self._setpoint += change
        still = (self._setpoint == 0.0) & (self._target == 0.0) & self._engaged
        self._idle = np.where(still, self._idle + self._timestep, 0.0)
        braked = still & (self._idle >= self._delay)
        angles = qpos[self._angles]
        self._hold = np.where(braked, np.where(np.isnan(self._hold), angles, self._hold), np.nan)
        back = np.clip(HOLD_GAIN * (self._hold - angles), -HOLD_SPEED, HOLD_SPEED)
        self._speed[self._dofs] = np.where(braked, back, self._setpoint)
        self._moving = bool(self._speed.any())
        # While every wheel runs at its commanded speed there is nothing to update.
        self._steady = not (change.any() or still.any())

    def between(self, data: mujoco.MjData) -> None:
        """Hand the set points to the solver."""
        if not (self._moving and data.nf):
            return
        rows = slice(data.ne, data.ne + data.nf)
        shift = data.efc_KBIP[rows, 1] * self._speed[data.efc_id[rows]]
        if self._tendons:  # their friction losses stand in the same rows
            shift[data.efc_type[rows] != mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF] = 0.0
        data.efc_aref[rows] += shift


def _join(parts: list[NDArray[np.intp]]) -> NDArray[np.intp]:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)


def _accelerations(slots: Sequence[RobotModel]) -> list[float]:
    return [slot.wheel_acceleration for slot in slots]


def _decelerations(slots: Sequence[RobotModel]) -> list[float]:
    return [slot.wheel_deceleration or slot.wheel_acceleration for slot in slots]
