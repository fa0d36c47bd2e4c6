"""Machines: bodies that go their own way by decisions, such as a door that opens for whoever comes.

A machine decides at fixed simulated times, between two halves of a step, by what it sees then; in
between its bodies follow functions of time like those of every other mover. So runs repeat
whatever the batches in which the physics advances.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import mujoco

from usarsim_server.simulation.model import CompiledWorld
from usarsim_server.simulation.movers import Mover
from usarsim_server.simulation.presence import Presence

__all__ = ["DECISION_INTERVAL", "Machine", "Machines"]

DECISION_INTERVAL = 0.05
"""s of simulated time, to the nearest step, between two decisions of a machine."""


class Machine(Protocol):
    """Something that decides how its bodies go on."""

    @property
    def movers(self) -> tuple[Mover, ...]:
        """Place its bodies as decided last.

        A decision changes the ways from its own moment on, without a jump.
        """

    @property
    def building(self) -> bool:
        """Whether it is a part of the building, like a door; others are seen by machines."""

    def decide(self, time: float, presence: Presence) -> None:
        """Decide at a simulated time (s); called by the physics thread, must return at once."""

    def state(self) -> object:
        """What has been decided; immutable."""

    def restore(self, state: object) -> None:
        """Go back to an earlier decision."""


class Machines:
    """All machines of a world; used by the physics thread."""

    def __init__(self) -> None:
        """Start without any."""
        self._machines: tuple[Machine, ...] = ()
        self._presences: tuple[Presence, ...] = ()
        self._every = 1

    def replace(self, machines: Sequence[Machine], world: CompiledWorld) -> None:
        """Replace all machines.

        Raises:
            KeyError: if one of their bodies does not exist; the old ones stay.
        """
        new = tuple(machines)
        self._presences = _presences(new, world)
        self._machines = new
        self._every = max(1, round(DECISION_INTERVAL / float(world.model.opt.timestep)))

    def bind(self, world: CompiledWorld) -> None:
        """Look up all bodies in another model generation."""
        self._presences = _presences(self._machines, world)

    def decide(self, data: mujoco.MjData) -> None:
        """Let all machines decide if it is time; between `mj_step1` and `mj_step2`."""
        if not self._machines:
            return
        if round(data.time / data.model.opt.timestep) % self._every:
            return
        for machine, presence in zip(self._machines, self._presences, strict=True):
            presence.look(data)
            machine.decide(data.time, presence)

    def state(self) -> tuple[object, ...]:
        """What all have decided, for `restore`."""
        return tuple(machine.state() for machine in self._machines)

    def restore(self, state: tuple[object, ...]) -> None:
        """Go back to earlier decisions."""
        for machine, one in zip(self._machines, state, strict=True):
            machine.restore(one)


def _presences(machines: Sequence[Machine], world: CompiledWorld) -> tuple[Presence, ...]:
    bodies = [tuple(mover.body for mover in machine.movers) for machine in machines]
    fixtures = [
        body
        for machine, own in zip(machines, bodies, strict=True)
        if machine.building
        for body in own
    ]
    return tuple(Presence(world, own, fixtures) for own in bodies)
