"""Reads smoke and ground of a world folder: the tables `[[smoke]]` and `[[surface]]`."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from usarsim_server.simulation.frames import Pose, Vector, quaternion_from_rpy
from usarsim_server.simulation.ground import Surface
from usarsim_server.worlds.description import Smoke, SmokePuff, SmokeVolume
from usarsim_server.worlds.tables import Table

SMOKE_KINDS = ("regional", "local", "global")
SHAPES = ("box", "ellipsoid")

PARTICLE_RADIUS = 0.128
"""m: 32 Unreal units, as the particles of the original had (robots reference 1.12)."""
PARTICLES = 60
MAX_PARTICLES = 5000
MIN_DENSITY, MAX_DENSITY = 1e-6, 100.0
MAX_SIZE = 10_000.0

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


def read_smoke(tables: Sequence[Table]) -> Smoke:
    """All `[[smoke]]` tables of a world.

    Raises:
        WorldError: naming table, key, what is wrong and what to write instead.
    """
    volumes: list[SmokeVolume] = []
    puffs: list[SmokePuff] = []
    haze, haze_top = 0.0, math.inf
    for number, table in enumerate(tables, start=1):
        match table.choice("kind", SMOKE_KINDS):
            case "regional":
                volumes.append(_volume(table))
            case "local":
                puffs.append(_puff(table, number))
            case _:
                if haze:
                    raise table.error(
                        "kind", "a second global smoke", "keep one; regional smoke has a place"
                    )
                table.text("name")
                haze = _density(table)
                haze_top = table.number("top", default=math.inf)
        table.finish()
    return Smoke(tuple(volumes), tuple(puffs), haze, haze_top)


def _volume(table: Table) -> SmokeVolume:
    yaw = math.radians(table.number("yaw_degrees", default=0.0))
    return SmokeVolume(
        name=table.text("name"),
        shape=table.choice("shape", SHAPES) if table.has("shape") else SHAPES[0],
        pose=Pose(table.vector("position"), quaternion_from_rpy(0.0, 0.0, yaw)),
        size=_size(table),
        density=_density(table),
    )


def _puff(table: Table, number: int) -> SmokePuff:
    return SmokePuff(
        name=table.text("name"),
        position=table.vector("position"),
        size=_size(table),
        particles=table.integer("particles", default=PARTICLES, low=1, high=MAX_PARTICLES),
        radius=table.number("radius", default=PARTICLE_RADIUS, low=0.001, high=10.0),
        seed=table.integer("seed", default=number, low=0, high=2**31),
        lifetime=table.number("lifetime", default=0.0, low=0.0, high=3600.0),
    )


def _density(table: Table) -> float:
    return table.number("density", default=None, low=MIN_DENSITY, high=MAX_DENSITY)


def _size(table: Table) -> Vector:
    size = table.vector("size")
    if not all(0.0 < edge <= MAX_SIZE for edge in size):
        raise table.error(
            "size", f"{size} has an edge of no length", "write full lengths in metres"
        )
    return size


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
        friction=table.number("friction", default=ground and ground.friction, low=0.0, high=10.0),
        drag=table.number("drag", default=ground.drag if ground else 0.0, low=0.0, high=1e5),
        sinkage=table.number(
            "sinkage", default=ground.sinkage if ground else 0.0, low=0.0, high=0.5
        ),
        painted=not table.has("z"),
    )
    table.finish()
    return surface
