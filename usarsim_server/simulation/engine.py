"""The physics itself: one model, its data, its servos. Used by the physics thread alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.base.logs import Log
from usarsim_server.simulation.articulation import JointOrder
from usarsim_server.simulation.divergence import Before, culprits, is_sound
from usarsim_server.simulation.frames import Pose, pose_of
from usarsim_server.simulation.growth import Generations, Growth, WorldParts
from usarsim_server.simulation.machines import Machine
from usarsim_server.simulation.model import (
    JOINT_WIDTH,
    VACANT,
    WAKE,
    PhysicsOptions,
    RobotModel,
    put,
    root_qpos,
    slot_prefix,
)
from usarsim_server.simulation.movers import Mover, Way, carry_over
from usarsim_server.simulation.parts import Hook
from usarsim_server.simulation.sleep import inherit_sleep
from usarsim_server.simulation.snapshot import Snapshot
from usarsim_server.simulation.splice import FixedPart

LEAST_COMMAND = 1e-6
"""rad/s or m/s below which a robot is told to stand: what is told to move never sleeps."""

Array = NDArray[np.float64]

_log = Log("simulation")


class Engine:
    """Steps the world, holds robots in slots, contains divergence.

    Of what diverges (see `divergence.py`) a robot leaves the world, a movable object returns to
    where the world file has it.

    Attributes:
        world: the current model generation.
        data: live state; nobody else may touch it.
        parts: what works on the bodies beside MuJoCo.
        steps: number of steps since the world started.
        after_batch, after_step: called after every batch of steps, and after every step.
    """

    def __init__(
        self,
        scenery: Callable[[], mujoco.MjSpec],
        options: PhysicsOptions,
        slots: Sequence[RobotModel] = (),
        fixed: FixedPart | None = None,
    ) -> None:
        self._generations = Generations(scenery, options, fixed)
        self._options = options
        self.world = self._generations.first(slots)
        self.data = mujoco.MjData(self.world.model)
        self.parts = WorldParts(self.world, options)
        self._before = Before(self.data, self.parts)
        self._active: dict[int, int] = {}
        self._left: dict[int, int] = {}
        self.after_batch: Callable[[], None] = lambda: None
        self.after_step: tuple[Hook, ...] = ()
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
        return self.parts.moving.movers

    def set_movers(self, movers: Sequence[Mover], machines: Sequence[Machine] = ()) -> None:
        """Replace all movers and machines; a body that nobody moves any more stays where it is.

        Raises:
            ValueError: if a body cannot be moved; the old ones stay.
        """
        self._look()
        own = (mover for one in machines for mover in one.movers)
        self.parts.moving.replace([*movers, *own], watched=bool(machines))
        self.parts.machines.replace(machines)

    def follow(self, robot: int, ways: Sequence[Way]) -> None:
        """Let the bodies of a kinematic thing go their ways, the base first; none: they stay.

        Raises:
            KeyError: if it is not in the world.
        """
        bodies = self.world.layouts[self._active[robot]].mocap
        self._look()
        model = self.world.model
        pairs = zip(bodies, ways, strict=True) if ways else ()
        movers = [Mover(model.body(body).name, way) for body, way in pairs]
        self.parts.moving.follow(robot, movers)

    def pose(self, robot: int) -> Pose:
        """Present pose of an active robot or thing.

        Raises:
            KeyError: if it is not in the world.
        """
        base = self.world.layouts[self._active[robot]].base
        self._look()
        return pose_of(self.data.xpos[base], self.data.xquat[base])

    def run_belts(self, tag: str, factor: float) -> int:
        """Let conveyors run at so many times their speed in the scene; how many there are."""
        found = self.parts.belts.run(tag, factor)
        if found:
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
        self.parts.occupy(slot)

    def vacate(self, robot: int) -> None:
        """Park the robot's slot again; unknown robots are ignored."""
        slot = self._active.pop(robot, None)
        if slot is None:
            return
        self.parts.moving.follow(robot, ())
        self._release(slot)
        self._put(slot, self.world.parking[slot])
        self._leave(slot)

    def _leave(self, slot: int) -> None:
        """Note that a slot is free and parked from now on."""
        self._left[slot] = self.steps
        self.parts.sleep.park(slot)

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
        self.parts.moving.follow(robot, ())
        self._put(self._active[robot], coordinates)
        return True

    def drive(self, robot: int, targets: Array) -> None:
        """Set wheel speed targets (rad/s, part order; NaN: rolls freely) and wake the robot.

        Raises:
            ValueError: if their count is wrong.
        """
        slot = self._active.get(robot)
        if slot is None:
            return
        self.parts.wheels.command(slot, _felt(targets))
        self._note_driven(slot)
        self.parts.sleep.wake(slot, self.data)

    def wheel_targets(self, robot: int) -> Array:
        """Commanded wheel speeds (rad/s) of an active robot."""
        return self.parts.wheels.targets(self._active[robot])

    def command_joints(self, robot: int, orders: Mapping[str, JointOrder]) -> None:
        """Give orders to joints of a robot by name and wake it; unknown joints are ignored."""
        slot = self._active.get(robot)
        if slot is not None:
            self.parts.joints.command(slot, orders)
            self.parts.sleep.wake(slot, self.data)

    def hold_joints(self, robot: int) -> None:
        """Have all joints of a robot keep the places that they have now."""
        slot = self._active.get(robot)
        if slot is not None:
            self.parts.joints.hold(slot, self.data)

    def command_law(self, robot: int, values: Array) -> None:
        """Command the laws of motion of a robot (see `motion_laws.py`) and wake it.

        Raises:
            ValueError: if the count is wrong.
        """
        slot = self._active.get(robot)
        if slot is not None:
            self.parts.laws.command(slot, _felt(values))
            self._note_driven(slot)
            self.parts.sleep.wake(slot, self.data)

    def operate_hand(self, robot: int, hand: str, close: bool) -> bool:
        """Close or open a hand of a robot; whether it obeyed (see `Hands.operate`)."""
        slot = self._active.get(robot)
        if slot is None:
            return False
        self._look()
        self.parts.sleep.wake(slot, self.data)
        return self.parts.hands.operate(self.data, slot, hand, close)

    def _release(self, slot: int) -> None:
        self.parts.release(slot, self.data)
        self._note_driven(slot)

    def _note_driven(self, slot: int) -> None:
        self.parts.sleep.let_drive(slot, self.parts.drives(slot))

    def _put(self, slot: int, coordinates: Array) -> None:
        layout = self.world.layouts[slot]
        data, model = self.data, self.world.model
        if layout.mocap.size:
            put(self.world, data, slot, coordinates)
            return
        put(self.world, data, slot, coordinates)
        data.qpos[list(layout.joint_qpos.values())] = model.qpos0[list(layout.joint_qpos.values())]
        for dofs in (slice(layout.dof, layout.dof + 6), list(layout.joint_dof.values())):
            data.qvel[dofs] = WAKE
            data.qacc_warmstart[dofs] = 0.0
        self.parts.place(slot, data, pose_of(coordinates[:3], coordinates[3:]))

    # -- stepping ----------------------------------------------------------------------------

    def advance(self, steps: int) -> list[int]:
        """Advance the world by a number of steps.

        Returns:
            Robots whose state diverged; they have been parked.

        Raises:
            UsarsimError: if the world diverges even without robots.
        """
        self._before.keep()
        lost = [] if self.run(steps) else self._take_out(culprits(self, steps))
        self.steps += steps
        self.parts.sleep.let_rest(self.data)
        self.after_batch()
        return lost

    def run(self, steps: int) -> bool:
        """Part of `advance`: step, and say whether the state is sound then; `steps` does not count
        these."""
        model, data, parts = self.world.model, self.data, self.parts
        before, between, after = parts.before, parts.between, (*parts.after, *self.after_step)
        parts.begin(data)
        sound: bool | None = None
        if parts.native and not self.after_step and parts.rest(steps):
            sound = parts.native.step(model, data, steps)
        if sound is None:
            for _ in range(steps):
                for hook in before:
                    hook(data)
                mujoco.mj_step1(model, data)
                for hook in between:
                    hook(data)
                mujoco.mj_step2(model, data)
                for hook in after:
                    hook(data)
            sound = is_sound(data)
        parts.end(data)
        return sound

    def restore(self) -> None:
        """Part of containing divergence: go back to before the last batch."""
        self.data.time = self.time
        self._before.restore()

    # -- containing divergence ---------------------------------------------------------------

    def put_away(self, tree: int) -> None:
        """Part of containing divergence: park a robot's tree, put any other back."""
        robots = self._robot_of_tree()
        if tree in robots:
            slot = self._active[robots[tree]]
            self.parts.release(slot, self.data)
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
        self.parts.drop(tree, data)
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
        """Compile a model with other slots, in any thread, see `Generations.following`.

        Args:
            added: slots behind the present ones.
            replaced: free slots that become something else, or `VACANT`.
        """
        old = self.world
        kept = (replaced.get(number, slot) for number, slot in enumerate(old.slots))
        return self._generations.following(old, (*kept, *added))

    def adopt(self, growth: Growth) -> None:
        """Replace the model by another one and carry the whole state over.

        What is in both goes on as if nothing had happened, to the last bit if nothing is new.
        """
        old, new, before = self.data, growth.data, self.world
        new.time = old.time
        new.qpos[growth.joints[1]] = old.qpos[growth.joints[0]]
        new.qvel[growth.dofs[1]] = old.qvel[growth.dofs[0]]
        growth.parts.inherit(self.parts, growth.kept, new, old)
        others = tuple(slot_prefix(slot) for slot in growth.changed)
        carry_over(before.model, old, growth.world.model, new, others)
        self.world, self.data, self.parts = growth.world, new, growth.parts
        self._before = Before(new, growth.parts)
        self._generations.adopted(growth)
        inherit_sleep(old, self.world.model, new, growth.trees(before.model), growth.spare)
        new.qacc_warmstart[growth.dofs[1]] = old.qacc_warmstart[growth.dofs[0]]
        self._left = {slot: step for slot, step in self._left.items() if slot in growth.kept}
        for slot, kind in enumerate(self.world.slots):
            if kind is not VACANT and slot not in growth.kept:
                self._left[slot] = self.steps
        self.parts.sleep.let_rest(new)

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
            layouts={robot: self.world.layouts[slot] for robot, slot in self._active.items()},
            torque=_frozen(self.parts.joints.torques()),
            hands=self.parts.hands.states(),
            world=self.world,
        )

    def restart(self) -> None:
        """Put the scene back to how it was when the world began, while time goes on.

        What hangs or lies loose is put back, at rest; everything that goes by itself begins anew,
        and what robots and things were told is forgotten.
        """
        model, parts = self.world.model, self.parts
        for slot in self._active.values():
            parts.release(slot, self.data)
            parts.sleep.let_drive(slot, parts.drives(slot))
        taken = {int(model.body_treeid[body]) for one in self.world.layouts for body in one.bodies}
        for tree in range(model.ntree):
            if tree not in taken:
                self.put_away(tree)
        parts.machines.restart(self.time)
        parts.moving.restart(self.time)
        parts.belts.restart()
        self.data.qvel[self.data.qvel == 0.0] = WAKE  # what stood on a lift or at a door may sleep

    def _look(self) -> None:
        """Bring the poses of all bodies up to date."""
        self.parts.moving.apply(self.data, self.data.time)
        mujoco.mj_kinematics(self.world.model, self.data)


def _felt(command: Array) -> Array:
    """A command without what is too small to move anything; NaN stays."""
    return np.where(np.abs(command) < LEAST_COMMAND, 0.0, command)


def _finite(coordinates: Array) -> Array:
    if not np.isfinite(coordinates).all():
        raise ValueError(f"a pose must be finite: {coordinates}")
    return coordinates


def _frozen(array: Array) -> Array:
    copy = array.copy()
    copy.setflags(write=False)
    return copy
