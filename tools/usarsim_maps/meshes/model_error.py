"""The compiled scene compared with itself: what is felt against what is seen, thing by thing."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.surface_error import SurfaceError, drivable_points, surface_error
from usarsim_server.simulation.rays.scenery import is_visible
from usarsim_server.simulation.rays.tessellation import triangles_of_all

__all__ = ["ModelError", "model_error", "note_error"]

Array = NDArray[np.float64]

RAYS = 60_000
"""Places on which a map is compared."""

LEAST, MOST = 9, 900
"""Of them on each thing that is seen."""

ENDLESS = 1000.0
"""m: half of what stands for an endless plane; what is larger is a backdrop."""

TOLD = 12
"""Warnings at most; the worst."""


@dataclass(frozen=True, slots=True)
class ModelError:
    """How far felt surfaces are from seen ones.

    Attributes:
        all: over all places. things: by the name of the geom that is seen first of each thing.
    """

    all: SurfaceError
    things: Mapping[str, SurfaceError]


def model_error(model: mujoco.MjModel, without: Collection[str] = ()) -> ModelError:
    """Compare what is felt with what is seen wherever it may be driven on.

    Args:
        model: compiled.
        without: names of geoms that do not count.
    """
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
    side = int(np.sqrt(np.clip(RAYS / max(len(near), 1), LEAST, MOST)))
    # Between the lines of a grid that builders use.
    x, y = np.meshgrid((np.arange(side) + 0.37) / side, (np.arange(side) + 0.53) / side)
    grid = np.column_stack([x.ravel(), y.ravel()])
    found: Array = (low[near, None] + grid * (high - low)[near, None]).reshape(-1, 2)
    return found
