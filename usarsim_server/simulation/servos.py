"""Speed servos of limited force, of all robots at once; those of driven wheels.

A speed servo of limited force is dry friction against a shaft that turns at the wanted speed. That
is how it is given to the solver: as the joint's friction loss, whose reference acceleration is
shifted by the set point between the two halves of every step. The solver then finds the force that
is really needed, so no gains have to be tuned to the load. MuJoCo's own velocity actuators need an
implicit integrator, which weakens their push after the solver has balanced it against the friction
of the tyres: while speeding up the robot then runs ahead of its wheels (0.06 m/s at 10 rad/s^2,
gain 20 and 4 ms), the more the longer the time step is. Those of all other joints are in
`joint_servos.py`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.parts import Part

ServoState = tuple[NDArray[Any], ...]

HOLD_GAIN = 10.0
"""1/s: wheel speed asked for per radian of displacement while the brake holds."""
HOLD_SPEED = 2.0
"""rad/s: the brake never asks for more."""


class Servos(Part):
    """What those of wheels and those of other joints have in common."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._shift = np.zeros(max(model.nv, model.ntendon))
        """Wanted speed by velocity index, rad/s or m/s."""
        self._moving = False
        """Whether any of them is not zero."""
        self._tendons = model.ntendon > 0

    def arrays(self, names: Iterable[str]) -> dict[str, NDArray[Any]]:
        """Some of the arrays that set points are advanced with, which stay the same ones."""
        return {name: getattr(self, f"_{name}") for name in names}

    def _arrays(self) -> ServoState:
        """Everything that changes and has to be kept."""
        raise NotImplementedError

    def _begin(self) -> None:
        """Orders have changed."""
        raise NotImplementedError

    def state(self, data: mujoco.MjData) -> ServoState:
        return tuple(array.copy() for array in self._arrays())

    def restore(self, data: mujoco.MjData, state: ServoState) -> None:
        for array, kept in zip(self._arrays(), state, strict=True):
            array[:] = kept
        self._begin()

    def _take(self, older: Servos, here: Numbers, there: Numbers) -> None:
        """Take over what servos with these numbers here have there, in another generation."""
        for array, former in zip(self._arrays(), older._arrays(), strict=True):
            array[here] = former[there]

    def between(self, data: mujoco.MjData) -> None:
        """Hand the set points to the solver."""
        if not self._moving:
            return
        first = data.ne
        rows = slice(first, first + data.nf)
        shift = self._shift[data.efc_id[rows]]
        shift *= data.efc_KBIP[rows, 1]
        if self._tendons:  # their friction losses stand in the same rows
            shift[data.efc_type[rows] != int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)] = 0.0
        reference = data.efc_aref[rows]
        reference += shift


class WheelServos(Servos):
    """Set points of every driven wheel of one model generation.

    They follow the commanded speeds with limited acceleration, as a motor controller would have it,
    and after a while at zero a wheel is held at its angle, so that a robot parked on a slope does
    not creep (robots reference 4.4).
    """

    def __init__(self, world: CompiledWorld) -> None:
        super().__init__(world.model)
        counts = [len(layout.wheel_dof) for layout in world.layouts]
        first = np.cumsum([0, *counts])
        self._span = [slice(int(a), int(b)) for a, b in pairwise(first)]
        self._dofs = _join([layout.wheel_dof for layout in world.layouts])
        self._losses = world.model.dof_frictionloss
        """Of the running model: 0 for a wheel that rolls freely."""
        self._torques: Array = self._losses[self._dofs]
        self._angles = _join([layout.wheel_qpos for layout in world.layouts])
        self._timestep = float(world.model.opt.timestep)
        slots = world.slots
        faster = [slot.wheel_acceleration for slot in slots]
        slower = [slot.wheel_deceleration or slot.wheel_acceleration for slot in slots]
        self._increment = np.repeat(faster, counts) * self._timestep
        self._decrement = np.repeat(slower, counts) * self._timestep
        self._same = np.array_equal(self._increment, self._decrement)
        """Whether all slow down as fast as they speed up."""
        self._negative = -self._increment
        self._delay = np.repeat(np.array([slot.brake_delay for slot in slots], float), counts)
        count = len(self._dofs)
        # One block, so that what is kept of every batch is one copy.
        self._block = np.zeros((4 * 8 + 2) * count, dtype=np.uint8)
        numbers = self._block[: 4 * 8 * count].view(float).reshape(4, count)
        self._target, self._setpoint, self._idle, self._hold = numbers
        self._hold[:] = np.nan
        self._engaged, self._free = self._block[4 * 8 * count :].view(bool).reshape(2, count)
        self._steady = True
        self._rested = True
        """Whether a wheel may have been idle or held since the last look."""

    def command(self, slot: int, targets: Array) -> None:
        """Set the wheel speed targets (rad/s; NaN: rolls freely) of a slot, in part order."""
        span = self._span[slot]
        free = np.isnan(targets)
        self._target[span] = np.where(free, 0.0, targets)
        self._free[span], self._engaged[span] = free, ~free
        self._begin()

    def release(self, slot: int, data: mujoco.MjData) -> None:
        """Forget everything about a slot: its wheels stand still without a brake."""
        span = self._span[slot]
        for array in (self._target, self._setpoint, self._idle):
            array[span] = 0.0
        self._hold[span] = np.nan
        self._engaged[span] = self._free[span] = False
        self._begin()

    def _begin(self) -> None:
        """Give every wheel its drive, or none."""
        self._losses[self._dofs] = np.where(self._free, 0.0, self._torques)
        self._steady, self._rested = False, True

    def targets(self, slot: int) -> Array:
        """Commanded wheel speeds of a slot (rad/s)."""
        return self._target[self._span[slot]].copy()

    def setpoints(self, slot: int) -> Array:
        """Wheel speeds (rad/s) that the servos of a slot hold at present."""
        return self._shift[self._dofs[self._span[slot]]].copy()

    def drives(self, slot: int) -> bool:
        """Whether a wheel of a slot is told to turn."""
        return bool(self._target[self._span[slot]].any())

    def inherit(
        self, older: WheelServos, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Take over slots, which are the same there and here, from another generation."""
        here = _join([self._numbers(slot) for slot in slots])
        there = _join([older._numbers(slot) for slot in slots])
        self._take(older, here, there)
        self._shift[self._dofs[here]] = older._shift[older._dofs[there]]
        self._moving = bool(self._shift.any())
        self._begin()

    def _numbers(self, slot: int) -> Numbers:
        return np.arange(self._span[slot].start, self._span[slot].stop)

    def _arrays(self) -> ServoState:
        targets = (self._target, self._setpoint, self._idle)
        return (*targets, self._hold, self._engaged, self._free)

    def state(self, data: mujoco.MjData) -> ServoState:
        return (self._block.copy(),)

    def restore(self, data: mujoco.MjData, state: ServoState) -> None:
        self._block[:] = state[0]
        self._begin()

    @property
    def course(self) -> tuple[bool, bool]:
        """Whether all wheels are steady, so that `update` has nothing to do; whether any turns."""
        return self._steady, self._moving

    def went_on(self, steady: bool, moving: bool) -> None:
        """All set points have been advanced, by somebody else, in `arrays`."""
        self._steady, self._moving, self._rested = steady, moving, True

    # -- stepping ----------------------------------------------------------------------------

    def before(self, data: mujoco.MjData) -> None:
        """Advance all set points, see `update`."""
        self.update(data.qpos)

    def update(self, qpos: Array) -> None:
        """Advance all set points by one time step."""
        if self._steady:
            return
        change = self._target - self._setpoint
        if self._same:
            low, high = self._negative, self._increment
        else:
            high = np.where(change * self._setpoint < 0.0, self._decrement, self._increment)
            low = -high
        np.maximum(change, low, out=change)
        np.minimum(change, high, out=change)
        self._setpoint += change
        still = (self._setpoint == 0.0) & (self._target == 0.0) & self._engaged
        standing = bool(np.count_nonzero(still))
        if standing:
            self._idle[:] = np.where(still, self._idle + self._timestep, 0.0)
            braked = still & (self._idle >= self._delay)
            angles = qpos[self._angles]
            kept = np.where(np.isnan(self._hold), angles, self._hold)
            self._hold[:] = np.where(braked, kept, np.nan)
            back = np.clip(HOLD_GAIN * (self._hold - angles), -HOLD_SPEED, HOLD_SPEED)
            self._shift[self._dofs] = np.where(braked, back, self._setpoint)
        else:
            if self._rested:
                self._idle[:], self._hold[:] = 0.0, np.nan
            self._shift[self._dofs] = self._setpoint
        self._rested = standing
        self._moving = bool(np.count_nonzero(self._shift))
        # While every wheel runs at its commanded speed there is nothing to update.
        self._steady = not (standing or np.count_nonzero(change))


def _join(parts: list[Numbers]) -> Numbers:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)
