"""Larger and smaller models: compiled aside, while the physics goes on with the present one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.ground import Belts, Compensation, Traction
from usarsim_server.simulation.hands import Hands
from usarsim_server.simulation.machines import Machines
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
from usarsim_server.simulation.movers import MovingBodies
from usarsim_server.simulation.parts import Part, Parts
from usarsim_server.simulation.servos import JointServos, WheelServos
from usarsim_server.simulation.sleep import Sleep


class WorldParts(Parts):
    """The parts of one model generation, by name for those who command them."""

    def __init__(self, world: CompiledWorld, options: PhysicsOptions) -> None:
        model = world.model
        self.wheels = WheelServos(world)
        self.joints = JointServos(world)
        self.laws = Laws(model, [(slot_prefix(n), one.laws) for n, one in enumerate(world.slots)])
        self.machines = Machines(world)
        self.moving = MovingBodies(model)
        self.belts = Belts(model)
        self.hands = Hands(world)
        self.sleep = Sleep(world)
        # Machines decide before bodies go; contacts are changed by the ground, compensated last.
        contacts: list[Part] = [Traction(model, options.surfaces)] if options.surfaces else []
        if options.compensation:
            contacts.append(Compensation())
        first = (self.wheels, self.joints, self.laws, self.machines, self.moving, self.belts)
        super().__init__(*first, *contacts, self.hands, self.sleep)


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """Another model, ready to replace the running one."""

    world: CompiledWorld  # the model and a state of it
    data: mujoco.MjData
    parts: WorldParts  # what works on it
    joints: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Old and new coordinate indices of everything that exists in both."""
    dofs: tuple[NDArray[np.intp], NDArray[np.intp]]
    """Old and new velocity indices of everything that exists in both."""
    kept: tuple[int, ...]  # slots that are the same in both
    changed: tuple[int, ...]  # slots of the old model that are of another kind, or are gone

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
    return Growth(world, data, WorldParts(world, options), joints, dofs, kept, changed)
