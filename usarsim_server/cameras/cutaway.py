"""Views into a world that lies below a ceiling: at what height it is cut, and what the cut shows.

From above one sees the roof of a building, and of a level that is cut out of rock nothing but rock.
So pictures from above leave out what is higher than people, or than a ceiling that is lower; where
the cut goes through something solid it is dark.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array
from usarsim_server.simulation.model import SHELF_NAME
from usarsim_server.simulation.rays.triangles import TriangleScene, triangles_of_all

VIEW_CUT = 2.2
"""m above the floor at which views from above are cut."""

BELOW_CEILING = 0.02
"""m below a ceiling that is lower than that."""

CUT_COLOR = np.array([0.20, 0.23, 0.27])
"""Red, green, blue of what is cut through, from 0 to 1."""

PROBES = 64
"""Along each side of a world."""

ABOVE, NEAR = 0.05, 0.2
"""m above the floor whence ceilings are looked for, and below which a floor is this one."""

LEAST = 20
"""Probes that have to stand on the floor."""

START_ABOVE, START_HOVER = 5.0, 0.25
"""m within which a floor below a start pose is its own, and how high it is taken to be if none is.
"""

PLANE = 200.0
"""m: half of what is drawn of an endless plane."""

FELT = 3
"""Group of the pieces of imported maps that only collide."""

PAD = 0.3
"""m around the rooms of a world that is cut, and below their floor: as thick as walls are."""

_KINDS = mujoco.mjtGeom
CONVEX = tuple(
    int(kind)
    for kind in (
        _KINDS.mjGEOM_BOX,
        _KINDS.mjGEOM_SPHERE,
        _KINDS.mjGEOM_CYLINDER,
        _KINDS.mjGEOM_CAPSULE,
        _KINDS.mjGEOM_ELLIPSOID,
    )
)
"""Kinds of pieces that are solid and convex, beside meshes of `FELT`; terrain is not cut."""

DOWN = np.array([[0.0, 0.0, -1.0]])


@dataclass(frozen=True, slots=True, eq=False)
class Cutaway:
    """Where a world is cut for pictures from above."""

    level: float  # m: nothing higher is drawn; infinity: all is
    lower: Array  # corners (3,) of what is to be in the picture, m
    upper: Array


def find_cutaway(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    starts: Sequence[tuple[float, float, float]],
    lower: Array,
    upper: Array,
) -> Cutaway:
    """Where to cut a world so that one sees where robots are.

    Only worlds of which most of the floor lies below something are cut.

    Args:
        model, data: the world, posed.
        starts: places (m) of the start poses.
        lower, upper: corners (3,) of the world, m.
    """
    parts = seen_parts(model, data)
    scene = TriangleScene(parts)
    floor = floor_of(scene, starts)
    low = ceiling(scene, floor, lower, upper)
    if not math.isfinite(low):
        return Cutaway(math.inf, lower, upper)
    level = floor + min(VIEW_CUT, max(BELOW_CEILING, low - BELOW_CEILING))
    below, above = _rooms(scene, level, lower, upper)
    below[2] = min(max(below[2], floor - PAD), level)
    places = np.array(starts)
    below[:2] = np.maximum(np.minimum(below[:2], places[:, :2].min(axis=0)) - PAD, lower[:2])
    above[:2] = np.minimum(np.maximum(above[:2], places[:, :2].max(axis=0)) + PAD, upper[:2])
    return Cutaway(level, below, above)


def seen_parts(model: mujoco.MjModel, data: mujoco.MjData) -> list[tuple[int, Array]]:
    """Number and triangles (n, 3, 3) of all geoms that are seen, also of endless planes."""
    shown = model.geom_group <= 2
    shown[[geom for geom in range(model.ngeom) if model.geom(geom).name == SHELF_NAME]] = False
    chosen = np.flatnonzero(shown)
    found, owners = triangles_of_all(model, chosen.tolist(), data.geom_xpos, data.geom_xmat)
    ends = np.flatnonzero(np.diff(owners, append=-1)) + 1
    parts = list(zip(owners[ends - 1].tolist(), np.split(found, ends), strict=False))
    for n in chosen[model.geom_type[chosen] == _KINDS.mjGEOM_PLANE].tolist():
        parts.append((n, _plane(data.geom_xpos[n], data.geom_xmat[n].reshape(3, 3))))
    return parts


def floor_of(scene: TriangleScene, starts: Sequence[tuple[float, float, float]]) -> float:
    """m: height of the floor below the lowest of some start poses."""
    start = min(starts, key=lambda place: place[2])
    way = float(scene.cast(np.array([start]), DOWN).distances[0])
    return start[2] - (way if way < START_ABOVE else START_HOVER)


def ceiling(scene: TriangleScene, floor: float, lower: Array, upper: Array) -> float:
    """m from a floor, at a height, up to what half of it lies below; inf if that is nothing.

    The corners (3,) are those of the world.
    """
    parts = (np.arange(PROBES) + 0.37) / PROBES  # between the lines of a builder's grid
    x, y = np.meshgrid(*(lower[:2] + parts[:, None] * (upper - lower)[:2]).T)
    start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, floor + ABOVE)])
    below, above = (
        scene.cast(start, np.tile(way, (len(start), 1))).distances for way in (DOWN, -DOWN)
    )
    heights = above[below < NEAR]
    return ABOVE + float(np.median(heights)) if len(heights) >= LEAST else np.inf


def _rooms(scene: TriangleScene, level: float, lower: Array, upper: Array) -> tuple[Array, Array]:
    """Corners of what lies open below a cut: places from which one looks down onto a floor.

    In rock one looks down onto the inside of its lower face. If nothing is open, or windings are
    wrong, the corners (3,) are those that were given.
    """
    low, high = lower.copy(), upper.copy()
    high[2] = min(high[2], level)
    for _ in range(2):  # again where they were found, more finely
        parts = (np.arange(PROBES) + 0.37) / PROBES
        x, y = np.meshgrid(*(low[:2] + parts[:, None] * (high - low)[:2]).T)
        start = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, level)])
        hits = scene.cast(start, np.tile(DOWN, (len(start), 1)), normals=True)
        assert hits.normals is not None
        places = start[(hits.geoms >= 0) & (hits.normals[:, 2] > 0.1)]
        if not len(places):
            break
        step = (high - low)[:2] / PROBES
        edges = places[:, :2].min(axis=0) - step, places[:, :2].max(axis=0) + step
        low[:2], high[:2] = np.maximum(edges[0], low[:2]), np.minimum(edges[1], high[:2])
    return low, high


# ---- cuts through what is solid ----------------------------------------------------------------


def sections(
    model: mujoco.MjModel, data: mujoco.MjData, level: float
) -> Iterator[tuple[int, Array]]:
    """The cut through every fixed convex piece: its geom, corners (k, 2) in order around it, m."""
    meshes = (model.geom_type == _KINDS.mjGEOM_MESH) & (model.geom_group == FELT)
    solid = (model.geom_contype | model.geom_conaffinity) != 0
    chosen = solid & (np.isin(model.geom_type, CONVEX) | meshes)
    chosen &= model.body_weldid[model.geom_bodyid] == 0
    chosen &= np.abs(data.geom_xpos[:, 2] - level) <= model.geom_rbound
    faces, owners = triangles_of_all(
        model, np.flatnonzero(chosen).tolist(), data.geom_xpos, data.geom_xmat
    )
    ends, cut = cut_lines(faces, level)
    owners = np.repeat(owners[cut], 2)
    corners = ends.reshape(-1, 2)
    order = np.argsort(owners, kind="stable")
    owners, corners = owners[order], corners[order]
    starts = np.flatnonzero(np.diff(owners, prepend=-1))
    if not len(starts):
        return
    middles = np.minimum.reduceat(corners, starts) + np.maximum.reduceat(corners, starts)
    away = corners - np.repeat(middles / 2.0, np.diff(starts, append=len(owners)), axis=0)
    around = np.lexsort((np.arctan2(away[:, 1], away[:, 0]), owners))
    parts = np.split(corners[around], starts[1:])
    for geom, part in zip(owners[starts].tolist(), parts, strict=True):
        if len(part) >= 6:
            yield geom, part


def cut_lines(triangles: Array, level: float) -> tuple[Array, NDArray[np.intp]]:
    """The lines in which triangles (n, 3, 3) meet a height: ends (k, 2, 2), and whose they are."""
    above = triangles[:, :, 2] > level
    cut = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
    start, end = triangles[cut], np.roll(triangles[cut], -1, axis=1)
    crossed = above[cut] != np.roll(above[cut], -1, axis=1)  # two edges of each
    p, q = start[crossed], end[crossed]
    share = (level - p[:, 2]) / (q[:, 2] - p[:, 2])
    places = p[:, :2] + (q - p)[:, :2] * share[:, None]
    return places.reshape(-1, 2, 2), cut


class Caps:
    """The sections of a world at one height, as an eye above them sees them."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, level: float) -> None:
        self.level = level
        parts = []
        for geom, corners in sections(model, data, level):
            flat = np.column_stack([corners, np.full(len(corners), level)])
            first = np.broadcast_to(flat[0], (len(flat) - 2, 3))
            parts.append((geom, np.stack([first, flat[1:-1], flat[2:]], axis=1)))
        self._scene = TriangleScene(parts)

    def seen(self, position: Array, directions: Array) -> tuple[Array, NDArray[np.intp]]:
        """Which of some rays from a place (3,) above the cut meet it: metres per direction, geoms.

        Directions (n, 3) need not be unit vectors. Infinity and -1 for those that meet none.
        """
        falling = directions[:, 2] < -1e-9
        ways = np.full(len(directions), np.inf)
        geoms = np.full(len(directions), -1, dtype=np.intp)
        rays = np.flatnonzero(falling)
        depths = (self.level - position[2]) / directions[rays, 2]
        # From just above the cut: rays are of single precision.
        start = position + depths[:, None] * directions[rays]
        start[:, 2] = self.level + 0.01
        hits = self._scene.cast(start, np.tile(DOWN, (len(rays), 1)))
        met = hits.geoms >= 0
        ways[rays[met]], geoms[rays[met]] = depths[met], hits.geoms[met]
        return ways, geoms


def _plane(position: Array, turn: Array) -> Array:
    quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * PLANE @ turn.T + position
    return np.asarray(np.array([quad[[0, 1, 2]], quad[[0, 2, 3]]]))
