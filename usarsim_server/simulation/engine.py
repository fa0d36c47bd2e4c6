"""The physics itself: one model, its data, its servos. Used by the physics thread alone."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.compensation import compensate
from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import (
    CompiledWorld,
    PhysicsOptions,
    RobotModel,
    compile_world,
    root_qpos,
)
from usarsim_server.simulation.servo import WheelServos
from usarsim_server.simulation.snapshot import RobotLayout, Snapshot

__all__ = ["Engine", "Growth"]

Array = NDArray[np.float64]

SPEED_LIMIT = 1000.0
"""m/s and rad/s: a body that is faster has diverged."""

WAKE = -0.0
"""Written to a velocity of a sleeping body: equal to zero, but not byte by byte, so it wakes."""


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """A larger model that was compiled aside, ready to replace the running one."""

    world: CompiledWorld
    data: mujoco.MjData
    servos: WheelServos
    joints: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Old and new coordinate indices of everything that exists in both."""
    dofs: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Old and new velocity indices of everything that exists in both."""


class Engine:
    """Steps the world, holds robots in slots, contains divergence.

    Attributes:
        world: the current model generation.
        data: live state; nobody else may touch it.
        steps: number of steps since the world started.
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
        self._active: dict[int, int] = {}
        self.steps = 0
        mujoco.mj_kinematics(self.world.model, self.data)
        self._remember()

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

    # -- robots ------------------------------------------------------------------------------

    def free_slot(self, key: str) -> int | None:
        """Lowest free slot of a class, or None if the model has to grow."""
        taken = set(self._active.values())
        return next(
            (i for i, slot in enumerate(self.world.slots) if slot.key == key and i not in taken),
            None,
        )

    def occupy(self, robot: int, slot: int, pose: Pose) -> None:
        """Put a robot into a free slot at a pose."""
        self._active[robot] = slot
        self._servos.release(slot)
        self._put(slot, root_qpos(pose))
        self._remember()

    def vacate(self, robot: int) -> None:
        """Park the robot's slot again; unknown robots are ignored."""
        slot = self._active.pop(robot, None)
        if slot is None:
            return
        self._servos.release(slot)
        self._put(slot, self.world.parking[slot])
        self._remember()

    def teleport(self, robot: int, pose: Pose) -> None:
        """Move an active robot to a pose, at rest."""
        self._put(self._active[robot], root_qpos(pose))
        self._remember()

    def drive(self, robot: int, targets: Array) -> None:
        """Set wheel speed targets (rad/s, part order) and wake the robot."""
        slot = self._active.get(robot)
        if slot is None:
            return
        self._servos.command(slot, targets)
        dof = self.world.layouts[slot].dof
        if self.data.qvel[dof] == 0.0:
            self.data.qvel[dof] = WAKE

    def wheel_targets(self, robot: int) -> Array:
        """Commanded wheel speeds (rad/s) of an active robot."""
        return self._servos.targets(self._active[robot])

    def _put(self, slot: int, coordinates: Array) -> None:
        layout = self.world.layouts[slot]
        data, model = self.data, self.world.model
        data.qpos[layout.qpos : layout.qpos + 7] = coordinates
        data.qpos[list(layout.joint_qpos.values())] = model.qpos0[list(layout.joint_qpos.values())]
        for dofs in (slice(layout.dof, layout.dof + 6), list(layout.joint_dof.values())):
            data.qvel[dofs] = WAKE
            data.qacc_warmstart[dofs] = 0.0
        data.ctrl[layout.wheel_actuators] = 0.0

    # -- stepping ----------------------------------------------------------------------------

    def advance(self, steps: int) -> list[int]:
        """Advance the world by a number of steps.

        Returns:
            Robots whose state diverged; they have been parked, and everything else was set back
            to the state before the call.
        """
        model, data, servos = self.world.model, self.data, self._servos
        compensated = self._options.compensation
        for _ in range(steps):
            servos.update(data.qpos, data.ctrl)
            mujoco.mj_step1(model, data)
            if compensated:
                compensate(data)
            mujoco.mj_step2(model, data)
        if self._sound():
            self.steps += steps
            self._remember()
            return []
        return self._contain()

    def _sound(self) -> bool:
        qvel = self.data.qvel
        if qvel.size and not (qvel.max() < SPEED_LIMIT and qvel.min() > -SPEED_LIMIT):
            return False
        return bool(np.isfinite(self.data.qpos).all())

    def _remember(self) -> None:
        data = self.data
        self._good = (data.qpos.copy(), data.qvel.copy(), data.qacc_warmstart.copy())

    def _contain(self) -> list[int]:
        """Set everything back to the last sound state and take the culprits out."""
        bad = ~(np.abs(self.data.qvel) < SPEED_LIMIT)
        culprits = [robot for robot, slot in self._active.items() if self._touched(slot, bad)]
        self.data.qpos[:], self.data.qvel[:], self.data.qacc_warmstart[:] = self._good
        if not culprits:
            self._reset_scenery(bad)
        for robot in culprits:
            self.vacate(robot)
        self.data.qacc_warmstart[:] = 0.0
        self._remember()
        return culprits

    def _touched(self, slot: int, bad: NDArray[np.bool_]) -> bool:
        layout = self.world.layouts[slot]
        return bool(
            bad[layout.dof : layout.dof + 6].any() or bad[list(layout.joint_dof.values())].any()
        )

    def _reset_scenery(self, bad: NDArray[np.bool_]) -> None:
        """Put diverged movable objects back to where the world file has them."""
        model = self.world.model
        for joint in range(model.njnt):
            dof = model.jnt_dofadr[joint]
            last = model.jnt_dofadr[joint + 1] if joint + 1 < model.njnt else model.nv
            if bad[dof:last].any():
                start = model.jnt_qposadr[joint]
                stop = model.jnt_qposadr[joint + 1] if joint + 1 < model.njnt else model.nq
                self.data.qpos[start:stop] = model.qpos0[start:stop]
                self.data.qvel[dof:last] = WAKE

    # -- growing -----------------------------------------------------------------------------

    def grow(self, added: Iterable[RobotModel]) -> Growth:
        """Compile a model with more slots. Reads only immutable state: safe in another thread."""
        old = self.world
        world = compile_world(
            self._scenery, (*old.slots, *added), self._options, old.generation + 1
        )
        data = mujoco.MjData(world.model)
        mujoco.mj_forward(world.model, data)
        joints, dofs = _matching(old.model, world.model)
        return Growth(world, data, WheelServos(world), joints, dofs)

    def adopt(self, growth: Growth) -> None:
        """Replace the model by a grown one and carry the whole state over."""
        old, new = self.data, growth.data
        new.qpos[growth.joints[1]] = old.qpos[growth.joints[0]]
        new.qacc_warmstart[growth.dofs[1]] = old.qacc_warmstart[growth.dofs[0]]
        velocity = old.qvel[growth.dofs[0]]
        velocity[velocity == 0.0] = WAKE
        new.qvel[growth.dofs[1]] = velocity
        new.time = old.time
        growth.servos.adopt(self._servos)
        self.world, self.data, self._servos = growth.world, new, growth.servos
        mujoco.mj_kinematics(self.world.model, self.data)
        self._remember()

    # -- looking -----------------------------------------------------------------------------

    def snapshot(self) -> Snapshot:
        """An immutable picture of the present state."""
        mujoco.mj_kinematics(self.world.model, self.data)
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
        )

    def _layouts(self) -> dict[int, RobotLayout]:
        return {robot: self.world.layouts[slot] for robot, slot in self._active.items()}


def _frozen(array: Array) -> Array:
    copy = array.copy()
    copy.flags.writeable = False
    return copy


def _matching(
    old: mujoco.MjModel, new: mujoco.MjModel
) -> tuple[tuple[NDArray[np.intp], NDArray[np.intp]], tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Coordinate and velocity indices of the joints that both models have."""
    width = {0: (7, 6), 1: (4, 3), 2: (1, 1), 3: (1, 1)}
    target = {key: joint for joint, key in enumerate(_joint_keys(new))}
    positions: tuple[list[int], list[int]] = ([], [])
    velocities: tuple[list[int], list[int]] = ([], [])
    for joint, key in enumerate(_joint_keys(old)):
        twin = target[key]
        nq, nv = width[int(old.jnt_type[joint])]
        for model, j, q, v in (
            (old, joint, positions[0], velocities[0]),
            (new, twin, positions[1], velocities[1]),
        ):
            q.extend(range(model.jnt_qposadr[j], model.jnt_qposadr[j] + nq))
            v.extend(range(model.jnt_dofadr[j], model.jnt_dofadr[j] + nv))
    as_index = [np.array(part, dtype=np.intp) for part in (*positions, *velocities)]
    return (as_index[0], as_index[1]), (as_index[2], as_index[3])


def _joint_keys(model: mujoco.MjModel) -> list[str]:
    """A name for every joint that survives recompilation; unnamed ones count per body."""
    keys = []
    seen: dict[str, int] = {}
    for joint in range(model.njnt):
        name = model.joint(joint).name
        if not name:
            body = model.body(model.jnt_bodyid[joint]).name
            seen[body] = seen.get(body, 0) + 1
            name = f"@{body}#{seen[body]}"
        keys.append(name)
    return keys
