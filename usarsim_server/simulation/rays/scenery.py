"""Everything that never moves, as rays see it: true triangles, and endless planes by formula."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from usarsim_server.simulation.frames import Array
from usarsim_server.simulation.model import SHELF_NAME, CompiledWorld
from usarsim_server.simulation.objects import Names, geom_names
from usarsim_server.simulation.rays.query import SceneryHit
from usarsim_server.simulation.rays.records import FixedRecord
from usarsim_server.simulation.rays.triangles import Surfaces, TriangleScene, products, triangles

SEEN_GROUPS = 3
"""Geoms of groups 0 to 2 are seen, as by MuJoCo's renderers; the others only collide."""
PAINT = "paint:"
"""How the names of scenery begin that only cameras see."""
WORDS = frozenset({"glass", "trans", "transparent", "translucent"})
ENDS = ("glass", "trans")
OPAQUE = frozenset({"fiberglass", "fibreglass", "hourglass"})

_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")


@dataclass(frozen=True, slots=True, eq=False)
class _Plane:
    geom: int
    normal: Array
    offset: float


class StaticGeometry:
    """All geometry that never moves; built once per world, shared by all threads.

    Attributes:
        names: of all geoms, see `objects.geom_names`.
    """

    def __init__(self, world: CompiledWorld) -> None:
        model = world.model
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        solid: list[tuple[int, Array]] = []
        glass: list[tuple[int, Array]] = []
        self.names: Names = geom_names(model)
        self._planes: list[_Plane] = []
        for geom in _static_geoms(model):
            pos, mat = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3)
            if model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE:
                self._planes.append(_Plane(geom, mat[:, 2].copy(), float(mat[:, 2] @ pos)))
            else:
                part = (geom, triangles(model, geom, pos, mat))
                (glass if is_glass(model, geom) else solid).append(part)
        self._full = TriangleScene([*solid, *glass])
        self._clear = TriangleScene(solid) if glass else self._full

    @cached_property
    def record(self) -> FixedRecord:
        """The same for compiled code."""
        return FixedRecord(
            full=self._full.record,
            clear=self._clear.record,
            count=len(self._planes),
            planes=np.array([[*plane.normal, plane.offset] for plane in self._planes]),
            geoms=np.array([plane.geom for plane in self._planes], dtype=np.intp),
        )

    def cast(
        self,
        origins: Array,
        directions: Array,
        *,
        normals: bool = False,
        through_glass: NDArray[np.bool_] | None = None,
        reach: Array | None = None,
    ) -> Surfaces:
        """Cast rays from (n, 3) along unit vectors (n, 3), some of them (n,) through glass.

        What is further away than `reach` (n,), m, may be left out.
        """
        surfaces = self._full.cast(origins, directions, normals=normals, reach=reach)
        if through_glass is not None and self._clear is not self._full:
            rays = np.flatnonzero(through_glass)
            within = None if reach is None else reach[rays]
            further = self._clear.cast(
                origins[rays], directions[rays], normals=normals, reach=within
            )
            surfaces.put(rays, further)
        for plane in self._planes:
            _meet(plane, origins, directions, surfaces)
        return surfaces

    def first_hits(
        self, origins: Array, directions: Array, reaches: Array
    ) -> list[SceneryHit | None]:
        """What each ray from (n, 3) m along a unit vector (n, 3) meets first within its reach (n,),
        m; None: nothing."""
        found = self.cast(origins, directions, normals=True)
        met = (found.geoms >= 0) & (found.distances <= reaches)
        if not met.any():
            return [None] * len(origins)
        assert found.normals is not None
        entering = products(found.normals, directions) <= 0.0
        columns = (found.distances, found.geoms, entering, met)
        return [
            SceneryHit(distance, geom, self.names[geom], enters) if hit else None
            for distance, geom, enters, hit in zip(*(c.tolist() for c in columns), strict=True)
        ]


def is_visible(model: mujoco.MjModel, geom: int) -> bool:
    """Whether rays and cameras see a geom at all."""
    if model.geom_group[geom] >= SEEN_GROUPS:
        return False
    material = model.geom_matid[geom]
    color = model.geom_rgba[geom] if material < 0 else model.mat_rgba[material]
    return bool(color[3] > 0.0)


def words_of(name: str) -> list[str]:
    """The words of a name in lower case: parted by capitals, digits and everything else."""
    return [word.lower() for word in _WORD.findall(name)]


def is_glass(model: mujoco.MjModel, geom: int) -> bool:
    """Whether infrared light goes through a geom, by its name or by that of its material.

    The original let infrared sensors look through materials with "Trans" in their names (robots
    reference 2.2). Here whole words of a name count, so `WindowTrans_01` and `glass_door` are
    glass, `transport_box` and `hourglass` are not; a material may also end with one in one word, as
    imported maps have `framelessglass`.
    """
    if not WORDS.isdisjoint(words_of(model.geom(geom).name)):
        return True
    material = int(model.geom_matid[geom])
    if material < 0:
        return False
    return is_glass_name(model.mat(material).name)


def is_glass_name(material: str) -> bool:
    """Whether infrared light goes through a material of this name, see `is_glass`."""
    words = words_of(material)
    return any(word in WORDS or (word.endswith(ENDS) and word not in OPAQUE) for word in words)


def _meet(plane: _Plane, origins: Array, directions: Array, surfaces: Surfaces) -> None:
    """Let rays end at a plane where it is nearer than what they have met; seen from above only."""
    slope = products(directions, plane.normal)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (plane.offset - products(origins, plane.normal)) / slope
    nearer = (way >= 0.0) & (way < surfaces.distances) & (slope < 0.0)
    surfaces.distances[nearer] = way[nearer]
    surfaces.geoms[nearer] = plane.geom
    if surfaces.normals is not None:
        surfaces.normals[nearer] = plane.normal


def _static_geoms(model: mujoco.MjModel) -> list[int]:
    return [
        geom
        for geom in range(model.ngeom)
        if model.body_weldid[model.geom_bodyid[geom]] == 0
        and model.geom(geom).name != SHELF_NAME
        and not model.geom(geom).name.startswith(PAINT)
        and is_visible(model, geom)
    ]
