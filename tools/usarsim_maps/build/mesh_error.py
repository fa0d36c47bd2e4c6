"""How far what is felt lies from what is seen, from above and from the side.

Rays go straight down through all storeys of what is seen. Where they meet a surface that is not too
steep, and free above it, another ray asks for the height at which something is felt there. From
free places level rays ask how far it is to what is seen and to what is felt. So the compiled scene
is judged, thing by thing. While one mesh is built, `is_open` looks at it from all around for
openings that are seen and not felt.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_maps.build.soup import Rays
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array, Indices
from usarsim_server.simulation.rays.scenery import is_visible
from usarsim_server.simulation.rays.triangles import triangles_of_all

MEDIAN, MOST = 0.01, 0.02
"""m between felt and seen that are borne: in the median, and at 95 % of all places."""

LEVEL = 0.64
"""Least upward part of the normal of what may be driven on: 50 degrees."""

HEADROOM = 0.3
"""m of free height that a robot needs."""

STOREYS = 16
"""Surfaces above each other that are looked for."""

REACH = 1.0
"""m above and below a seen surface within which the felt one is looked for."""

PAST = 1e-3
"""m behind a surface where the look for the next one begins."""


RAYS = 60_000
"""Places on which a map is compared."""

LEAST, MOST_MODELS = 9, 900
"""Of them on each thing that is seen."""

ENDLESS = 1000.0
"""m: half of what stands for an endless plane; what is larger is a backdrop."""

TOLD = 12
"""Warnings at most; the worst."""

SIGHTS = 4_000
"""Places from which level rays go."""

BESIDE = 0.5
"""m around each thing in which they lie."""

EYES = (0.1, 0.45, 1.1)
"""m above what is met from above at which they start."""

ALONG = 0.8
"""Part of such a ray after which another one starts."""

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))
"""rad from the direction of one place to that of the next: they never repeat."""

FAR = 4.0
"""m along them within which the difference counts."""

STEP = 0.06
"""m between felt and seen from which on it counts."""

BEAM = 0.06
"""m above, below and beside a ray at which others must agree, so that neither edges count that are
grazed nor those of slabs, which are up to 10 cm thick."""

FEW, PART = 3, 0.005
"""Rays, and part of those that meet a thing, that may differ without a warning."""

YAWS = 6
"""Directions of half a turn from which a mesh is looked at, from both sides."""

SAMPLES = 200
"""Rays along each side of a mesh, at most."""


@dataclass(frozen=True, slots=True)
class SurfaceError:
    """Distances of felt from seen surface."""

    places: int  # how many were compared
    median: float  # m in the median and at 95 % of the places
    most: float
    lost: float  # part of the places where nothing is felt

    @classmethod
    def of(cls, errors: Array) -> SurfaceError:
        """Of signed distances (n,), m; infinite where nothing is felt."""
        if not len(errors):
            return cls(0, 0.0, 0.0, 0.0)
        size = np.sort(np.abs(errors))
        return cls(
            len(size),
            float(size[len(size) // 2]),
            float(size[int(0.95 * (len(size) - 1))]),
            float(np.isinf(size).mean()),
        )

    @property
    def is_small(self) -> bool:
        """Within `MEDIAN` and `MOST`."""
        return self.median <= MEDIAN and self.most <= MOST


def drivable_points(seen: Array, places: Array) -> tuple[Array, Array, NDArray[np.intp]]:
    """What may be driven on below or above some places (k, 2), x and y in m.

    Of the triangles (n, 3, 3) that look down only the first from above counts. Returns points
    (m, 3), the free height above each, and which triangle each lies on.
    """
    nothing = np.zeros((0, 3)), np.zeros(0), np.zeros(0, dtype=np.intp)
    if not len(seen) or not len(places):
        return nothing
    rays_down = Rays(seen)
    sides = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])
    rise = sides[:, 2] / np.maximum(np.linalg.norm(sides, axis=1), 1e-30)
    rays = np.arange(len(places))
    top = np.full(len(places), float(seen[:, :, 2].max()) + REACH)
    above = np.full(len(places), np.inf)
    points, rooms, owners = [], [], []
    for storey in range(STOREYS):
        start = np.column_stack([places[rays], top[rays]])
        ways, faces = rays_down.cast(start)
        hit = faces >= 0
        rays, heights, faces = rays[hit], (start[:, 2] - ways)[hit], faces[hit]
        if not len(rays):
            break
        room = above[rays] - heights
        good = (room > HEADROOM) & (rise[faces] > LEVEL)
        if not storey:
            good |= rise[faces] < -LEVEL
        points.append(np.column_stack([places[rays], heights])[good])
        rooms.append(room[good])
        owners.append(faces[good].astype(np.intp))
        above[rays] = heights
        top[rays] = heights - PAST
    if not points:
        return nothing
    return np.concatenate(points), np.concatenate(rooms), np.concatenate(owners)


def surface_error(points: Array, rooms: Array, felt: Array) -> Array:
    """m by which felt triangles (m, 3, 3) lie above points (n, 3) of what is seen.

    Infinite where they do not within `REACH`; `rooms` is the free height above each point.
    """
    if not len(points) or not len(felt):
        return np.full(len(points), np.inf)
    start = _above(points, rooms)
    ways, faces = Rays(felt).cast(start)
    errors: Array = start[:, 2] - ways - points[:, 2]
    errors[(faces < 0) | (errors < -REACH)] = np.inf
    return errors


def _above(points: Array, rooms: Array) -> Array:
    """Where rays that look for what is felt begin: within the free height above points (n, 3)."""
    start = points.copy()
    start[:, 2] += np.minimum(rooms - HEADROOM / 2.0, REACH)
    return start


def _is_buried(places: Array, seen: Array, felt: Array) -> NDArray[np.bool_]:
    """Which places (n, 3) are within something solid, as the ground below a block is.

    They are so for the eye and for the hand: the next seen triangle above faces up, and one of the
    felt triangles around is met from behind. `seen` (m, 3, 3) may be open, pieces of `felt` are
    closed.
    """
    above = Rays(seen).cast(places, (0.0, 0.0, 1.0))[1]
    buried = (above >= 0) & (_normals(seen)[above, 2] > 0.0)
    within = np.zeros(len(places), dtype=bool)
    looks, normals = Rays(felt), _normals(felt)
    # Several ways, for where two pieces touch either face may be met.
    for way in ((0.0, 0.0, 1.0), (0.0, 0.0, -1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0)):
        met = looks.cast(places, way)[1]
        within |= (met >= 0) & (normals[met] @ np.array(way) > 0.0)
    return np.asarray(buried & within)


def is_open(seen: Array, felt: Array, up: Array, width: float, depth: float) -> bool:
    """Whether felt triangles (m, 3, 3) leave all openings of seen ones (n, 3, 3) open.

    An opening is `width` m wide and high, and what is seen in it lies `depth` m behind what is
    felt, from one of the directions around and along `up` (3,).
    """
    corners = seen.reshape(-1, 3)
    middle = (corners.min(axis=0) + corners.max(axis=0)) / 2.0
    reach = float(np.linalg.norm(corners - middle, axis=1).max())
    looks, touches = Rays(seen), Rays(felt)
    normals = _normals(felt)
    side = np.cross(up, np.eye(3)[int(np.argmin(np.abs(up)))])
    side /= np.linalg.norm(side)
    ways = [up]
    for turn in np.arange(YAWS) * math.pi / YAWS:
        ways.append(math.cos(turn) * side + math.sin(turn) * np.cross(up, side))
    for way in ways:
        across = side if way is up else np.cross(up, way)
        frame = np.column_stack([across, np.cross(way, across)])
        flat = (corners - middle) @ frame
        low, high = flat.min(axis=0), flat.max(axis=0)
        step = max(width / 5.0, float((high - low).max()) / SAMPLES)
        counts = np.maximum((high - low) // step, 1).astype(int) + 1
        axes = [low[k] + (np.arange(counts[k]) + 0.37) * step for k in (0, 1)]
        grid = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2) @ frame.T + middle
        window = max(int(width / step), 2)
        for sign in (1.0, -1.0):
            start = grid - sign * (reach + 1.0) * way
            far = looks.cast(start, sign * way)[0].astype(float)
            near, faces = touches.cast(start, sign * way)
            near = np.where(faces >= 0, near, 0.0)
            ahead = np.where(faces >= 0, np.minimum(far, 4.0 * reach + 2.0) - near, 0.0)
            away = ahead * np.abs(normals[faces] @ way)
            closed = (away > depth).reshape(counts[1], counts[0])
            if min(closed.shape) >= window and _eroded(_eroded(closed, window).T, window).any():
                return False
    return True


def _eroded(mask: NDArray[np.bool_], window: int) -> NDArray[np.bool_]:
    """Where so many rows are all true, from each row on."""
    rows = len(mask) - window + 1
    return np.asarray(np.logical_and.reduce([mask[k : k + rows] for k in range(window)]))


@dataclass(frozen=True, slots=True)
class SideError:
    """What level rays from free places find."""

    rays: int  # that meet something seen or felt
    blocked: int  # of them: something is felt before what is seen
    passed: int  # something is seen before what is felt

    @property
    def is_small(self) -> bool:
        """Within `FEW` or `PART`."""
        return self.blocked + self.passed <= max(FEW, PART * self.rays)


@dataclass(frozen=True, slots=True)
class ModelError:
    """How far felt surfaces are from seen ones."""

    all: SurfaceError  # over all places
    things: Mapping[str, SurfaceError]  # by the name of the geom that is seen first of each thing
    side: SideError  # over all level rays
    sides: Mapping[str, SideError]  # by the names of things
    hollow: Collection[str]  # names of things that are seen, and of which nothing is felt


def model_error(model: mujoco.MjModel, without: Collection[str] = ()) -> ModelError:
    """Compare what is felt with what is seen wherever it may be driven on.

    What is `without` does not count: names of geoms, or of things.
    """
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    seen = [geom for geom in range(model.ngeom) if is_visible(model, geom)]
    solid = np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0).tolist()
    seen, solid = (
        [g for g in some if not {model.geom(g).name, _thing(model, g)} & set(without)]
        for some in (seen, solid)
    )
    triangles, geoms = _triangles(model, data, seen)
    felt, solids = _triangles(model, data, solid)
    labels, owner = np.unique([_thing(model, geom) for geom in seen], return_inverse=True)
    thing_of = np.full(model.ngeom, -1)
    thing_of[seen] = owner
    places = _places(triangles, thing_of[geoms], len(labels), RAYS, 0.0)
    points, rooms, faces = drivable_points(triangles, places)
    if len(points) and len(felt):
        free = ~_is_buried(_above(points, rooms), triangles, felt)
        points, rooms, faces = points[free], rooms[free], faces[free]
    errors = surface_error(points, rooms, felt)
    things = thing_of[geoms[faces]]
    order = np.argsort(things, kind="stable")
    cuts = np.searchsorted(things[order], np.arange(len(labels) + 1))
    found = {
        str(label): SurfaceError.of(errors[order[cuts[n] : cuts[n + 1]]])
        for n, label in enumerate(labels)
        if cuts[n + 1] > cuts[n]
    }
    places = _places(triangles, thing_of[geoms], len(labels), SIGHTS, BESIDE)
    eyes = _free_places(Rays(triangles), places, float(triangles[:, :, 2].max(initial=0.0)))
    side, sides = _from_the_side(
        eyes,
        (triangles, [_thing(model, geom) for geom in geoms.tolist()]),
        (felt, [_thing(model, geom) for geom in solids.tolist()]),
    )
    touched = {_thing(model, geom) for geom in solid}
    hollow = [str(label) for label in labels if label not in touched]
    return ModelError(SurfaceError.of(errors), found, side, sides, hollow)


def _free_places(seen: Rays, places: Array, top: float) -> Array:
    """Points (n, 3) that are surely not within anything seen, whatever way its triangles face.

    They lie above what is met first from above below places (k, 2), and on level rays from there
    before what these meet, so that some are below roofs.
    """
    start = np.column_stack([places, np.full(len(places), top + REACH)])
    ways, faces = seen.cast(start)
    start[:, 2] -= ways
    high = np.array([[0.0, 0.0, eye] for eye in EYES])
    free = (start[faces >= 0] + high[:, None]).reshape(-1, 3)
    found = [free]
    for _ in range(2):
        level = _level_ways(len(free), 1)
        far = np.minimum(seen.cast(free, level)[0].astype(float), FAR)
        free = free + level * (ALONG * far)[:, None]
        found.append(free)
    return np.concatenate(found)


def _normals(triangles: Array) -> Array:
    """Unit normals of triangles (n, 3, 3)."""
    found = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1), 1e-30)[:, None])


def _far_from(rays: Rays, points: Array, normals: Array) -> NDArray[np.bool_]:
    """Whether points (n, 3) are more than `STEP` from all triangles, along lines (n, 3)."""
    ways = [rays.cast(points - way * PAST, way)[0] for way in (normals, -normals)]
    return np.asarray(np.minimum(*ways) > STEP + PAST)


def _level_ways(count: int, each: int) -> Array:
    """Directions (count * each, 3): for each place some at equal angles, for the next others."""
    turns = (np.arange(count) * GOLDEN)[:, None] + np.arange(each) * (math.tau / each)
    return np.stack([np.cos(turns), np.sin(turns), np.zeros_like(turns)], axis=-1).reshape(-1, 3)


def _from_the_side(
    eyes: Array, seen: tuple[Array, list[str]], felt: tuple[Array, list[str]]
) -> tuple[SideError, dict[str, SideError]]:
    """Compare triangles that are seen and felt, which belong to things, from places (n, 3)."""
    if not len(eyes) or not len(seen[0]) or not len(felt[0]):
        return SideError(0, 0, 0), {}
    ways = _level_ways(len(eyes), 2)
    start = np.repeat(eyes, 2, axis=0)
    looks, touches = Rays(seen[0]), Rays(felt[0])
    sights, walls = _normals(seen[0]), _normals(felt[0])

    def cast(start: Array, ways: Array) -> tuple[Array, Array, Indices, Indices]:
        far, one = looks.cast(start, ways)
        near, other = touches.cast(start, ways)
        within = (other >= 0) & (np.einsum("ij,ij->i", ways, walls[other]) > 0.0)
        near = np.where(within, 0.0, near)  # the ray starts in a solid that it leaves
        ends = [np.minimum(way, FAR).astype(float) for way in (far, near)]
        return ends[0], ends[1], one, other

    far, near, one, other = cast(start, ways)
    odd = np.flatnonzero(np.abs(far - near) > STEP)
    # A ray that grazes a face goes a long way though the other face is near.
    early = near[odd] < far[odd]
    ends = start[odd] + ways[odd] * np.minimum(near, far)[odd, None]
    square = np.where(early[:, None], walls[other[odd]], sights[one[odd]])
    apart = np.where(early, _far_from(looks, ends, square), _far_from(touches, ends, square))
    odd = odd[apart]
    beside = np.cross(ways[odd], [0.0, 0.0, 1.0])
    low_far, high_far, low_near, high_near = far[odd], far[odd], near[odd], near[odd]
    for across, above in ((1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)):
        moved = start[odd] + BEAM * (across * beside + above * np.array([0.0, 0.0, 1.0]))
        look, touch, _, _ = cast(moved, ways[odd])
        low_far, high_far = np.minimum(low_far, look), np.maximum(high_far, look)
        low_near, high_near = np.minimum(low_near, touch), np.maximum(high_near, touch)
    blocked = odd[high_near < low_far - STEP]
    passed = odd[high_far < low_near - STEP]
    names = sorted({*seen[1], *felt[1]})
    number = {name: n for n, name in enumerate(names)}
    seen_of = np.array([number[name] for name in seen[1]])
    felt_of = np.array([number[name] for name in felt[1]])
    looked, touched = (far < FAR) & (one >= 0), (near < FAR) & (other >= 0)
    count = len(names)
    rays = np.bincount(seen_of[one[looked]], minlength=count)
    alone = touched & ~(looked & (seen_of[one] == felt_of[other]))
    rays += np.bincount(felt_of[other[alone]], minlength=count)
    before = np.bincount(felt_of[other[blocked]], minlength=count)
    behind = np.bincount(seen_of[one[passed]], minlength=count)
    sides = {
        name: SideError(int(rays[n]), int(before[n]), int(behind[n]))
        for n, name in enumerate(names)
        if rays[n]
    }
    return SideError(int((looked | touched).sum()), len(blocked), len(passed)), sides


def note_error(model: mujoco.MjModel, findings: Findings, without: Collection[str] = ()) -> None:
    """Put the difference into the report, and warn of things where it is large.

    What is `without` does not count: names of geoms, or of things.
    """
    error = model_error(model, without)
    _note_sides(error, findings)
    if not error.all.places:
        return
    findings.fact(
        "felt - seen",
        f"{_length(error.all.median, 1)} in the median, {_length(error.all.most, 1)} at 95 % of "
        f"{error.all.places} places that may be driven on",
    )
    large = [(name, one) for name, one in error.things.items() if not one.is_small]
    large.sort(key=lambda item: -item[1].places)
    for name, one in large[:TOLD]:
        if name in error.hollow:
            findings.warn(name, "it is seen, and nothing of it is felt")
            continue
        lost = f"; nothing is felt at {100.0 * one.lost:.0f} %" if one.lost else ""
        findings.warn(
            name,
            f"it is felt {_length(one.median)} off what is seen in the median, "
            f"{_length(one.most)} at 95 %{lost}",
        )


def _length(value: float, digits: int = 0) -> str:
    """A distance for people, in mm with so many digits; what was not found is beyond `REACH`."""
    return f"more than {REACH:g} m" if np.isinf(value) else f"{1000.0 * value:.{digits}f} mm"


def _note_sides(error: ModelError, findings: Findings) -> None:
    """Put what level rays found into the report, and warn of things where it is much."""
    side = error.side
    if side.rays:
        findings.fact(
            "felt - seen, level",
            f"something is felt before what is seen on {100.0 * side.blocked / side.rays:.1f} %, "
            f"and seen before what is felt on {100.0 * side.passed / side.rays:.1f} %, "
            f"of {side.rays} level rays",
        )
    large = [
        (name, one)
        for name, one in error.sides.items()
        if not one.is_small and not (name in error.hollow and name in error.things)
    ]
    large.sort(key=lambda item: -(item[1].blocked + item[1].passed))
    for name, one in large[:TOLD]:
        told = []
        if one.blocked:
            told.append(f"is felt before what is seen on {100.0 * one.blocked / one.rays:.0f} %")
        if one.passed:
            told.append(f"is seen and not felt on {100.0 * one.passed / one.rays:.0f} %")
        findings.warn(name, f"from the side it {' and '.join(told)} of {one.rays} level rays")


def _thing(model: mujoco.MjModel, geom: int) -> str:
    """What a geom is a part of: its body, or what its own name says."""
    body = int(model.geom_bodyid[geom])
    if body:
        return str(model.body(body).name)
    name = str(model.geom(geom).name).rpartition(":")[2]
    return name.partition(".part")[0].partition(".solid")[0]


def _triangles(
    model: mujoco.MjModel, data: mujoco.MjData, geoms: list[int]
) -> tuple[Array, NDArray[np.intp]]:
    triangles, owners = triangles_of_all(model, geoms, data.geom_xpos, data.geom_xmat)
    quad = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * ENDLESS
    planes = [geom for geom in geoms if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE]
    for geom in planes:
        corners = quad @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
        triangles = np.concatenate([triangles, corners[[[0, 1, 2], [0, 2, 3]]]])
        owners = np.concatenate([owners, [geom, geom]])
    return triangles, owners


def _places(
    triangles: Array, things: NDArray[np.intp], count: int, most: int, beside: float
) -> Array:
    """(k, 2) places of rays: a grid over each thing, without those that nothing is as large as.

    `beside` is how many m around each thing belong to it.
    """
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, things, triangles[:, :, :2].min(axis=1))
    np.maximum.at(high, things, triangles[:, :, :2].max(axis=1))
    near = np.flatnonzero((high - low).max(axis=1) < ENDLESS)
    low, high = low - beside, high + beside
    side = int(np.sqrt(np.clip(most / max(len(near), 1), LEAST, MOST_MODELS)))
    # Between the lines of a grid that builders use.
    x, y = np.meshgrid((np.arange(side) + 0.37) / side, (np.arange(side) + 0.53) / side)
    grid = np.column_stack([x.ravel(), y.ravel()])
    return np.asarray((low[near, None] + grid * (high - low)[near, None]).reshape(-1, 2))
