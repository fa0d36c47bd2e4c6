"""Ray queries: the questions sensors ask of the geometry, and the answers.

The caster itself lives in `raycaster.py`; sensors and their tests need only these values.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["RayFan", "RayHits", "SceneryHit"]

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RayFan:
    """Rays that are answered together.

    Attributes:
        origin: (3,) common start point in the world, or (n, 3) one for each ray, m.
        directions: (n, 3) unit vectors in the world frame.
        max_range: rays end here; a longer way counts as no hit, m.
        normals: also return surface normals.
        through_glass: pass through geometry of a transparent material (its material or geom name
            contains `glass` or `trans`).
        identify: also name what was hit.
    """

    origin: Array
    directions: Array
    max_range: float
    normals: bool = False
    through_glass: bool = False
    identify: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """Answer to one fan.

    Attributes:
        distances: (n,) m along each ray, `inf` where nothing was hit within `max_range`.
        normals: (n, 3) unit normals that face the ray's origin (zero where nothing was hit), or
            None if the fan did not ask.
        names: (n,) name of the geom that was hit, of its body if it has none itself; None where
            neither has a name or nothing was hit. None altogether if the fan did not ask. What
            object a name belongs to tells `Simulation.object_facts`.
    """

    distances: Array
    normals: Array | None = None
    names: tuple[str | None, ...] | None = None


@dataclass(frozen=True, slots=True)
class SceneryHit:
    """The first surface of the world that a single ray meets.

    Attributes:
        distance: along the ray, m.
        geom: number of the geom, which tells pieces without a name apart.
        name: as in `RayHits.names`.
        entering: the ray meets the surface from outside; unknown orientation counts as that.
    """

    distance: float
    geom: int
    name: str | None
    entering: bool
