"""Larger models: compiled aside, while the physics goes on with the present one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.laws import Laws
from usarsim_server.simulation.limbs import Limbs
from usarsim_server.simulation.model import (
    CompiledWorld,
    PhysicsOptions,
    RobotModel,
    compile_world,
    matching_joints,
    slot_prefix,
)
from usarsim_server.simulation.servo import WheelServos
from usarsim_server.simulation.traction import Traction

__all__ = ["Growth", "grow", "laws_of"]


@dataclass(frozen=True, slots=True, eq=False)
class Growth:
    """A larger model, ready to replace the running one.

    Attributes:
        world, data: the model and a state of it.
        servos, limbs, laws, traction: what works on it.
        joints: old and new coordinate indices of everything that exists in both.
        dofs: old and new velocity indices of everything that exists in both.
    """

    world: CompiledWorld
    data: mujoco.MjData
    servos: WheelServos
    limbs: Limbs
    laws: Laws
    traction: Traction
    joints: tuple[NDArray[np.intp], NDArray[np.intp]]
    dofs: tuple[NDArray[np.intp], NDArray[np.intp]]


def grow(
    old: CompiledWorld,
    scenery: Callable[[], mujoco.MjSpec],
    slots: Sequence[RobotModel],
    options: PhysicsOptions,
) -> Growth:
    """Compile the generation after `old`. Touches nothing that lives: safe in any thread."""
    world = compile_world(scenery, slots, options, old.generation + 1)
    data = mujoco.MjData(world.model)
    mujoco.mj_forward(world.model, data)
    joints, dofs = matching_joints(old.model, world.model)
    traction = Traction(world.model, options.surfaces)
    return Growth(
        world, data, WheelServos(world), Limbs(world), laws_of(world), traction, joints, dofs
    )


def laws_of(world: CompiledWorld) -> Laws:
    """The laws of motion of all slots."""
    return Laws(
        world.model, [(slot_prefix(number), one.laws) for number, one in enumerate(world.slots)]
    )
