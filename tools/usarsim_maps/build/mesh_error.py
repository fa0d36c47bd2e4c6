"""How far what is felt lies from what is seen, on everything that may be driven on.

Rays go straight down through all storeys of what is seen. Where they meet a surface that is not too
steep, and free above it, another ray asks for the height at which something is felt there. So one
mesh is judged while it is built, and in the end the compiled scene, thing by thing.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_maps.build.soup import Rays
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Array
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
    start = points.copy()
    start[:, 2] += np.minimum(rooms - HEADROOM / 2.0, REACH)
    ways, faces = Rays(felt).cast(start)
    errors: Array = start[:, 2] - ways - points[:, 2]
    errors[(faces < 0) | (errors < -REACH)] = np.inf
    return errors


@dataclass(frozen=True, slots=True)
class ModelError:
    """How far felt surfaces are from seen ones."""

    all: SurfaceError  # over all places
    things: Mapping[str, SurfaceError]  # by the name of the geom that is seen first of each thing


def model_error(model: mujoco.MjModel, without: Collection[str] = ()) -> ModelError:
    """Compare what is felt with what is seen wherever it may be driven on, some geoms left out."""
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    seen = [geom for geom in range(model.ngeom) if is_visible(model, geom)]
    solid = np.flatnonzero((model.geom_contype | model.geom_conaffinity) != 0).tolist()
    for geom in (model.geom(name).id for name in without):
        seen, solid = (([one for one in some if one != geom]) for some in (seen, solid))
    triangles, geoms = _triangles(model, data, seen)
    felt, _ = _triangles(model, data, solid)
    labels, owner = np.unique([_thing(model, geom) for geom in seen], return_inverse=True)
    thing_of = np.full(model.ngeom, -1)
    thing_of[seen] = owner
    places = _places(triangles, thing_of[geoms], len(labels))
    points, rooms, faces = drivable_points(triangles, places)
    errors = surface_error(points, rooms, felt)
    things = thing_of[geoms[faces]]
    order = np.argsort(things, kind="stable")
    cuts = np.searchsorted(things[order], np.arange(len(labels) + 1))
    found = {
        str(label): SurfaceError.of(errors[order[cuts[n] : cuts[n + 1]]])
        for n, label in enumerate(labels)
        if cuts[n + 1] > cuts[n]
    }
    return ModelError(SurfaceError.of(errors), found)


def note_error(model: mujoco.MjModel, findings: Findings, without: Collection[str] = ()) -> None:
    """Put the difference into the report, and warn of things where it is large."""
    error = model_error(model, without)
    if not error.all.places:
        return
    findings.fact(
        "felt - seen",
        f"{1000.0 * error.all.median:.1f} mm in the median, {1000.0 * error.all.most:.1f} mm at "
        f"95 % of {error.all.places} places that may be driven on",
    )
    large = [(name, one) for name, one in error.things.items() if not one.is_small]
    large.sort(key=lambda item: -item[1].places)
    for name, one in large[:TOLD]:
        lost = f"; nothing is felt at {100.0 * one.lost:.0f} %" if one.lost else ""
        most = "more than 1 m" if np.isinf(one.most) else f"{1000.0 * one.most:.0f} mm"
        middle = "more than 1 m" if np.isinf(one.median) else f"{1000.0 * one.median:.0f} mm"
        findings.warn(
            name, f"is felt {middle} off what is seen in the median, {most} at 95 %{lost}"
        )


def _thing(model: mujoco.MjModel, geom: int) -> str:
    """What a geom is a part of: its body, or what its own name says."""
    body = int(model.geom_bodyid[geom])
    if body:
        return str(model.body(body).name)
    return str(model.geom(geom).name).partition(".part")[0]


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


def _places(triangles: Array, things: NDArray[np.intp], count: int) -> Array:
    """(k, 2) places of rays: a grid over each thing, without those that nothing is as large as."""
    low, high = np.full((count, 2), np.inf), np.full((count, 2), -np.inf)
    np.minimum.at(low, things, triangles[:, :, :2].min(axis=1))
    np.maximum.at(high, things, triangles[:, :, :2].max(axis=1))
    near = np.flatnonzero((high - low).max(axis=1) < ENDLESS)
    side = int(np.sqrt(np.clip(RAYS / max(len(near), 1), LEAST, MOST_MODELS)))
    # Between the lines of a grid that builders use.
    x, y = np.meshgrid((np.arange(side) + 0.37) / side, (np.arange(side) + 0.53) / side)
    grid = np.column_stack([x.ravel(), y.ravel()])
    return np.asarray((low[near, None] + grid * (high - low)[near, None]).reshape(-1, 2))
