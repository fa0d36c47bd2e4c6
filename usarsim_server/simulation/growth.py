"""Larger and smaller models: compiled aside, while the physics goes on with the present one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.ground import Traction
from usarsim_server.simulation.limbs import Limbs
from usarsim_server.simulation.model import (
    VACANT,
    CompiledWorld,
    PhysicsOptions,
    RobotModel,
    compile_world,
    matching_joints,
    slot_prefix,
)
from usarsim_server.simulation.motion_laws import Laws
from usarsim_server.simulation.wheels import WheelServos

_SLEEP_FLAG = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_SLEEP_LISTS = ("tree_awake", "body_awake", "body_awake_ind", "parent_awake_ind", "dof_awake_ind")
_SLEEP_COUNTS = ("ntree_awake", "nbody_awake", "nparent_awake", "nv_awake")


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """Another model, ready to replace the running one.

    Attributes:
        world, data: the model and a state of it.
        servos, limbs, laws, traction: what works on it.
        joints: old and new coordinate indices of everything that exists in both.
        dofs: old and new velocity indices of everything that exists in both.
        kept: slots that are the same in both.
        changed: slots of the old model that are of another kind, or are gone.
    """

    world: CompiledWorld
    data: mujoco.MjData
    servos: WheelServos
    limbs: Limbs
    laws: Laws
    traction: Traction
    joints: tuple[NDArray[np.intp], NDArray[np.intp]]
    dofs: tuple[NDArray[np.intp], NDArray[np.intp]]
    kept: tuple[int, ...]
    changed: tuple[int, ...]

    def trees(self, old: mujoco.MjModel) -> NDArray[np.intp]:
        """The kinematic tree here of every tree of the old model, -1 for those that are gone."""
        twins = np.full(old.ntree, -1, dtype=np.intp)
        twins[old.dof_treeid[self.dofs[0]]] = self.world.model.dof_treeid[self.dofs[1]]
        return twins


def grow(
    old: CompiledWorld,
    scenery: Callable[[], mujoco.MjSpec],
    slots: Sequence[RobotModel],
    options: PhysicsOptions,
) -> Growth:
    """Compile the generation after `old`. Touches nothing that lives: safe in any thread.

    Raises:
        ValueError: if MuJoCo cannot compile the result.
    """
    slots = list(slots)
    while slots and slots[-1] is VACANT:
        slots.pop()
    same = [one is other for one, other in zip(old.slots, slots, strict=False)]
    kept = tuple(n for n, equal in enumerate(same) if equal and slots[n] is not VACANT)
    changed = tuple(n for n in range(len(old.slots)) if not (n < len(same) and same[n]))
    world = compile_world(scenery, slots, options, old.generation + 1)
    if len(kept) == sum(slot is not VACANT for slot in slots):
        # Nobody came: let the solver work by the same rules as before, to the last bit.
        world.model.stat.meaninertia = old.model.stat.meaninertia
        kind = mujoco.mjtJacobian
        sparse = mujoco.mj_isSparse(old.model)
        world.model.opt.jacobian = int(kind.mjJAC_SPARSE if sparse else kind.mjJAC_DENSE)
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    joints, dofs = matching_joints(old.model, world.model, changed)
    traction = Traction(world.model, options.surfaces)
    return Growth(
        *(world, data, WheelServos(world), Limbs(world), laws_of(world), traction, joints, dofs),
        *(kept, changed),
    )


def inherit_sleep(old_model: mujoco.MjModel, old: mujoco.MjData, growth: Growth) -> None:
    """Bring a state up to date and let those sleep in it that slept in the old one.

    MuJoCo has no call for that. It puts trees to sleep, and lists who is awake, when a state is
    reset; what it does not work out while they sleep has to be there before.

    Args:
        old_model, old: the model that was.
        growth: the one that is to be; its coordinates and velocities are the old ones already.
    """
    model, data, twins = growth.world.model, growth.data, growth.trees(old_model)
    asleep = np.full(model.ntree, -1, dtype=data.tree_asleep.dtype)
    new = np.setdiff1d(np.arange(model.ntree), twins)
    # Each by itself: those beside which they were compiled may be elsewhere.
    asleep[new] = np.where(data.tree_asleep[new] >= 0, new, data.tree_asleep[new])
    for tree in np.flatnonzero(twins >= 0).tolist():
        asleep[twins[tree]] = _asleep(tree, old.tree_asleep, twins)
    policies, flags = model.tree_sleep_policy.copy(), model.opt.disableflags
    policy = mujoco.mjtSleepPolicy
    model.tree_sleep_policy[:] = np.where(asleep >= 0, policy.mjSLEEP_INIT, policy.mjSLEEP_NEVER)
    # Where everybody is in a state that was reset, those who touch would keep each other awake.
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    lists = mujoco.MjData(model)
    model.tree_sleep_policy[:], model.opt.disableflags = policies, flags
    model.opt.enableflags &= ~_SLEEP_FLAG
    mujoco.mj_fwdPosition(model, data)
    mujoco.mj_fwdVelocity(model, data)
    model.opt.enableflags |= _SLEEP_FLAG
    for name in _SLEEP_LISTS:
        getattr(data, name)[:] = getattr(lists, name)
    for name in _SLEEP_COUNTS:
        setattr(data, name, getattr(lists, name))
    data.tree_asleep[:] = asleep


def _asleep(tree: int, rings: NDArray[np.int32], twins: NDArray[np.intp]) -> int:
    """The sleep of one tree: the next one of its ring, or how long it has been awake.

    Trees that sleep in contact with each other are a ring, each with the number of the next.
    """
    if rings[tree] < 0:
        return int(rings[tree])
    one = tree
    for _ in rings:
        one = int(rings[one])
        if one < 0 or twins[one] < 0:
            break  # one of them is gone, which wakes the others
        if one == tree:
            return int(twins[rings[tree]])
    return -1 - int(mujoco.mjMINAWAKE)


def laws_of(world: CompiledWorld) -> Laws:
    """The laws of motion of all slots."""
    return Laws(
        world.model, [(slot_prefix(number), one.laws) for number, one in enumerate(world.slots)]
    )
