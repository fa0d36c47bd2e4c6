"""The physics itself: one model, its data, its servos. Used by the physics thread alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.logs import Log
from usarsim_server.simulation.articulation import JointOrder
from usarsim_server.simulation.divergence import culprits, is_sound
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.ground import Belts, Traction, compensate
from usarsim_server.simulation.growth import Growth, grow, inherit_sleep, laws_of
from usarsim_server.simulation.limbs import Limbs
from usarsim_server.simulation.machines import Machine, Machines
from usarsim_server.simulation.model import (
    JOINT_WIDTH,
    VACANT,
    PhysicsOptions,
    RobotModel,
    compile_world,
    put,
    root_qpos,
    slot_prefix,
)
from usarsim_server.simulation.movers import Mover, MovingBodies, Way, carry_over
from usarsim_server.simulation.snapshot import RobotLayout, Snapshot
from usarsim_server.simulation.wheels import WheelServos

Array = NDArray[np.float64]

LOOK_STEPS = 5
"""Steps between two looks whether anything is near a body that goes its own way."""
WAKE = -0.0
"""Written to a velocity of a sleeping body: equal to zero, but not byte by byte, so it wakes."""

_log = Log("simulation")


class Engine:
    """Steps the world, holds robots in slots, contains divergence.

    Of what diverges (see `divergence.py`) a robot leaves the world, a movable object returns to
    where the world file has it.

    Attributes:
        world: the current model generation.
        data: live state; nobody else may touch it.
        steps: number of steps since the world started.
        after_batch: called after every batch of steps.
    """

    def __init__(
        self,
        scenery: Callable[[], mujoco.MjSpec],
        options: PhysicsOptions,
        slots: Sequence[RobotModel] = (),
    ) -> None:
        self._scenery = scenery
        self._options = options
        self.world = compile_world(scenery, slots, options, generation=0)
        self.data = mujoco.MjData(self.world.model)
        self._servos = WheelServos(self.world)
        self._limbs = Limbs(self.world)
        self._laws = laws_of(self.world)
        self._moving = MovingBodies(self.world.model)
        self._machines = Machines()
        self._belts = Belts(self.world.model)
        self._traction = Traction(self.world.model, options.surfaces)
        self._active: dict[int, int] = {}
        self._driven: set[int] = set()
        self._left: dict[int, int] = {}
        self._settling = self._parked()
        self.after_batch: Callable[[], None] = _nothing
        self.steps = 0
        mujoco.mj_kinematics(self.world.model, self.data)

    @property
    def time(self) -> float:
        """Simulated seconds, free of accumulated rounding."""
        return self.steps * self._options.timestep

    @property
    def timestep(self) -> float:
        """Simulated seconds per step."""
        return self._options.timestep

    @property
    def active(self) -> dict[int, int]:
        """Slots of the active robots by robot id (a copy)."""
        return dict(self._active)

    # -- bodies that go their own way --------------------------------------------------------

    @property
    def movers(self) -> tuple[Mover, ...]:
        """What places the mocap bodies of the world before every step."""
        return self._moving.movers

    def set_movers(self, movers: Sequence[Mover], machines: Sequence[Machine] = ()) -> None:
        """Replace all movers and machines; a body that nobody moves any more stays where it is.

        Raises:
            ValueError: if a body cannot be moved; the old ones stay.
        """
        self._moving.replace([*movers, *(own for one in machines for own in one.movers)])
        self._machines.replace(machines, self.world)

    def follow(self, robot: int, ways: Sequence[Way]) -> None:
        """Let the bodies of a kinematic thing go their ways, the base first; none: they stay.

        Raises:
            KeyError: if it is not in the world.
        """
        bodies = self.world.layouts[self._active[robot]].mocap
        self._look()
        model = self.world.model
        pairs = zip(bodies, ways, strict=True) if ways else ()
        self._moving.follow(robot, [Mover(model.body(body).name, way) for body, way in pairs])

    def pose(self, robot: int) -> Pose:
        """Present pose of an active robot or thing.

        Raises:
            KeyError: if it is not in the world.
        """
        base = self.world.layouts[self._active[robot]].base
        self._look()
        x, y, z = self.data.xpos[base].tolist()
        w, i, j, k = self.data.xquat[base].tolist()
        return Pose((x, y, z), (w, i, j, k))

    def run_belts(self, tag: str, factor: float) -> int:
        """Let conveyors run at so many times their speed in the scene; how many there are."""
        found = self._belts.run(tag, factor)
        if found:
            self._belts.apply(self.world.model)
            # Whatever lies on a belt that stood still may sleep.
            self.data.qvel[self.data.qvel == 0.0] = WAKE
        return found

    # -- robots ------------------------------------------------------------------------------

    def free_slot(self, key: str) -> int | None:
        """Lowest free slot of a class, or None if the model has to grow."""
        taken = set(self._active.values())
        return next(
            (i for i, slot in enumerate(self.world.slots) if slot.key == key and i not in taken),
            None,
        )

    def occupy(self, robot: int, slot: int, pose: Pose) -> None:
        """Put a robot into a free slot at a pose.

        Raises:
            ValueError: if the pose is not finite.
        """
        self._put(slot, _finite(root_qpos(pose)))
        self._active[robot] = slot
        self._left.pop(slot, None)
        self._release(slot)
        self._laws.occupy(slot)

    def vacate(self, robot: int) -> None:
        """Park the robot's slot again; unknown robots are ignored."""
        slot = self._active.pop(robot, None)
        if slot is None:
            return
        self._moving.follow(robot, ())
        self._release(slot)
        self._put(slot, self.world.parking[slot])
        self._leave(slot)

    def _leave(self, slot: int) -> None:
        """Note that a slot is free and parked from now on."""
        self._left[slot] = self.steps
        if self.world.layouts[slot].dof >= 0:
            self._settling.add(slot)

    def _parked(self) -> set[int]:
        """Free slots whose robots are subject to forces."""
        taken = self._active.values()
        return {
            layout.slot
            for layout in self.world.layouts
            if layout.dof >= 0 and layout.slot not in taken
        }

    def free_since(self, seconds: float) -> list[int]:
        """Slots that nobody has been in for some simulated time, in order."""
        taken = set(self._active.values())
        latest = self.steps - seconds / self.timestep
        return [
            slot
            for slot, kind in enumerate(self.world.slots)
            if kind is not VACANT and slot not in taken and self._left.get(slot, 0) <= latest
        ]

    def reseat(self, robot: int, slot: int) -> bool:
        """Give a robot or thing another body, in a free slot, at the same pose.

        Returns:
            Whether it is in the world.
        """
        if robot not in self._active:
            return False
        pose = self.pose(robot)
        self.vacate(robot)
        self.occupy(robot, slot, pose)
        return True

    def teleport(self, robot: int, pose: Pose) -> bool:
        """Move a robot or thing to a pose, at rest; it goes no way of its own any more.

        Returns:
            Whether it is in the world.

        Raises:
            ValueError: if the pose is not finite.
        """
        coordinates = _finite(root_qpos(pose))
        if robot not in self._active:
            return False
        self._moving.follow(robot, ())
        slot = self._active[robot]
        self._laws.forget(slot, self.data)
        self._put(slot, coordinates)
        return True

    def drive(self, robot: int, targets: Array) -> None:
        """Set wheel speed targets (rad/s, part order; NaN: rolls freely) and wake the robot.

        Raises:
            ValueError: if their count is wrong.
        """
        slot = self._active.get(robot)
        if slot is None:
            return
        self._servos.command(slot, targets)
        self._note_driven(slot)
        self._wake(slot)

    def wheel_targets(self, robot: int) -> Array:
        """Commanded wheel speeds (rad/s) of an active robot."""
        return self._servos.targets(self._active[robot])

    def command_joints(self, robot: int, orders: Mapping[str, JointOrder]) -> None:
        """Give orders to joints of a robot by name and wake it; unknown joints are ignored.

        Raises:
            ValueError: if a value is not finite.
        """
        slot = self._active.get(robot)
        if slot is not None:
            self._limbs.command(slot, orders)
            self._wake(slot)

    def command_law(self, robot: int, values: Array) -> None:
        """Command the laws of motion of a robot (see `laws.py`) and wake it.

        Raises:
            ValueError: if the count is wrong or a value is not finite.
        """
        slot = self._active.get(robot)
        if slot is not None:
            self._laws.command(slot, values)
            self._note_driven(slot)
            self._wake(slot)

    def operate_hand(self, robot: int, hand: str, close: bool) -> bool:
        """Close or open a hand of a robot; whether it obeyed (see `Hands.operate`)."""
        slot = self._active.get(robot)
        if slot is None:
            return False
        self._look()
        self._wake(slot)
        return self._limbs.operate(self.data, slot, hand, close)

    def _wake(self, slot: int) -> None:
        dof = self.world.layouts[slot].dof
        if self.data.qvel[dof] == 0.0:
            self.data.qvel[dof] = WAKE

    def _release(self, slot: int) -> None:
        self._servos.release(slot)
        self._limbs.release(slot)
        self._laws.vacate(slot, self.data)
        self._note_driven(slot)

    def _note_driven(self, slot: int) -> None:
        """Robots that are told to drive must not sleep, however slow they are."""
        driven = bool(self._servos.targets(slot).any()) or self._laws.commanded(slot)
        if driven == (slot in self._driven):
            return
        (self._driven.add if driven else self._driven.remove)(slot)
        self._allow_sleep(slot, not driven)

    def _allow_sleep(self, slot: int, allowed: bool) -> None:
        tree = self.world.model.dof_treeid[self.world.layouts[slot].dof]
        policy = mujoco.mjtSleepPolicy
        self.world.model.tree_sleep_policy[tree] = int(
            policy.mjSLEEP_ALLOWED if allowed else policy.mjSLEEP_NEVER
        )

    def _put(self, slot: int, coordinates: Array) -> None:
        layout = self.world.layouts[slot]
        data, model = self.data, self.world.model
        if layout.mocap.size:
            put(self.world, data, slot, coordinates)
            return
        self._touch(slot, True)
        self._settling.discard(slot)
        self._limbs.drop(data, int(model.dof_treeid[layout.dof]))
        put(self.world, data, slot, coordinates)
        data.qpos[list(layout.joint_qpos.values())] = model.qpos0[list(layout.joint_qpos.values())]
        for dofs in (slice(layout.dof, layout.dof + 6), list(layout.joint_dof.values())):
            data.qvel[dofs] = WAKE
            data.qacc_warmstart[dofs] = 0.0
        self._limbs.place(data, slot, coordinates)

    # -- stepping ----------------------------------------------------------------------------

    def _touch(self, slot: int, touching: bool) -> None:
        """Let a slot touch things, or leave it out of the search for contacts.

        That search is what a sleeping robot costs most in.
        """
        bodies = list(self.world.layouts[slot].bodies)
        model, (types, affinities) = self.world.model, self.world.masks
        model.body_contype[bodies] = types[bodies] if touching else 0
        model.body_conaffinity[bodies] = affinities[bodies] if touching else 0

    def _let_rest(self) -> None:
        """Leave parked slots that have fallen asleep out of the search for contacts."""
        model, layouts = self.world.model, self.world.layouts
        for slot in tuple(self._settling):
            if self.data.tree_asleep[model.dof_treeid[layouts[slot].dof]] >= 0:
                self._settling.remove(slot)
                self._touch(slot, False)

    def advance(self, steps: int) -> list[int]:
        """Advance the world by a number of steps.

        Returns:
            Robots whose state diverged; they have been parked.

        Raises:
            UsarsimError: if the world diverges even without robots.
        """
        self._remember()
        self.run(steps)
        lost = [] if is_sound(self.data) else self._take_out(culprits(self, steps))
        self.steps += steps
        if self._settling:
            self._let_rest()
        self.after_batch()
        return lost

    def run(self, steps: int) -> None:
        """Part of `advance`: step, whatever comes of it; `steps` does not count these."""
        model, data, servos = self.world.model, self.data, self._servos
        moving, compensated = self._moving, self._options.compensation
        traction, limbs, laws = self._traction, self._limbs, self._laws
        patched = traction.near(data)
        met = False
        for number in range(steps):
            if met or number % LOOK_STEPS == 0:
                moving.apply(data, data.time)
            if number % LOOK_STEPS == 0:
                met = moving.near(data)
            servos.update(data.qpos)
            limbs.update(data)
            laws.prepare(data)
            mujoco.mj_step1(model, data)
            servos.apply(data)
            limbs.apply(data)
            laws.push(data)
            self._machines.decide(data)
            if met:
                moving.drag(data)
            if patched:
                traction.apply(data)
            if compensated:
                compensate(data)
            mujoco.mj_step2(model, data)
            laws.feel(data)
            if patched:
                traction.release(data)
        limbs.feel(data)

    def _remember(self) -> None:
        data = self.data
        self._before = (data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy())
        self._servos_before = self._servos.state()
        self._limbs_before = self._limbs.state(data)
        self._machines_before = self._machines.state()
        self._laws_before = self._laws.state()

    def restore(self) -> None:
        """Part of containing divergence: go back to before the last batch."""
        data = self.data
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = self._before
        data.time = self.time
        self._servos.restore(self._servos_before)
        self._limbs.restore(data, self._limbs_before)
        self._machines.restore(self._machines_before)
        self._laws.restore(self._laws_before)

    # -- containing divergence ---------------------------------------------------------------

    def put_away(self, tree: int) -> None:
        """Part of containing divergence: park a robot's tree, put any other back."""
        robots = self._robot_of_tree()
        if tree in robots:
            slot = self._active[robots[tree]]
            self._servos.release(slot)
            self._limbs.release(slot)
            self._laws.vacate(slot, self.data)
            self._put(slot, self.world.parking[slot])
        else:
            self._put_back(tree)

    def _take_out(self, trees: Sequence[int]) -> list[int]:
        """Strike the robots among the trees off the list; the rest is only reported."""
        robots = self._robot_of_tree()
        for tree in trees:
            if tree not in robots:
                body = self.world.model.body(self.world.model.tree_bodyadr[tree]).name
                _log.warning("a movable object diverged and was put back", body=body)
        lost = [robots[tree] for tree in trees if tree in robots]
        for robot in lost:
            slot = self._active.pop(robot)
            self._release(slot)
            self._leave(slot)
        return lost

    def _robot_of_tree(self) -> dict[int, int]:
        model, layouts = self.world.model, self.world.layouts
        return {
            int(model.dof_treeid[layouts[slot].dof]): robot
            for robot, slot in self._active.items()
            if layouts[slot].dof >= 0
        }

    def _put_back(self, tree: int) -> None:
        """Put a tree to where the model has it, at rest."""
        model, data = self.world.model, self.data
        self._limbs.drop(data, tree)
        dofs = model.dof_treeid == tree
        for joint in np.unique(model.dof_jntid[dofs]):
            start = model.jnt_qposadr[joint]
            stop = start + JOINT_WIDTH[int(model.jnt_type[joint])][0]
            data.qpos[start:stop] = model.qpos0[start:stop]
        data.qvel[dofs] = WAKE
        data.qacc_warmstart[dofs] = 0.0

    # -- growing and shrinking ---------------------------------------------------------------

    def grow(
        self, added: Iterable[RobotModel], replaced: Mapping[int, RobotModel] = MappingProxyType({})
    ) -> Growth:
        """Compile a model with other slots. Reads only immutable state: safe in another thread.

        Args:
            added: slots behind the present ones.
            replaced: free slots that become something else, or `VACANT`.
        """
        old = self.world
        kept = (replaced.get(number, slot) for number, slot in enumerate(old.slots))
        return grow(old, self._scenery, (*kept, *added), self._options)

    def adopt(self, growth: Growth) -> None:
        """Replace the model by another one and carry the whole state over.

        What is in both goes on as if nothing had happened, to the last bit if nothing is new.
        """
        old, new, before = self.data, growth.data, self.world
        new.time = old.time
        new.qpos[growth.joints[1]] = old.qpos[growth.joints[0]]
        new.qvel[growth.dofs[1]] = old.qvel[growth.dofs[0]]
        growth.servos.inherit(self._servos, growth.kept)
        growth.limbs.inherit(new, self._limbs, old, growth.kept)
        growth.laws.inherit(self._laws)
        others = tuple(slot_prefix(slot) for slot in growth.changed)
        carry_over(before.model, old, growth.world.model, new, others)
        self.world, self.data, self._servos = growth.world, new, growth.servos
        self._limbs, self._laws, self._traction = growth.limbs, growth.laws, growth.traction
        self._moving.bind(self.world.model)
        self._machines.bind(self.world)
        self._belts.apply(self.world.model)
        for slot in self._driven:
            self._allow_sleep(slot, False)
        inherit_sleep(before.model, old, growth)
        new.qacc_warmstart[growth.dofs[1]] = old.qacc_warmstart[growth.dofs[0]]
        self._left = {slot: step for slot, step in self._left.items() if slot in growth.kept}
        for slot, kind in enumerate(self.world.slots):
            if kind is not VACANT and slot not in growth.kept:
                self._left[slot] = self.steps
        self._settling = self._parked()
        self._let_rest()

    # -- looking -----------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """An immutable picture of the present state."""
        self._look()
        data = self.data
        return Snapshot(
            time=self.time,
            step=self.steps,
            generation=self.world.generation,
            qpos=_frozen(data.qpos),
            qvel=_frozen(data.qvel),
            xpos=_frozen(data.xpos),
            xquat=_frozen(data.xquat),
            layouts=self._layouts(),
            torque=_frozen(self._limbs.torques()),
            hands=self._limbs.hands(),
            world=self.world,
        )

    def _look(self) -> None:
        """Bring the poses of all bodies up to date."""
        self._moving.apply(self.data, self.data.time)
        mujoco.mj_kinematics(self.world.model, self.data)

    def _layouts(self) -> dict[int, RobotLayout]:
        return {robot: self.world.layouts[slot] for robot, slot in self._active.items()}


def _nothing() -> None:
    """Nobody wants to know."""


def _finite(coordinates: Array) -> Array:
    if not np.isfinite(coordinates).all():
        raise ValueError(f"a pose must be finite: {coordinates}")
    return coordinates


def _frozen(array: Array) -> Array:
    copy = array.copy()
    copy.flags.writeable = False
    return copy
