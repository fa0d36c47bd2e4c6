"""Patches of ground that are not the floor they lie on: water, mud, sand, ice.

The values only; what they do to whoever drives there is in `traction.py`.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Surface"]


@dataclass(frozen=True, slots=True)
class Surface:
    """A patch of ground, parallel to the axes. Where patches overlap, the later one counts.

    Attributes:
        name: unique in the world.
        kind: water, mud, sand, ice or custom.
        x, y: limits of the rectangle, m.
        z: heights between which ground belongs to the patch, m.
        friction: sliding friction coefficient of everything that touches this ground.
        drag: N s/m against each body that touches it, per body: four wheels feel it four times.
        sinkage: how deep bodies sink in away from the edge, m.
        painted: draw it as a thin slab on the floor at height 0.
    """

    name: str
    kind: str
    x: tuple[float, float]
    y: tuple[float, float]
    z: tuple[float, float]
    friction: float
    drag: float = 0.0
    sinkage: float = 0.0
    painted: bool = True
