"""What touches robots and other things in slots, step by step, while somebody wants to know.

After each step the contacts that the solver has worked on are looked through. One that a slot has
with anything but itself is a touch, unless it is only ground: something fixed or loose, in no slot,
that pushes the slot upward, within 45 degrees. Of each pair the first step counts.

A body that sleeps has no contacts in MuJoCo. Whatever it touched when it fell asleep it touches
until it wakes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.ground import GROUND_SLOPE
from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.objects import geom_names


@dataclass(frozen=True, slots=True)
class Pair:
    """Two that touch."""

    body: int  # number of a robot or thing
    other: int | None  # number of another one; None: the scene
    name: str | None  # of a part of the scene, as in `RayHits.names`; None if it has none
    borne: bool  # the other one, in a slot, too, pushes `body` upward, within 45 degrees


Touches = dict[Pair, float]
"""Simulated time (s) at the end of the first step of each touch."""


class Stage(Protocol):
    """What is needed of the engine."""

    world: CompiledWorld
    data: mujoco.MjData

    @property
    def active(self) -> dict[int, int]:
        """Slots by number."""

    @property
    def time(self) -> float:
        """Simulated s."""


class TouchWatch:
    """Collects touches; physics thread."""

    def __init__(self, stage: Stage, solid: Callable[[str], bool]) -> None:
        """Begin with none.

        Args:
            stage: the physics.
            solid: whether a part of the scene, by its name, is never mere ground.
        """
        self._stage, self._solid = stage, solid
        self._generation: int | None = None
        self._seen: set[tuple[int, int, int]] = set()
        self._touches: Touches = {}
        self._before: Touches = {}
        self._began = stage.time

    def note(self, data: mujoco.MjData) -> None:
        """Look at the contacts of the step that has just been made."""
        if not data.ncon:
            return
        world = self._stage.world
        if world.generation != self._generation:
            self._learn(world)
        contact = data.contact
        geoms = contact.geom
        slots = self._slots[geoms]
        up = contact.frame[:, 2]  # the normal points from the first geom to the second
        way = (up > GROUND_SLOPE).astype(int) - (up < -GROUND_SLOPE)
        free = slots < 0
        ground = (free[:, 0] & (way > 0)) | (free[:, 1] & (way < 0))
        ground &= ~self._never[geoms].any(axis=1)
        found = (slots[:, 0] != slots[:, 1]) & (contact.efc_address >= 0) & ~ground
        for index in np.flatnonzero(found).tolist():
            first, second = geoms[index].tolist()
            touch = first, second, int(way[index])
            if touch not in self._seen:
                self._seen.add(touch)
                self._add(*touch, round(float(data.time), 6))

    def take(self) -> Touches:
        """All touches since the last call."""
        asleep = self._sleepers()
        for pair in self._before:
            if pair.body in asleep and (pair.other is None or pair.other in asleep):
                self._touches.setdefault(pair, round(self._began, 6))
        self._before, self._touches = self._touches, {}
        self._seen.clear()
        self._began = self._stage.time
        return self._before

    def _learn(self, world: CompiledWorld) -> None:
        model = world.model
        slots = np.full(model.nbody, -1, dtype=np.intp)
        for layout in world.layouts:
            slots[list(layout.bodies)] = layout.slot
        self._slots: NDArray[np.intp] = slots[model.geom_bodyid]
        self._names = geom_names(model)
        solid = [name is not None and self._solid(name) for name in self._names[:-1]]
        self._never = np.array(solid, dtype=bool)
        self._generation = world.generation
        self._seen.clear()

    def _add(self, first: int, second: int, way: int, time: float) -> None:
        numbers = {slot: number for number, slot in self._stage.active.items()}
        one = numbers.get(int(self._slots[first]))
        two = numbers.get(int(self._slots[second]))
        if one is not None and two is not None:
            pairs = [
                Pair(one, two, None, way < 0),
                Pair(two, one, None, way > 0),
            ]
        elif one is not None and self._slots[second] < 0:
            pairs = [Pair(one, None, self._names[second], False)]
        elif two is not None and self._slots[first] < 0:
            pairs = [Pair(two, None, self._names[first], False)]
        else:
            pairs = []  # with something parked
        for pair in pairs:
            self._touches.setdefault(pair, time)

    def _sleepers(self) -> set[int]:
        """Numbers of all who sleep."""
        world, asleep = self._stage.world, self._stage.data.tree_asleep
        tree = world.model.dof_treeid
        return {
            number
            for number, slot in self._stage.active.items()
            if (dof := world.layouts[slot].dof) >= 0 and asleep[tree[dof]] >= 0
        }
