"""Meshes of a stage: polygons, subsets, colours, texture coordinates."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdShade

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.polygons import triangulate
from usarsim_maps.scene import Array, Integers, Mesh
from usarsim_maps.usd.openusd.figures import Figures
from usarsim_maps.usd.openusd.materials import Finish, Finishes
from usarsim_maps.usd.openusd.primvars import (
    DISPLAY,
    NO_DISPLAY,
    Corners,
    Display,
    color_values,
    coordinates_at,
)
from usarsim_maps.usd.openusd.values import StageValues, in_prototype


@dataclass(slots=True)
class MeshReader:
    """Reads meshes; copies share one, whether they are instances in the stage or merely equal."""

    finishes: Finishes  # of the stage
    findings: Findings  # told of damage
    values: StageValues
    figures: Figures  # points of what skeletons and blend shapes bend
    triangles: int = 0  # read so far, copies not counted
    _by_prim: dict[object, Mesh | None] = field(default_factory=dict)
    _by_content: dict[bytes, Mesh] = field(default_factory=dict)

    def read(self, prim: Any, display: Display = NO_DISPLAY) -> Mesh | None:
        """A mesh, in these colours where it has none; None without sound polygons."""
        key = self._key(prim), display
        if key not in self._by_prim:
            self._by_prim[key] = self._shared(prim, display)
        return self._by_prim[key]

    def _key(self, prim: Any) -> object:
        """Equal for copies of an instance that look alike.

        Material and display colour may come from above the instance, then copies differ.
        """
        original = in_prototype(prim)
        if original == prim:
            return prim.GetPath()
        inherited = tuple(
            None if found is None else tuple(found[0].tolist())
            for found in (color_values(prim, name, self.values) for name in DISPLAY)
        )
        return original.GetPath(), self.finishes.of(prim), inherited

    def _shared(self, prim: Any, display: Display) -> Mesh | None:
        mesh = self._read(prim, display)
        if mesh is None:
            return None
        digest = hashlib.sha256(repr((mesh.name, mesh.materials)).encode())
        for part in (mesh.vertices, mesh.triangles, mesh.uvs, mesh.slots):
            digest.update(b"-" if part is None else part.tobytes())
        known = self._by_content.setdefault(digest.digest(), mesh)
        if known is mesh:
            self.triangles += len(mesh.triangles)
        return known

    def _read(self, prim: Any, display: Display) -> Mesh | None:
        shape = UsdGeom.Mesh(prim)
        name = prim.GetName()
        points = self.values.array(shape.GetPointsAttr(), 3)
        sizes = self.values.array(shape.GetFaceVertexCountsAttr())
        indices = self.values.array(shape.GetFaceVertexIndicesAttr())
        if points is None or sizes is None or indices is None or not len(sizes):
            self.findings.warn(name, "a mesh without polygons was left out")
            return None
        counts, corners = sizes.astype(np.int64), indices.astype(np.int64)
        problem = ""
        if counts.min() < 0 or counts.sum() != len(corners):
            problem = f"{len(corners)} corners for {int(counts.sum())}"
        elif len(corners) and not 0 <= corners.min() <= corners.max() < len(points):
            problem = f"corner {corners.max()} of {len(points)} points"
        if problem:
            self.findings.warn(name, f"a damaged mesh was left out ({problem})")
            return None
        faces, order = self._order(shape, counts)
        triangles, owners = triangulate(points[corners[order]], counts[faces])
        if not len(triangles):
            return None
        places = order[triangles]
        at = Corners(places, corners[places], faces[owners])
        slots, finishes = self._slots(prim, len(counts))
        chosen = slots[at.faces]
        painted, names = self._painted(prim, at, chosen, finishes, display)
        self._tell(shape)
        return Mesh(
            name=name,
            vertices=self.figures.bent(prim, points),
            triangles=at.points.astype(np.int32),
            uvs=self._uvs(prim, at, chosen, finishes),
            slots=painted.astype(np.int32),
            materials=names,
        )

    def _tell(self, shape: Any) -> None:
        """Tell of what is in a mesh and is not shown."""
        scheme = shape.GetSubdivisionSchemeAttr()
        if scheme.HasAuthoredValue() and self.values.value(scheme) not in (None, "none"):
            self.findings.skip("subdivision", shape.GetPrim().GetName())

    def _order(self, shape: Any, counts: Integers) -> tuple[Integers, Integers]:
        """Numbers of the faces to show, and places of their corners in the mesh's list.

        Holes are left out; left-handed meshes are turned round (worlds 36).
        """
        visible = np.ones(len(counts), dtype=bool)
        holes = self.values.array(shape.GetHoleIndicesAttr())
        if holes is not None:
            inside = holes[(holes >= 0) & (holes < len(counts))]
            visible[inside.astype(np.int64)] = False
        faces = np.flatnonzero(visible)
        ends = np.cumsum(counts)
        owner = np.repeat(np.arange(len(counts)), counts)
        places = np.flatnonzero(visible[owner])
        if self.values.value(shape.GetOrientationAttr()) == UsdGeom.Tokens.leftHanded:
            # Reflected within each face: the first place becomes the last one.
            places = (ends - counts)[owner[places]] + ends[owner[places]] - 1 - places
        return faces, places

    def _slots(self, prim: Any, count: int) -> tuple[Integers, list[Finish]]:
        """Slot of each face, and the finishes by slot: the mesh's own, then those of subsets."""
        finishes = [self.finishes.of(prim)]
        slots = np.zeros(count, dtype=np.int64)
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            chosen = self.values.array(subset.GetIndicesAttr())
            if chosen is None:
                continue
            inside = chosen[(chosen >= 0) & (chosen < count)].astype(np.int64)
            slots[inside] = len(finishes)
            finishes.append(self.finishes.of(subset.GetPrim()))
        return slots, finishes

    def _painted(
        self,
        prim: Any,
        at: Corners,
        slots: Integers,
        finishes: list[Finish],
        display: Display,
    ) -> tuple[Integers, tuple[str, ...]]:
        """Slots of triangles (t,) by colour, and the names of materials by slot."""
        painted = np.zeros(len(slots), dtype=np.int64)
        names: dict[str, int] = {}
        for slot, finish in enumerate(finishes):
            chosen = slots == slot
            if chosen.any():
                made, numbers = self.finishes.on_triangles(prim, finish, at.of(chosen), display)
                places = [names.setdefault(material.name, len(names)) for material in made]
                painted[chosen] = np.array(places)[numbers]
        return painted, tuple(names)

    def _uvs(self, prim: Any, at: Corners, slots: Integers, finishes: list[Finish]) -> Array | None:
        """Texture coordinates (t, 3, 2), each slot by the primvar that its picture lies on."""
        answer = np.zeros((*at.places.shape, 2))
        known = False
        for slot, finish in enumerate(finishes):
            material = finish.material
            chosen = slots == slot
            pictures = material.texture, material.image, material.opacity
            if not chosen.any() or pictures == (None, None, None):
                continue
            found = coordinates_at(prim, finish.coordinates, at.of(chosen), self.values)
            if found is None:
                self.findings.warn(prim.GetName(), "texture coordinates are missing")
                continue
            with np.errstate(invalid="ignore"):
                answer[chosen] = found @ finish.mapping[:, :2].T + finish.mapping[:, 2]
            known = True
        return answer if known else None
