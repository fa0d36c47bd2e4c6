"""Who runs the machinery of a world."""

from __future__ import annotations

from dataclasses import dataclass

from usarsim_server.simulation.machines import Machine
from usarsim_server.simulation.movers import Mover
from usarsim_server.worlds.machinery.doors import DoorOperator
from usarsim_server.worlds.machinery.lifts import LiftOperator
from usarsim_server.worlds.machinery.machinery import Drive, Machinery
from usarsim_server.worlds.machinery.obstacles import ObstacleDriver, travelling


@dataclass(frozen=True, slots=True)
class Operators:
    """Movers that are functions of time alone, and machines that decide."""

    movers: tuple[Mover, ...]
    machines: tuple[Machine, ...]


def operators_of(machinery: Machinery) -> Operators:
    """Fresh operators of all machinery; for `Simulation.set_movers`."""
    doors = [DoorOperator(one) for one in machinery.doors if isinstance(one.mechanism, Drive)]
    waiting = [ObstacleDriver(one) for one in machinery.obstacles if one.distance > 0.0]
    return Operators(
        movers=tuple(travelling(one) for one in machinery.obstacles if one.distance == 0.0),
        machines=(*doors, *map(LiftOperator, machinery.lifts), *waiting),
    )
