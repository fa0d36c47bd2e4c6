"""Ray queries: what sensors ask of the geometry, the answers, and the report that waits for them.

`cast.py` answers; sensors and their tests need only these values. Many fans become one batch: flat
arrays of rays, and which fan each belongs to.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate

import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Numbers
from usarsim_server.simulation.snapshot import Snapshot


@dataclass(frozen=True, slots=True, eq=False)
class RayFan:
    """Rays that are answered together."""

    origin: Array  # (3,) common start point in the world, or (n, 3) one for each ray, m
    directions: Array  # (n, 3) unit vectors in the world frame
    max_range: float  # rays end here; a longer way counts as no hit, m
    normals: bool = False  # also return surface normals
    through_glass: bool = False
    """Pass through geometry of a transparent material (its material or geom name contains `glass`
    or `trans`)."""
    identify: bool = False  # also name what was hit


@dataclass(frozen=True, slots=True, eq=False)
class RayHits:
    """Answer to one fan."""

    distances: Array  # (n,) m along each ray, `inf` where nothing was hit within `max_range`
    normals: Array | None = None
    """(n, 3) unit normals that face the ray's origin (zero where nothing was hit), or None if the
    fan did not ask."""
    names: tuple[str | None, ...] | None = None
    """(n,) name of the geom that was hit, of its body if it has none itself; None where neither has
    a name or nothing was hit. None altogether if the fan did not ask. What object a name belongs to
    tells `Simulation.object_facts`."""


@dataclass(frozen=True, slots=True, eq=False)
class PendingReport:
    """What is to be told about one instant as soon as its rays are answered."""

    snapshot: Snapshot  # the instant
    robot: int | None = None
    """Number of the robot that reports, whose own body the rays do not meet; None for nobody's."""
    fans: Sequence[RayFan] = ()  # the rays, in any number
    finish: Callable[[Sequence[RayHits]], list[str]] = lambda hits: []
    """Writes the lines, given the answers to the fans in order."""


@dataclass(frozen=True, slots=True)
class SceneryHit:
    """The first surface of the world that a single ray meets."""

    distance: float  # along the ray, m
    geom: int  # number of the geom, which tells pieces without a name apart
    name: str | None  # as in `RayHits.names`
    entering: bool  # the ray meets the surface from outside; unknown orientation counts as that


@dataclass(frozen=True, slots=False, eq=False)
class RayBatch:
    """The rays of f fans, one after the other.

    Attributes:
        fans: the fans.
        points: (p, 3) where rays start, m: one point for all rays of a fan, or one for each.
        point_begins: (f + 1,) where the points of each fan begin; p at the end.
        directions: (n, 3) unit vectors.
        begins: (f + 1,) where the rays of each fan begin; n at the end.
    """

    fans: Sequence[RayFan]
    points: Array
    point_begins: Numbers
    directions: Array
    begins: Numbers

    @cached_property
    def fan(self) -> Numbers:
        """The fan (n,) of each ray."""
        return np.repeat(np.arange(len(self.fans)), np.diff(self.begins))

    @cached_property
    def origins(self) -> Array:
        """Where each ray starts (n, 3), m."""
        within = np.arange(len(self.directions)) - self.begins[self.fan]
        within[self.together[self.fan]] = 0
        return self.points[self.point_begins[self.fan] + within]

    @cached_property
    def fan_ranges(self) -> Array:
        """Largest distance (f,) that counts as a hit for the rays of each fan, m."""
        return np.array([fan.max_range for fan in self.fans], dtype=np.float64)

    @cached_property
    def ranges(self) -> Array:
        """The same of each ray (n,)."""
        return self.fan_ranges[self.fan]

    @cached_property
    def facing(self) -> NDArray[np.bool_]:
        """Which fans (f,) ask for normals."""
        return np.array([fan.normals for fan in self.fans], dtype=bool)

    @cached_property
    def together(self) -> NDArray[np.bool_]:
        """Which fans (f,) have one start point for all their rays."""
        answer: NDArray[np.bool_] = np.diff(self.point_begins) == 1
        return answer

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
        """Axis (f, 3) and half angle (f,) of a cone around the rays of each fan; all have rays."""
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
    def fans_through_glass(self) -> NDArray[np.bool_]:
        """Which fans (f,) do not see glass."""
        return np.array([fan.through_glass for fan in self.fans], dtype=bool)

    @cached_property
    def through_glass(self) -> NDArray[np.bool_] | None:
        """Which rays (n,) do not see glass; None if all of them do."""
        return self.fans_through_glass[self.fan] if self.fans_through_glass.any() else None


def join(fans: Sequence[RayFan]) -> RayBatch:
    """Put fans together; there must be at least one."""
    points = [fan.origin if fan.origin.ndim == 1 else fan.origin.ravel() for fan in fans]
    ways = [fan.directions for fan in fans]
    return RayBatch(
        fans,
        np.concatenate(points).reshape(-1, 3),
        _begins(points) // 3,
        np.concatenate(ways),
        _begins(ways),
    )


def _begins(parts: Sequence[Array]) -> Numbers:
    """Where each of some arrays begins in all of them put together; at the end, where they end."""
    return np.array([0, *accumulate(map(len, parts))], dtype=np.intp)
