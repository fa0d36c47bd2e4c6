"""Ray queries: what sensors ask of the geometry, the answers, and the report that waits for them.

`cast.py` answers; sensors and their tests need only these values. Many fans become one batch: flat
arrays of rays, and which fan each belongs to.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.snapshot import Snapshot

Array = NDArray[np.float64]
Numbers = NDArray[np.intp]


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


@dataclass(frozen=True, slots=True, eq=False)
class PendingReport:
    """What is to be told about one instant as soon as its rays are answered.

    Attributes:
        snapshot: the instant.
        robot: number of the robot that reports, whose own body the rays do not meet; None for
            nobody's.
        fans: the rays, in any number.
        finish: writes the lines, given the answers to the fans in order.
    """

    snapshot: Snapshot
    robot: int | None = None
    fans: Sequence[RayFan] = ()
    finish: Callable[[Sequence[RayHits]], list[str]] = lambda hits: []


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


@dataclass(frozen=True, slots=False, eq=False)
class RayBatch:
    """The rays of f fans, one after the other.

    Attributes:
        fans: the fans, none of them without rays.
        origins: (n, 3) m. directions: (n, 3) unit vectors.
        begins: (f + 1,) where the rays of each fan begin; n at the end.
        fan: (n,) the fan of each ray.
    """

    fans: Sequence[RayFan]
    origins: Array
    directions: Array
    begins: Numbers
    fan: Numbers

    @cached_property
    def ranges(self) -> Array:
        """Largest distance (n,) that counts as a hit, m."""
        return np.array([fan.max_range for fan in self.fans])[self.fan]

    @cached_property
    def together(self) -> NDArray[np.bool_]:
        """Which fans (f,) have one start point for all their rays."""
        return np.array([fan.origin.ndim == 1 for fan in self.fans], dtype=bool)

    @cached_property
    def starts(self) -> tuple[Array, Array]:
        """Middle (f, 3) of the start points of each fan, and how far they are away from it (f,)."""
        begins = self.begins[:-1]
        if self.together.all():
            return self.origins[begins], np.zeros(len(self.fans))
        counts = np.diff(self.begins)[:, None]
        middles = np.add.reduceat(self.origins, begins, axis=0) / counts
        away = np.linalg.norm(self.origins - middles[self.fan], axis=1)
        return middles, np.maximum.reduceat(away, begins)

    @cached_property
    def cones(self) -> tuple[Array, Array]:
        """Axis (f, 3) and half angle (f,) of a cone around the rays of each fan."""
        begins = self.begins[:-1]
        means = np.add.reduceat(self.directions, begins, axis=0)
        means /= np.diff(self.begins)[:, None]
        lengths = np.linalg.norm(means, axis=1)
        scattered = lengths < 0.1
        axes = means / np.where(scattered, 1.0, lengths)[:, None]
        axes[scattered] = (1.0, 0.0, 0.0)
        along = np.einsum("ij,ij->i", self.directions, axes[self.fan])
        half = np.arccos(np.clip(np.minimum.reduceat(along, begins), -1.0, 1.0))
        half[scattered] = np.pi
        return axes, half

    @cached_property
    def through_glass(self) -> NDArray[np.bool_] | None:
        """Which rays (n,) do not see glass; None if all of them do."""
        through = np.array([fan.through_glass for fan in self.fans], dtype=bool)
        return through[self.fan] if through.any() else None


def join(fans: Sequence[RayFan]) -> RayBatch:
    """Put fans together; there must be at least one, and each must have rays."""
    counts = np.array([len(fan.directions) for fan in fans], dtype=np.intp)
    begins = np.zeros(len(fans) + 1, dtype=np.intp)
    np.cumsum(counts, out=begins[1:])
    directions = np.concatenate([fan.directions for fan in fans])
    if all(fan.origin.ndim == 1 for fan in fans):
        origins = np.repeat(np.array([fan.origin for fan in fans]), counts, axis=0)
    else:
        origins = np.concatenate(
            [np.broadcast_to(fan.origin, fan.directions.shape) for fan in fans]
        )
    return RayBatch(fans, origins, directions, begins, np.repeat(np.arange(len(fans)), counts))
