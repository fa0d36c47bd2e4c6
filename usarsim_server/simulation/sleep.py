"""Who may sleep: what stands still costs little, once it sleeps and looks for no contacts.

Robots that are told to drive never sleep, however slow they are. Parked ones do, and are left out
of the search for contacts, which is what a sleeping robot costs most in.
"""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Pose
from usarsim_server.simulation.model import WAKE, CompiledWorld
from usarsim_server.simulation.parts import Part

_SLEEP_FLAG = int(mujoco.mjtEnableBit.mjENBL_SLEEP)
_SLEEP_LISTS = ("tree_awake", "body_awake", "body_awake_ind", "parent_awake_ind", "dof_awake_ind")
_SLEEP_COUNTS = ("ntree_awake", "nbody_awake", "nparent_awake", "nv_awake")


class Sleep(Part):
    """Sleep of the slots of one model generation."""

    def __init__(self, world: CompiledWorld) -> None:
        self._world = world
        self._taken: set[int] = set()
        self._driven: set[int] = set()
        self._settling = self._parked()
        """Free slots that have not fallen asleep yet."""

    def occupy(self, slot: int) -> None:
        self._taken.add(slot)

    def park(self, slot: int) -> None:
        """A slot is free and parked from now on."""
        self._taken.discard(slot)
        if self._world.layouts[slot].dof >= 0:
            self._settling.add(slot)

    def place(self, slot: int, data: mujoco.MjData, pose: Pose) -> None:
        """Wherever a slot is put, it touches things at first."""
        self._touch(slot, True)
        self._settling.discard(slot)

    def wake(self, slot: int, data: mujoco.MjData) -> None:
        """Wake a slot."""
        dof = self._world.layouts[slot].dof
        if data.qvel[dof] == 0.0:
            data.qvel[dof] = WAKE

    def let_drive(self, slot: int, driven: bool) -> None:
        """Keep a slot awake while it is told to drive."""
        if driven != (slot in self._driven):
            (self._driven.add if driven else self._driven.remove)(slot)
            self._allow(slot, not driven)

    def let_rest(self, data: mujoco.MjData) -> None:
        """Leave parked slots that have fallen asleep out of the search for contacts."""
        for slot in tuple(self._settling):
            if data.tree_asleep[self._tree(slot)] >= 0:
                self._settling.remove(slot)
                self._touch(slot, False)

    def inherit(
        self, older: Sleep, slots: Sequence[int], data: mujoco.MjData, old: mujoco.MjData
    ) -> None:
        self._taken, self._driven = older._taken, older._driven
        for slot in self._driven:
            self._allow(slot, False)
        self._settling = self._parked()

    def _parked(self) -> set[int]:
        """Free slots that forces move."""
        layouts = self._world.layouts
        return {one.slot for one in layouts if one.dof >= 0 and one.slot not in self._taken}

    def _touch(self, slot: int, touching: bool) -> None:
        bodies = list(self._world.layouts[slot].bodies)
        model, (types, affinities) = self._world.model, self._world.masks
        model.body_contype[bodies] = types[bodies] if touching else 0
        model.body_conaffinity[bodies] = affinities[bodies] if touching else 0

    def _allow(self, slot: int, allowed: bool) -> None:
        policy = mujoco.mjtSleepPolicy
        chosen = policy.mjSLEEP_ALLOWED if allowed else policy.mjSLEEP_NEVER
        self._world.model.tree_sleep_policy[self._tree(slot)] = int(chosen)

    def _tree(self, slot: int) -> int:
        return int(self._world.model.dof_treeid[self._world.layouts[slot].dof])


def inherit_sleep(
    old: mujoco.MjData,
    model: mujoco.MjModel,
    data: mujoco.MjData,
    twins: NDArray[np.intp],
    lists: mujoco.MjData,
) -> None:
    """Bring a state up to date and let those sleep in it that slept in the old one.

    MuJoCo has no call for that. It puts trees to sleep, and lists who is awake, when a state is
    reset; what it does not work out while they sleep has to be there before.

    Args:
        old: the state that was.
        model, data: those that are to be; coordinates and velocities are the old ones already.
        twins: the tree here of every tree of the old model, -1 for those that are gone.
        lists: another state of the model, which is used for this.
    """
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
    mujoco.mj_resetData(model, lists)
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
