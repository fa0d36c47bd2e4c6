"""Meshes of a stage: polygons, subsets, texture coordinates."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import UsdGeom, UsdShade

from usarsim_maps.build.triangulate import triangulate
from usarsim_maps.findings import Findings
from usarsim_maps.scene import Mesh
from usarsim_maps.usd.openusd.materials import Finish, Finishes
from usarsim_maps.usd.openusd.values import NOW, array, numbers

__all__ = ["MeshReader"]

Array = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(slots=True)
class MeshReader:
    """Reads meshes; copies share one, whether they are instances in the stage or merely equal.

    Attributes:
        finishes: of the stage. findings: told of damage.
        triangles: read so far, copies not counted.
    """

    finishes: Finishes
    findings: Findings
    triangles: int = 0
    _by_prim: dict[str, Mesh | None] = field(default_factory=dict)
    _by_content: dict[bytes, Mesh] = field(default_factory=dict)

    def read(self, prim: Any) -> Mesh | None:
        """A mesh; None if it has no polygons or senseless ones."""
        original = prim.GetPrimInPrototype() if prim.IsInstanceProxy() else prim
        key = str(original.GetPath())
        if key not in self._by_prim:
            self._by_prim[key] = self._shared(prim)
        return self._by_prim[key]

    def _shared(self, prim: Any) -> Mesh | None:
        mesh = self._read(prim)
        if mesh is None:
            return None
        digest = hashlib.sha256(repr((mesh.name, mesh.materials)).encode())
        for part in (mesh.vertices, mesh.triangles, mesh.uvs, mesh.slots):
            digest.update(b"-" if part is None else part.tobytes())
        known = self._by_content.setdefault(digest.digest(), mesh)
        if known is mesh:
            self.triangles += len(mesh.triangles)
        return known

    def _read(self, prim: Any) -> Mesh | None:
        shape = UsdGeom.Mesh(prim)
        name = prim.GetName()
        points = array(shape.GetPointsAttr(), 3)
        sizes = array(shape.GetFaceVertexCountsAttr())
        indices = array(shape.GetFaceVertexIndicesAttr())
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
        places, owners = order[triangles], faces[owners]
        slots, finishes = self._slots(prim, len(counts))
        return Mesh(
            name=name,
            vertices=points,
            triangles=corners[places].astype(np.int32),
            uvs=self._uvs(prim, finishes, slots[owners], places, corners, owners),
            slots=slots[owners].astype(np.int32),
            materials=tuple(finish.material.name for finish in finishes),
        )

    def _order(self, shape: Any, counts: Integers) -> tuple[Integers, Integers]:
        """Numbers of the faces to show, and places of their corners in the mesh's list.

        Holes are left out; left-handed meshes are turned round (item 36).
        """
        visible = np.ones(len(counts), dtype=bool)
        holes = array(shape.GetHoleIndicesAttr())
        if holes is not None:
            inside = holes[(holes >= 0) & (holes < len(counts))]
            visible[inside.astype(np.int64)] = False
        faces = np.flatnonzero(visible)
        ends = np.cumsum(counts)
        owner = np.repeat(np.arange(len(counts)), counts)
        places = np.flatnonzero(visible[owner])
        if shape.GetOrientationAttr().Get(NOW) == UsdGeom.Tokens.leftHanded:
            # Reflected within each face: the first place becomes the last one.
            places = (ends - counts)[owner[places]] + ends[owner[places]] - 1 - places
        return faces, places

    def _slots(self, prim: Any, count: int) -> tuple[Integers, list[Finish]]:
        """Slot of each face, and the finishes by slot: the mesh's own, then those of subsets."""
        finishes = [self.finishes.of(prim)]
        slots = np.zeros(count, dtype=np.int64)
        for subset in UsdShade.MaterialBindingAPI(prim).GetMaterialBindSubsets():
            chosen = array(subset.GetIndicesAttr())
            if chosen is None:
                continue
            inside = chosen[(chosen >= 0) & (chosen < count)].astype(np.int64)
            slots[inside] = len(finishes)
            finishes.append(self.finishes.of(subset.GetPrim()))
        return slots, finishes

    def _uvs(
        self,
        prim: Any,
        finishes: list[Finish],
        slots: Integers,
        places: Integers,
        corners: Integers,
        owners: Integers,
    ) -> Array | None:
        """Texture coordinates (m, 3, 2), each slot by the primvar that its picture lies on."""
        answer = np.zeros((*places.shape, 2))
        known = False
        for slot, finish in enumerate(finishes):
            material = finish.material
            chosen = slots == slot
            if not chosen.any() or (material.texture is None and material.image is None):
                continue
            found = _primvar(prim, finish.coordinates, places[chosen], corners, owners[chosen])
            if found is None:
                self.findings.warn(prim.GetName(), "texture coordinates are missing")
                continue
            answer[chosen] = found @ finish.mapping[:, :2].T + finish.mapping[:, 2]
            known = True
        return answer if known else None


def _primvar(
    prim: Any, name: str, places: Integers, corners: Integers, owners: Integers
) -> Array | None:
    """Values (m, 3, 2) of texture coordinates at triangles, however they are interpolated."""
    source = UsdGeom.PrimvarsAPI(prim)
    for word in dict.fromkeys((name, "st", "UVMap", "st0", "map1")):
        primvar = source.FindPrimvarWithInheritance(word)
        if not primvar or not primvar.HasAuthoredValue():
            continue
        values = numbers(primvar.ComputeFlattened(NOW), 2)
        if values is None:
            continue
        match primvar.GetInterpolation():
            case "faceVarying":
                index = places
            case "vertex" | "varying":
                index = corners[places]
            case "uniform":
                index = np.repeat(owners[:, None], 3, axis=1)
            case _:
                index = np.zeros_like(places)
        if index.max(initial=0) < len(values):
            return values[index]
    return None
