"""Meshes of a stage: polygons, subsets, texture coordinates.

Cubes, spheres, cylinders and the like as shapes of the scene.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from pxr import UsdGeom, UsdShade

from usarsim_maps.findings import Findings
from usarsim_maps.meshes.polygons import half_circle, lathe, triangulate
from usarsim_maps.scene import Array, Box, Capsule, Cylinder, Integers, Mesh, Shape, Sphere
from usarsim_maps.usd.openusd.materials import Finish, Finishes
from usarsim_maps.usd.openusd.values import NOW, array, number, numbers

SHAPES = {"Cube", "Sphere", "Cylinder", "Capsule", "Cone", "Plane"}
"""Types of prims that are understood beside meshes."""

AROUND = 24
"""Corners around what becomes a mesh because it is scaled unevenly."""

SAME = 1e-4
"""Relative difference of scales that count as equal."""


@dataclass(slots=True)
class MeshReader:
    """Reads meshes; copies share one, whether they are instances in the stage or merely equal."""

    finishes: Finishes  # of the stage
    findings: Findings  # told of damage
    triangles: int = 0  # read so far, copies not counted
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


def shape_of(prim: Any, matrix: Array) -> tuple[Shape, Array] | None:
    """A shape of one of the types `SHAPES`, and the rigid matrix of its place; None if no size.

    The given matrix (4, 4) leads into the frame of its object. Shapes that it shears, or scales so
    that they are no longer what they were, become meshes.
    """
    found = _plain(prim)
    if found is None:
        return None
    shape, turn = found
    whole = matrix.copy()
    whole[:3, :3] = whole[:3, :3] @ turn
    scales = np.linalg.norm(whole[:3, :3], axis=0)
    if not np.isfinite(whole).all() or scales.min() <= 1e-9:
        return None
    axes = whole[:3, :3] / scales
    scaled = _scaled(shape, scales)
    if isinstance(shape, Mesh) or scaled is None or np.abs(axes.T @ axes - np.eye(3)).max() > SAME:
        return _tessellated(shape, prim.GetName()), whole
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] *= -1.0  # they are their own mirror images
    whole[:3, :3] = axes
    return scaled, whole


def _plain(prim: Any) -> tuple[Shape, Array] | None:
    """The shape along z, and the rotation to its own axis."""
    kind = prim.GetTypeName()
    if kind == "Cube":
        size = number(UsdGeom.Cube(prim).GetSizeAttr(), 2.0)
        return (Box((size, size, size)), np.eye(3)) if size > 0.0 else None
    if kind == "Sphere":
        radius = number(UsdGeom.Sphere(prim).GetRadiusAttr(), 1.0)
        return (Sphere(radius), np.eye(3)) if radius > 0.0 else None
    if kind == "Plane":
        plane = UsdGeom.Plane(prim)
        x = number(plane.GetWidthAttr(), 2.0) / 2.0
        y = number(plane.GetLengthAttr(), 2.0) / 2.0
        corners = [[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]
        triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
        mesh = Mesh(prim.GetName(), np.array(corners, dtype=float), triangles)
        return mesh, _axis(plane)
    if kind not in SHAPES:
        return None
    solid = getattr(UsdGeom, kind)(prim)
    radius = number(solid.GetRadiusAttr(), 1.0 if kind != "Capsule" else 0.5)
    height = number(solid.GetHeightAttr(), 2.0 if kind != "Capsule" else 1.0)
    if radius <= 0.0 or height <= 0.0:
        return None
    if kind == "Cone":
        half = height / 2.0
        profile = [(0.0, -half), (radius, -half), (0.0, half)]
        return lathe(prim.GetName(), profile, AROUND), _axis(solid)
    shape = Cylinder(radius, height) if kind == "Cylinder" else Capsule(radius, height)
    return shape, _axis(solid)


def _axis(solid: Any) -> Array:
    """Rotation from z to the axis of a shape."""
    match solid.GetAxisAttr().Get(NOW):
        case "X":
            return np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
        case "Y":
            return np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return np.eye(3)


def _scaled(shape: Shape, scales: Array) -> Shape | None:
    """The shape with scales along its axes, if there is one of its kind."""
    x, y, z = scales.tolist()
    level = abs(x - y) <= SAME * x
    match shape:
        case Box(size=(a, b, c)):
            return Box((a * x, b * y, c * z))
        case Sphere() if level and abs(x - z) <= SAME * x:
            return Sphere(shape.radius * x)
        case Cylinder() if level:
            return Cylinder(shape.radius * x, shape.length * z)
        case Capsule() if level and abs(x - z) <= SAME * x:
            return replace(shape, radius=shape.radius * x, length=shape.length * x)
    return None


def _tessellated(shape: Shape, name: str) -> Mesh:
    match shape:
        case Mesh():
            return shape
        case Box(size=size):
            corner = np.sqrt(0.5)
            profile = [(0.0, -0.5), (corner, -0.5), (corner, 0.5), (0.0, 0.5)]
            unit = lathe(name, profile, 4, np.pi / 4.0)
            return replace(unit, vertices=unit.vertices * np.array(size))
        case Sphere(radius=radius):
            return lathe(name, half_circle(radius, AROUND), AROUND)
        case Capsule(radius=radius, length=length):
            ball, half = half_circle(radius, AROUND), length / 2.0
            low, high = ball[: AROUND // 4 + 1], ball[AROUND // 4 :]
            profile = [(r, z - half) for r, z in low] + [(r, z + half) for r, z in high]
            return lathe(name, profile, AROUND)
        case Cylinder(radius=r, length=length):
            half = length / 2.0
            return lathe(name, [(0.0, -half), (r, -half), (r, half), (0.0, half)], AROUND)
    raise TypeError(shape)
