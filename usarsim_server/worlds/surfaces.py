"""Reads the patches of ground of a world: water, mud, sand, ice (`[[surface]]`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from usarsim_server.base.tables import Table
from usarsim_server.simulation.ground import Surface

LEVEL = (-0.1, 0.1)
"""Heights of the ground that a patch covers if it does not say: the floor at 0."""


class Ground(NamedTuple):
    """What a kind of ground is like unless a world says otherwise."""

    friction: float
    drag: float
    sinkage: float


GROUNDS: Mapping[str, Ground | None] = {
    "water": Ground(friction=0.5, drag=25.0, sinkage=0.0),
    "mud": Ground(friction=0.4, drag=15.0, sinkage=0.02),
    "sand": Ground(friction=0.6, drag=0.0, sinkage=0.01),
    "ice": Ground(friction=0.1, drag=0.0, sinkage=0.0),
    "custom": None,
}
"""Starting values. On the level a Pioneer with four wheels gets through all of them, one with two
wheels and a caster through all but the mud."""


def read_surface(table: Table) -> Surface:
    """One `[[surface]]` table.

    Raises:
        WorldError: naming table, key, what is wrong and what to write instead.
    """
    kind = table.choice("kind", tuple(GROUNDS))
    ground = GROUNDS[kind]
    surface = Surface(
        name=table.text("name"),
        kind=kind,
        x=table.interval("x"),
        y=table.interval("y"),
        z=table.interval("z") if table.has("z") else LEVEL,
        friction=table.number("friction", ground and ground.friction, low=0.0, high=10.0),
        drag=table.number("drag", ground.drag if ground else 0.0, low=0.0, high=1e5),
        sinkage=table.number("sinkage", ground.sinkage if ground else 0.0, low=0.0, high=0.5),
        painted=not table.has("z"),
    )
    table.finish()
    return surface
