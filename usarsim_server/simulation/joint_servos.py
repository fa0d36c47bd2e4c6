"""Speed servos of everything that is no wheel: arms, legs, flippers, fingers (see `servos.py`)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from usarsim_server.simulation.articulation import JointOrder, Order
from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.model import WAKE, CompiledWorld
from usarsim_server.simulation.parts import MOST_AT_REST
from usarsim_server.simulation.servos import Servos, ServoState

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


class JointServos(Servos):
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
        """First velocity index of the robot of each joint."""
        self._trees = model.dof_treeid[self._roots].astype(np.intp)
        self._under_way = np.zeros(len(joints), dtype=bool)
        self._dozing = False
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
        self._told = False
        """Whether orders have changed since the last step."""

    # -- orders ------------------------------------------------------------------------------

    def command(self, slot: int, orders: Mapping[str, JointOrder]) -> None:
        """Give orders to joints of a slot by name (any case); unknown names are ignored.

        Positions and speeds beyond the limits are taken for the limits, torques likewise.
        """
        index = self._index[slot]
        joints, places = list[int](), list[float]()
        for name, (order, value) in orders.items():
            joint = index.get(name.lower())
            if joint is None:
                continue
            if order is Order.POSITION:
                joints.append(joint)
                places.append(value)
            else:
                self._order(joint, order, value)
        self._send(np.array(joints, np.intp), places)
        self._begin()

    def _send(self, joints: Numbers, places: Sequence[float] | Array) -> None:
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
        self._positioned[joint] = False
        self._push[joint] = np.inf
        if order is Order.VELOCITY:
            self._rate[joint] = min(max(value, -fastest), fastest)
        else:
            self._rate[joint] = math.copysign(fastest, value) if value else 0.0
            self._push[joint] = abs(value)

    def hold(self, slot: int, data: mujoco.MjData) -> None:
        """Have the joints of a slot keep the places that they have now."""
        chosen = np.array([*self._index[slot].values()], np.intp)
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
        self._told = True  # many robots are told something between two steps

    def _take_orders(self) -> None:
        """Look at all joints anew, with the forces that they may use from now on."""
        self._told = False
        # Without force there is no friction, and the joint swings freely.
        force = np.minimum(self._push, self._share * self._max_force)
        self._model.dof_frictionloss[self._dofs] = force
        self._waited = HOLD_STEPS
        self._here[:] = np.inf
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
        if older._told:
            older._take_orders()
        self._take(older, here, there)
        self._take_orders()
        # The rhythm of the looks, too, so that nobody notices.
        self._here[here] = older._here[there]
        self._waited, self._holding = older._waited, older._holding
        self._settled = older._settled
        for mine, former in ((self._shift, older._shift), (self._torque, older._torque)):
            mine[self._dofs[here]] = former[older._dofs[there]]
        self._moving = bool(self._shift.any())
        self._under_way[here] = older._under_way[there]

    def _arrays(self) -> ServoState:
        return (
            *(self._positioned, self._target, self._rate),
            *(self._push, self._share, self._speed),
        )

    @property
    def course(self) -> tuple[int, bool, bool, bool]:
        """Steps since the last look; whether all joints hold their place, all are where they shall
        be, and any moves."""
        return self._waited, self._holding, self._settled, self._moving

    def went_on(self, waited: int, holding: bool, settled: bool, moving: bool) -> None:
        """All set points have been advanced, by somebody else, in `arrays`."""
        self._waited, self._holding, self._settled, self._moving = waited, holding, settled, moving

    # -- stepping ----------------------------------------------------------------------------

    def begin(self, data: mujoco.MjData) -> None:
        asleep = data.tree_asleep[self._trees]
        self._dozing = bool(((asleep < 0) & (asleep >= -1 - MOST_AT_REST)).any())

    def rests(self) -> bool:
        """Whether nobody falls asleep in the next `MOST_AT_REST` steps, whom only `before` wakes if
        a joint is under way."""
        return not self._dozing

    def before(self, data: mujoco.MjData) -> None:
        """Advance all set points by one time step, and wake robots that have to move."""
        if self._told:
            self._take_orders()
        self._update(data.qpos)
        waking = self._under_way & (data.tree_asleep[self._trees] >= 0)
        if waking.any():
            data.qvel[self._roots[waking]] = WAKE

    def _update(self, qpos: Array) -> None:
        if self._holding and self._waited < HOLD_STEPS:
            self._waited += 1
            return
        here = qpos[self._coordinates]
        if self._settled and (here == self._here).all():
            self._waited = 1
            return
        gone = np.abs(here - self._here)
        self._here[:] = here
        wish = np.where(self._positioned, GAIN * (self._target - here), self._rate)
        wish = np.minimum(np.maximum(wish, -self._max_speed), self._max_speed)
        # Towards a stop as towards a target. Beyond a stop: back, but no faster than allowed.
        wish = np.maximum(wish, np.minimum(GAIN * (self._low - here), self._max_speed))
        wish = np.minimum(wish, np.maximum(GAIN * (self._high - here), -self._max_speed))
        limit = self._slew * self._waited if self._holding else self._slew
        speed = self._speed + np.minimum(np.maximum(wish - self._speed, -limit), limit)
        self._speed[:] = speed
        size = np.abs(speed)
        fastest = np.maximum(size, np.abs(wish))
        self._holding = bool((fastest < SETTLED_SPEED).all())
        # A joint that pushes as hard as it can and does not budge may sleep; not one turning back.
        stalled = (speed == wish) & (gone < STALLED)
        np.logical_and(fastest >= ARRIVED_SPEED, ~stalled, out=self._under_way)
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
            real = data.efc_type[rows] == int(mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF)
            dofs, forces = dofs[real], forces[real]
        self._torque[dofs] = forces

    def torques(self) -> Array:
        """Forces of the drives (nv,), N m or N; zero where there is no drive.

        Joints of sleeping robots keep the force with which they fell asleep.
        """
        return self._torque
