"""Speed servos of limited force, of all robots at once: driven wheels, and all other joints.

A speed servo of limited force is dry friction against a shaft that turns at the wanted speed. That
is how it is given to the solver: as the joint's friction loss, whose reference acceleration is
shifted by the set point between the two halves of every step. The solver then finds the force that
is really needed, so no gains have to be tuned to the load. MuJoCo's own velocity actuators need an
implicit integrator, which weakens their push after the solver has balanced it against the friction
of the tyres: while speeding up the robot then runs ahead of its wheels (0.06 m/s at 10 rad/s^2,
gain 20 and 4 ms), the more the longer the time step is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.model import WAKE, CompiledWorld
from usarsim_server.simulation.parts import Part

ServoState = tuple[NDArray[Any], ...]

HOLD_GAIN = 10.0
"""1/s: wheel speed asked for per radian of displacement while the brake holds."""
HOLD_SPEED = 2.0
"""rad/s: the brake never asks for more."""
GAIN = 20.0
"""1/s: speed per way left. The force follows within 10 ms, so a joint settles without overshoot."""
SETTLED_SPEED = 0.1
"""rad/s or m/s: a joint that wants to go slower than this is holding its place."""
ARRIVED_SPEED = 1e-3
"""rad/s or m/s: a joint that wants to go slower is where it shall be, give or take 50 micro."""
HOLD_STEPS = 5
"""Steps between two looks at joints that all hold their place."""
STALLED = 1e-7
"""rad or m that a joint goes in a step if something blocks it."""
DEAD_SPEED = 1e-4
"""rad/s or m/s below which a set point is not worth the work: 5 micrometres or microradians off."""


class _Servos(Part):
    """What both kinds have in common."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._shift = np.zeros(max(model.nv, model.ntendon))
        """Wanted speed by velocity index, rad/s or m/s."""
        self._moving = False
        """Whether any of them is not zero."""
        self._tendons = model.ntendon > 0

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

    def _take(self, older: _Servos, here: Numbers, there: Numbers) -> None:
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
            shift[data.efc_type[rows] != mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF] = 0.0
        reference = data.efc_aref[rows]
        reference += shift


class WheelServos(_Servos):
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

    def arrays(self) -> dict[str, NDArray[Any]]:
        """What `update` reads and writes, by name; the arrays stay the same ones."""
        names = ("target", "increment", "decrement", "delay", "setpoint", "idle", "hold", "shift")
        return {name: getattr(self, f"_{name}") for name in (*names, "engaged", "angles", "dofs")}

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


class JointServos(_Servos):
    """Set points of all jointed robots of one model generation.

    A joint is told a position, a speed or a torque. All of them become a speed, never above
    the joint's limit, and the largest force that may be used to keep it. Towards a position the
    speed falls in proportion to the way that is left, so a joint moves at its full speed, comes to
    rest without overshoot, lands softly on its stops, and holds against gravity; what blocks it
    feels the drive's largest force and no more. A torque is that force with the highest speed in
    its direction: what yields is pushed along, what pushes back harder wins.
    """

    def __init__(self, world: CompiledWorld) -> None:
        super().__init__(world.model)
        self._model = model = world.model
        joints: list[int] = []
        speeds: list[float] = []
        forces: list[float] = []
        roots: list[int] = []
        self._index: list[dict[str, int]] = []
        for slot, robot in enumerate(world.slots):
            index = {}
            for joint in robot.joints:
                index[joint.name.lower()] = len(joints)
                joints.append(model.joint(f"robot{slot}:{joint.name}").id)
                speeds.append(joint.max_speed)
                forces.append(joint.max_force)
                roots.append(world.layouts[slot].dof)
            self._index.append(index)
        self.empty = not joints
        self._joints = np.array(joints, dtype=np.intp)
        self._roots = np.array(roots, dtype=np.intp)
        self._busy = self._roots[:0]
        """First velocity index of each robot with a joint under way; indices may repeat."""
        self._coordinates = model.jnt_qposadr[self._joints].astype(np.intp)
        self._dofs = model.jnt_dofadr[self._joints].astype(np.intp)
        limited = model.jnt_limited[self._joints].astype(bool)
        self._low = np.where(limited, model.jnt_range[self._joints, 0], -np.inf)
        self._high = np.where(limited, model.jnt_range[self._joints, 1], np.inf)
        self._home = model.qpos0[self._coordinates].copy()
        self._max_speed = np.array(speeds, dtype=float)
        self._max_force = np.array(forces, dtype=float)
        self._slew = GAIN * self._max_speed * float(model.opt.timestep)
        self._positioned = np.ones(len(joints), dtype=bool)
        self._target = self._home.copy()
        self._rate = np.zeros(len(joints))
        self._push = np.full(len(joints), np.inf)
        self._share = np.ones(len(joints))
        self._speed = np.zeros(len(joints))
        self._torque = np.zeros(model.nv)
        self._waited = HOLD_STEPS
        self._here = np.full(len(joints), np.inf)
        self._holding = False
        self._settled = False

    # -- orders ------------------------------------------------------------------------------

    def command(self, slot: int, orders: Mapping[str, JointOrder]) -> None:
        """Give orders to joints of a slot by name (any case); unknown names are ignored.

        Positions and speeds beyond the limits are taken for the limits, torques likewise.
        """
        index = self._index[slot]
        found = [(index.get(name.lower()), one) for name, one in orders.items()]
        known = [(joint, one) for joint, one in found if joint is not None]
        if all(order is Order.POSITION for _, (order, _) in known):
            self._send([joint for joint, _ in known], [value for _, (_, value) in known])
        else:
            for joint, (order, value) in known:
                self._order(joint, order, value)
        self._begin()

    def _send(self, joints: list[int], places: Sequence[float] | Array) -> None:
        """Have joints take places, or what is next to them within their limits."""
        self._positioned[joints] = True
        self._push[joints] = np.inf
        low, high = self._low[joints], self._high[joints]
        self._target[joints] = np.minimum(np.maximum(places, low), high)

    def _order(self, joint: int, order: Order, value: float) -> None:
        fastest = self._max_speed[joint]
        if order is Order.STIFFNESS:
            self._share[joint] = min(max(value, 0.0), 1.0)
            return
        if order is Order.POSITION:
            self._send([joint], [value])
            return
        self._positioned[joint] = False
        self._push[joint] = np.inf
        if order is Order.VELOCITY:
            self._rate[joint] = min(max(value, -fastest), fastest)
        else:
            self._rate[joint] = math.copysign(fastest, value) if value else 0.0
            self._push[joint] = abs(value)

    def hold(self, slot: int, data: mujoco.MjData) -> None:
        """Have the joints of a slot keep the places that they have now."""
        chosen = list(self._index[slot].values())
        self._send(chosen, data.qpos[self._coordinates[chosen]])
        self._begin()

    def release(self, slot: int, data: mujoco.MjData) -> None:
        """Forget all orders of a slot: its joints hold the position they start with."""
        chosen = list(self._index[slot].values())
        self._positioned[chosen] = True
        self._target[chosen] = self._home[chosen]
        self._rate[chosen] = self._speed[chosen] = 0.0
        self._push[chosen] = np.inf
        self._share[chosen] = 1.0
        self._torque[self._dofs[chosen]] = 0.0
        self._begin()

    def _begin(self) -> None:
        # Without force there is no friction, and the joint swings freely.
        force = np.minimum(self._push, self._share * self._max_force)
        self._model.dof_frictionloss[self._dofs] = force
        self._waited = HOLD_STEPS
        self._here = np.full(len(self._joints), np.inf)
        self._holding = self._settled = False

    def target(self, slot: int, name: str) -> float | None:
        """Position (rad or m) that a joint is told to take; None if it is told something else."""
        joint = self._index[slot][name.lower()]
        return float(self._target[joint]) if self._positioned[joint] else None

    # -- state -------------------------------------------------------------------------------

    def inherit(
        self, older: JointServos, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        """Take over slots, which are the same there and here, from another generation."""
        here, there = (
            np.array([joint for slot in slots for joint in one._index[slot].values()], np.intp)
            for one in (self, older)
        )
        self._take(older, here, there)
        self._begin()
        # The rhythm of the looks, too, so that nobody notices.
        self._here[here] = older._here[there]
        self._waited, self._holding = older._waited, older._holding
        self._settled = older._settled
        for mine, former in ((self._shift, older._shift), (self._torque, older._torque)):
            mine[self._dofs[here]] = former[older._dofs[there]]
        self._moving = bool(self._shift.any())
        self._busy = self._roots[here][np.isin(older._roots[there], older._busy)]

    def _arrays(self) -> ServoState:
        return (
            *(self._positioned, self._target, self._rate),
            *(self._push, self._share, self._speed),
        )

    # -- stepping ----------------------------------------------------------------------------

    def before(self, data: mujoco.MjData) -> None:
        """Advance all set points by one time step, and keep robots awake that have to move."""
        self._update(data.qpos)
        busy = self._busy
        if busy.size:
            data.qvel[busy[data.qvel[busy] == 0.0]] = WAKE

    def _update(self, qpos: Array) -> None:
        if self._holding and self._waited < HOLD_STEPS:
            self._waited += 1
            return
        here = qpos[self._coordinates]
        if self._settled and (here == self._here).all():
            self._waited = 1
            return
        gone = np.abs(here - self._here)
        self._here = here
        wish = np.where(self._positioned, GAIN * (self._target - here), self._rate)
        wish = np.minimum(np.maximum(wish, -self._max_speed), self._max_speed)
        # Towards a stop as towards a target. Beyond a stop: back, but no faster than allowed.
        wish = np.maximum(wish, np.minimum(GAIN * (self._low - here), self._max_speed))
        wish = np.minimum(wish, np.maximum(GAIN * (self._high - here), -self._max_speed))
        limit = self._slew * self._waited if self._holding else self._slew
        speed = self._speed + np.minimum(np.maximum(wish - self._speed, -limit), limit)
        self._speed = speed
        size = np.abs(speed)
        fastest = np.maximum(size, np.abs(wish))
        self._holding = bool((fastest < SETTLED_SPEED).all())
        # A joint that pushes as hard as it can and does not budge may sleep; not one turning back.
        stalled = (speed == wish) & (gone < STALLED)
        self._busy = self._roots[(fastest >= ARRIVED_SPEED) & ~stalled]
        self._settled = self._holding and bool((speed == wish).all())
        self._waited = 1
        self._shift[self._dofs] = np.where(size < DEAD_SPEED, 0.0, speed)
        self._moving = bool((size >= DEAD_SPEED).any())

    def end(self, data: mujoco.MjData) -> None:
        """Note the forces of the drives in the last step, for `torques`."""
        if not data.nf:
            return
        rows = slice(data.ne, data.ne + data.nf)
        dofs, forces = data.efc_id[rows], data.efc_force[rows]
        if self._tendons:
            real = data.efc_type[rows] == mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF
            dofs, forces = dofs[real], forces[real]
        self._torque[dofs] = forces

    def torques(self) -> Array:
        """Forces of the drives (nv,), N m or N; zero where there is no drive.

        Joints of sleeping robots keep the force with which they fell asleep.
        """
        return self._torque


def _join(parts: list[Numbers]) -> Numbers:
    return np.concatenate(parts) if parts else np.zeros(0, dtype=np.intp)
