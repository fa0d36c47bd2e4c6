"""Where on the floor of a world robots can drive, and how far it is.

A raster of columns: rays straight down find every surface that something could stand on, with the
room above it. Rays between neighbours find what is in the way, however thin. What is nearer to a
wall or a drop than a robot is wide falls away; waves from the starts reach the rest.

Only what never moves counts: victims, doors and what can be pushed are left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array, Vector
from usarsim_server.simulation.rays.triangles import TriangleScene, triangles_of_all
from usarsim_server.worlds.description import WorldDescription
from usarsim_server.worlds.scene import build_scene

Numbers = NDArray[np.intp]
Truths = NDArray[np.bool_]

CELL = 0.1
"""m: side of a cell, unless the world is too large."""
MOST_CELLS = 600_000
LAYERS = 6
"""Floors above one another that are told apart."""
MOST_HITS = 40
"""Surfaces looked at on the way down through a world."""
WIDE = 100.0
"""m: of an endless floor so much is looked at, if the bounds of the world are no wider."""
MARGIN = 2.0
"""m of it around everything that stands on it, if they are."""
EYE = 0.25
"""m above the floor: the height of lasers, at which a wall is one for a map."""
NEAR_START = 0.2
"""m from a start within which there has to be room for the robot."""
DROP, SUNK = 1.5, 0.5
"""m that the floor may be below, and above, the place where a robot starts."""
GAP = 1e-4
"""m behind a surface from where the next one is looked for."""


@dataclass(frozen=True, slots=True)
class Size:
    """What a robot needs to pass.

    Attributes:
        half_width: m. height: m. climb: step that it gets over, m.
    """

    half_width: float = 0.25
    height: float = 0.5
    climb: float = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Reached:
    """The cells that robots get to: rows along y, columns along x.

    Attributes:
        x, y: of the corner of the first cell, m. cell: side, m.
        way: (rows, columns) m to drive there from the nearest start; infinity where none gets.
        height: (rows, columns) of the floor there, m; NaN where none gets.
        walls: (rows, columns) whether a laser sees a wall there from where robots get.
        stuck: numbers of the starts at which there is no room for the robot.
    """

    x: float
    y: float
    cell: float
    way: Array
    height: Array
    walls: Truths
    stuck: tuple[int, ...]

    def near(self, place: Sequence[float], radius: float) -> Array:
        """Reached places (n, 3) within a horizontal distance of a place, m, the nearest first."""
        first = [self._index(part - radius, axis) for axis, part in enumerate(place[:2])]
        last = [self._index(part + radius, axis) + 1 for axis, part in enumerate(place[:2])]
        window = self.way[first[1] : last[1], first[0] : last[0]]
        rows, columns = np.nonzero(np.isfinite(window))
        rows, columns = rows + first[1], columns + first[0]
        x = self.x + (columns + 0.5) * self.cell
        y = self.y + (rows + 0.5) * self.cell
        away = np.hypot(x - place[0], y - place[1])
        order = np.argsort(away, kind="stable")
        chosen = order[away[order] <= radius]
        heights = self.height[rows[chosen], columns[chosen]]
        return np.stack([x[chosen], y[chosen], heights], axis=1)

    def _index(self, part: float, axis: int) -> int:
        """The column (axis 0) or row (1) of a coordinate, 0 for what lies before the first."""
        begin = (self.x, self.y)[axis]
        return int(np.clip((part - begin) / self.cell, 0, self.way.shape[1 - axis]))

    def way_to(self, place: Sequence[float], radius: float) -> float:
        """m to drive until a place is within a distance (m); infinity if it never is."""
        return float(self.ways(self.near(place, radius)).min(initial=math.inf))

    def ways(self, places: Array) -> Array:
        """m to drive to each of some reached places (n, 2 or 3)."""
        rows = ((places[:, 1] - self.y) / self.cell).astype(int)
        columns = ((places[:, 0] - self.x) / self.cell).astype(int)
        answer: Array = self.way[rows, columns]
        return answer


class Ground:
    """Everything solid in a world that never moves."""

    def __init__(self, world: WorldDescription, *, allow_outside: bool = False) -> None:
        """Build it.

        Raises:
            WorldError: if the scene cannot be built.
        """
        bare = replace(world, victims=(), zones=(), surfaces=())
        model = build_scene(bare, allow_outside=allow_outside).compile()
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        solid = (model.geom_contype | model.geom_conaffinity) != 0
        solid &= model.body_weldid[model.geom_bodyid] == 0
        flat = model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)
        geoms = np.flatnonzero(solid & ~flat).tolist()
        faces, _ = triangles_of_all(model, geoms, data.geom_xpos, data.geom_xmat)
        self._scene = TriangleScene([(0, faces)])
        self._corners = faces.reshape(-1, 3)
        self.floor = max(
            (float(data.geom_xpos[one][2]) for one in np.flatnonzero(solid & flat)), default=None
        )
        """Height of the endless floor, m; None if there is none."""
        self._world = world

    @cached_property
    def box(self) -> tuple[float, float, float, float]:
        """Least x and y, greatest x and y, m, of all that is worth looking at."""
        world = self._world
        low, high = np.array(world.lower[:2]), np.array(world.upper[:2])
        if self.floor is not None and (high - low).max() <= WIDE:
            return float(low[0]), float(low[1]), float(high[0]), float(high[1])
        places = [start.pose.position for start in world.starts]
        places += [victim.pose.position for victim in world.victims]
        points = np.array([*places, *self._corners.tolist()])[:, :2]
        low = np.maximum(points.min(axis=0) - MARGIN, low)
        high = np.minimum(points.max(axis=0) + MARGIN, high)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def inside(self, points: Array) -> Truths:
        """Which places (n, 3) are within something solid."""
        found = np.zeros(len(points), dtype=np.intp)
        if self.floor is not None:
            found += points[:, 2] < self.floor
        origins, up = points.astype(float), np.tile([0.0, 0.0, 1.0], (len(points), 1))
        going = np.arange(len(points))
        for _ in range(MOST_HITS):
            hits = self._scene.cast(origins[going], up[going], normals=True)
            met = hits.geoms >= 0
            going = going[met]
            if not len(going):
                break
            assert hits.normals is not None
            # Out of something (facing up) or into it.
            found[going] += np.where(hits.normals[met, 2] > 0.0, 1, -1)
            origins[going, 2] += hits.distances[met] + GAP
        answer: Truths = found > 0
        return answer

    def sees(self, eyes: Array, place: Sequence[float]) -> Truths:
        """From which of the places (n, 3) another place is in plain sight."""
        return self.clear(eyes, np.broadcast_to(np.asarray(place, dtype=float), eyes.shape))

    def clear(self, starts: Array, ends: Array) -> Truths:
        """Between which places (n, 3) and others (n, 3) nothing stands."""
        ways = ends - starts
        lengths = np.linalg.norm(ways, axis=1)
        hits = self._scene.cast(starts, ways / np.maximum(lengths, 1e-9)[:, None])
        answer: Truths = hits.distances >= lengths
        return answer

    # -- the raster ---------------------------------------------------------------------------

    def reach(self, starts: Sequence[Vector], size: Size) -> Reached:
        """Where robots of a size get from their starts (m)."""
        west, south, east, north = self.box
        area = max(east - west, CELL) * max(north - south, CELL)
        cell = max(CELL, math.sqrt(area / MOST_CELLS))
        # Around it a ring of cells without floor: a wall that begins at the bounds stands there.
        columns, rows = (max(1, math.ceil(w / cell)) + 2 for w in (east - west, north - south))
        west, south = west - cell, south - cell
        x = west + (np.arange(columns) + 0.5) * cell
        y = south + (np.arange(rows) + 0.5) * cell
        middles = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        heights = self._floors(middles, size.height)
        inner = np.pad(np.ones((rows - 2, columns - 2), dtype=bool), 1).reshape(-1)
        heights[:, ~inner] = np.nan
        links = self._links(heights.reshape(LAYERS, rows, columns), middles, cell, size)
        roomy = _eroded(np.isfinite(heights.reshape(-1)), links, _steps(size, cell))
        begun = [_start(heights, middles, roomy, start) for start in starts]
        way = _waves(roomy, links, [one for one in begun if one is not None]) * cell
        layer = np.argmin(way.reshape(LAYERS, -1), axis=0)
        column = np.arange(rows * columns)
        way_2d = way.reshape(LAYERS, -1)[layer, column]
        height = np.where(np.isfinite(way_2d), heights[layer, column], np.nan)
        walls = self._walls(way, heights, links, middles, cell, size)
        return Reached(
            west,
            south,
            cell,
            way_2d.reshape(rows, columns),
            height.reshape(rows, columns),
            self._marked(walls, west, south, cell, (rows, columns)),
            tuple(number for number, one in enumerate(begun) if one is None),
        )

    def _floors(self, middles: Array, room: float) -> Array:
        """Heights (LAYERS, n) of surfaces with so much room (m) above them; NaN: no more."""
        count = len(middles)
        top = float(self._corners[:, 2].max(initial=self.floor or 0.0)) + 1.0
        origins = np.column_stack([middles, np.full(count, top)])
        down = np.tile([0.0, 0.0, -1.0], (count, 1))
        found = np.full((LAYERS, count), np.nan)
        filled = np.zeros(count, dtype=np.intp)
        depth = np.zeros(count, dtype=np.intp)
        ceiling = np.full(count, np.inf)
        going = np.arange(count)

        def stand(cells: Numbers, heights: Array) -> None:
            fits = (ceiling[cells] - heights >= room) & (filled[cells] < LAYERS)
            found[filled[cells[fits]], cells[fits]] = heights[fits]
            filled[cells[fits]] += 1

        for _ in range(MOST_HITS):
            hits = self._scene.cast(origins[going], down[going], normals=True)
            heights = origins[going, 2] - hits.distances
            met = (hits.geoms >= 0) & (heights > (self.floor or -np.inf) - GAP)
            if self.floor is not None:
                left = going[~met & (depth[going] <= 0)]
                stand(left, np.full(len(left), self.floor))
            assert hits.normals is not None
            going, heights, upward = going[met], heights[met], hits.normals[met, 2] > 0.0
            if not len(going):
                break
            entered = upward & (depth[going] <= 0)
            stand(going[entered], heights[entered])
            depth[going] = np.maximum(depth[going] + np.where(upward, 1, -1), 0)
            left_solid = ~upward & (depth[going] == 0)
            ceiling[going[left_solid]] = heights[left_solid]
            origins[going, 2] = heights - GAP
        return found

    def _links(self, heights: Array, middles: Array, cell: float, size: Size) -> Numbers:
        """For each side (east, north, west, south) and column the number of the one that one gets
        to, -1: none. Numbers count through all layers."""
        layers, rows, columns = heights.shape
        count = rows * columns
        links = np.full((4, layers * count), -1, dtype=np.intp)
        flat = heights.reshape(layers, count)
        at = np.arange(count).reshape(rows, columns)
        pairs = ((0, at[:, :-1].ravel(), at[:, 1:].ravel()), (1, at[:-1].ravel(), at[1:].ravel()))
        for side, here, there in pairs:
            for lower in range(layers):
                z = flat[lower, here]
                rises = np.abs(flat[:, there] - z)
                rises[np.isnan(rises)] = np.inf
                upper = np.argmin(rises, axis=0)
                fits = rises[upper, np.arange(len(here))] <= size.climb
                ours, theirs, to = here[fits], there[fits], upper[fits]
                ends = flat[to, theirs]
                clear = np.ones(len(ours), dtype=bool)
                for lift in (size.climb + 0.02, EYE, size.height):
                    starts = np.column_stack([middles[ours], flat[lower, ours] + lift])
                    goals = np.column_stack([middles[theirs], ends + lift])
                    # Both ways, as some surfaces have one side only.
                    clear &= self.clear(starts, goals)
                one, other = lower * count + ours[clear], to[clear] * count + theirs[clear]
                links[side, one] = other
                links[side + 2, other] = one
        return links

    def _walls(
        self,
        way: Array,
        heights: Array,
        links: Numbers,
        middles: Array,
        cell: float,
        size: Size,
    ) -> Array:
        """Places (n, 2) of walls that are seen from near where robots get."""
        near = np.isfinite(way)
        for _ in range(_steps(size, cell) + 1):
            near = near | _beside(near, links)
        chosen = np.flatnonzero(near)
        count = len(middles)
        feet = np.column_stack([middles[chosen % count], heights.reshape(-1)[chosen] + EYE])
        found = [np.zeros((0, 2))]
        for dx, dy in ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)):
            ways = np.tile([dx, dy, 0.0], (len(feet), 1))
            hits = self._scene.cast(feet, ways)
            met = hits.distances <= 1.5 * cell
            behind = hits.distances[met][:, None] + GAP
            found.append(feet[met, :2] + behind * ways[met, :2])
        return np.concatenate(found)

    @staticmethod
    def _marked(
        places: Array, west: float, south: float, cell: float, shape: tuple[int, int]
    ) -> Truths:
        marked = np.zeros(shape, dtype=bool)
        columns = ((places[:, 0] - west) / cell).astype(int)
        rows = ((places[:, 1] - south) / cell).astype(int)
        inside = (columns >= 0) & (columns < shape[1]) & (rows >= 0) & (rows < shape[0])
        marked[rows[inside], columns[inside]] = True
        return marked


def _steps(size: Size, cell: float) -> int:
    """Cells beside a wall that are too near to it: the first one is half a cell away from a thick
    wall, a whole one from the end of a thin one."""
    return round(size.half_width / cell + 0.25)


def _beside(chosen: Truths, links: Numbers) -> Truths:
    """What one gets to from what is chosen, over one side."""
    found = np.zeros_like(chosen)
    for side in links:
        to = side[chosen]
        found[to[to >= 0]] = True
    return found


def _eroded(standing: Truths, links: Numbers, steps: int) -> Truths:
    """Without what is within so many cells of where one cannot go on."""
    left = standing
    for step in range(steps):
        good = np.append(left, False)
        kept = left.copy()
        for side in links:
            kept &= good[side]
        if step % 2:  # corners, too, every other time: an octagon
            for side, across in ((0, 1), (1, 2), (2, 3), (3, 0)):
                kept &= good[np.append(links[across], -1)[links[side]]]
        left = kept
    return left


def _start(heights: Array, middles: Array, roomy: Truths, start: Vector) -> int | None:
    """The number of the nearest roomy place below a start; None: there is none."""
    x, y, z = start
    away = np.hypot(middles[:, 0] - x, middles[:, 1] - y)
    best, found = math.inf, None
    for layer, row in enumerate(heights):
        fits = roomy[layer * len(middles) : (layer + 1) * len(middles)] & (away <= NEAR_START)
        fits &= (row <= z + SUNK) & (row >= z - DROP)
        for cell in np.flatnonzero(fits).tolist():
            if away[cell] < best:
                best, found = float(away[cell]), layer * len(middles) + cell
    return found


def _waves(roomy: Truths, links: Numbers, starts: Sequence[int]) -> Array:
    """Cells to go from the nearest start; every other wave goes over corners, too (octagons)."""
    way = np.full(len(roomy), np.inf)
    way[list(starts)] = 0.0
    edge = np.unique(np.array(starts, dtype=np.intp))
    padded = np.append(links, np.full((4, 1), -1), axis=1)
    wave = 0
    while len(edge):
        wave += 1
        reached = [padded[side, edge] for side in range(4)]
        if wave % 2 == 0:
            for side, across in ((0, 1), (1, 2), (2, 3), (3, 0)):
                one, other = padded[across, reached[side]], padded[side, reached[across]]
                reached.append(np.where(one == other, one, -1))
        to = np.unique(np.concatenate(reached))
        to = to[(to >= 0)]
        edge = to[roomy[to] & np.isinf(way[to])]
        way[edge] = wave
    return way
