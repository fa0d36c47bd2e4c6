"""Static meshes and the collision hulls that artists gave them (worlds reference 5.2).

Only meshes as the editor saves them hold the triangles read here; those in cooked packages do not.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.geometry import CORNERS
from usarsim_maps.scene import Array, Mesh
from usarsim_maps.units import unreal_points
from usarsim_maps.unreal.archive import Archive, PackageError
from usarsim_maps.unreal.package import Export, Package
from usarsim_maps.unreal.properties import Properties, read_object

BYTE_TREE = 770
SOURCE_LOD, SETTINGS, PROXY = 823, 829, 859
"""File versions since which: the collision tree is quantised; the mesh may keep its original;
simplification settings are records of seven bytes; a word tells whether it stands for others."""

TRIANGLES = {
    size: np.dtype(
        {
            "names": ["points", "uvs", "material"],
            "formats": [("<f4", (3, 3)), ("<f4", (3, 8, 2)), "<i4"],
            "offsets": [0, 36, 240],
            "itemsize": size,
        }
    )
    for size in (368, 372)
}
"""Raw triangles by size: positions, texture coordinates, colours, material, then what is of no
use here. The word that makes the difference, explicit normals, is the last one."""

STORED_ELSEWHERE, UNUSED, PACKED = 0x01, 0x20, 0x02 | 0x10 | 0x80
"""Flags of bulk data."""

FARTHEST = 1e7
MAX_HULLS = 2_000
ROUND = 12
"""Corners around balls and capsules."""


def read_mesh(package: Package, export: Export, name: str, scale: float) -> Mesh:
    """A static mesh; `PackageError` if it cannot be read, or has no triangles.

    The name is for the result, the scale is in Unreal units per metre.
    """
    properties, archive = read_object(package, export)
    archive.skip(28)  # bounds
    body = package.export(archive.i32())
    if package.version >= BYTE_TREE:
        archive.skip(24)
        archive.bulk(6, "tree nodes")
    else:
        archive.bulk(32, "tree nodes")
    archive.bulk(8, "tree triangles")
    archive.skip(4)  # version of the mesh
    if package.version >= SOURCE_LOD:
        if archive.i32() != 0:
            raise PackageError("the mesh was simplified and keeps its original", archive.offset)
        item = 7 if package.version >= SETTINGS else 4
        archive.skip(item * archive.count(item, "settings"))
        archive.skip(4)
    if package.version >= PROXY:
        archive.skip(4)
    if archive.count(16, "levels of detail") < 1:
        raise PackageError("the mesh has no levels of detail", archive.offset)
    triangles = _raw_triangles(archive)
    hulls = [] if body is None else list(_hulls(package, body))
    points = triangles["points"].astype(float).reshape(-1, 3)
    if not (np.abs(points) < FARTHEST).all():
        raise PackageError("corners without meaning", archive.offset)
    slots = np.clip(triangles["material"].astype(np.int64), 0, 255)
    # The triangles' order is the reverse of that of brushes: cross products point inwards in
    # Unreal's frame, and outwards once its y axis is turned round (worlds reference 4.4).
    uvs = triangles["uvs"][:, :, 0].astype(float) * [1.0, -1.0] + [0.0, 1.0]
    unique, corners = np.unique(points, axis=0, return_inverse=True)
    return Mesh(
        name=name,
        vertices=unreal_points(unique, scale),
        triangles=corners.reshape(-1, 3).astype(np.int32),
        uvs=uvs if np.isfinite(uvs).all() else None,
        slots=slots.astype(np.int32),
        materials=_materials(package, archive, properties, int(slots.max(initial=0)) + 1),
        hulls=tuple(unreal_points(hull, scale) for hull in hulls),
    )


def _raw_triangles(archive: Archive) -> NDArray[np.void]:
    """The triangles that the mesh was made from; the cursor stands behind them then."""
    start = archive.offset
    flags, count, size, place = archive.i32s(4)
    if flags & PACKED:
        raise PackageError("compressed triangles", start)
    if flags & (STORED_ELSEWHERE | UNUSED) or count <= 0:
        raise PackageError("the mesh does not hold its triangles (cooked?)", start)
    if place != archive.offset or size % count or size // count not in TRIANGLES:
        raise PackageError(f"{count} triangles in {size} bytes at {place}", start)
    begin = archive.offset
    archive.skip(size)
    return archive.table(begin, count, TRIANGLES[size // count])


def _materials(
    package: Package, archive: Archive, properties: Properties, slots: int
) -> tuple[str, ...]:
    """Paths of materials by slot, from the sections behind the triangles, or the properties."""
    try:
        names = dict(_sections(package, archive))
    except PackageError:
        names = {}
    if not names:
        names = dict(_lod_info(package, properties))
    return tuple(names.get(slot, "") for slot in range(slots))


def _sections(package: Package, archive: Archive) -> Iterator[tuple[int, str]]:
    """Slot and material of the sections of the first level of detail."""
    for number in range(archive.count(41, "sections")):
        start = archive.offset
        material = archive.i32()
        archive.skip(7 * 4)
        slot = archive.i32()
        archive.skip(8 * archive.count(8, "fragments"))
        if archive.u8() != 0 or not 0 <= slot < 256:
            raise PackageError("a section for a console", start)
        if material and "material" not in package.class_name(material).lower():
            raise PackageError("a section whose material is none", start)
        yield slot if slot else number, package.path(material)


def _lod_info(package: Package, properties: Properties) -> Iterator[tuple[int, str]]:
    try:
        for level in itertools.islice(properties.structures("lodinfo"), 1):
            for number, element in enumerate(level.structures("elements")):
                yield number, package.path(element.reference("material"))
    except PackageError:
        return


# ---- collision hulls -----------------------------------------------------------------------


def _hulls(package: Package, body: Export) -> Iterator[Array]:
    """Convex pieces of a body setup, each (k, 3) points in Unreal units."""
    setup, _ = read_object(package, body)
    shapes = setup.structure("agggeom")
    if shapes is None:
        return
    pieces = itertools.chain(
        (_convex(item) for item in shapes.structures("convexelems")),
        (_box(item) for item in shapes.structures("boxelems")),
        (_ball(item, 0.0) for item in shapes.structures("sphereelems")),
        (_ball(item, item.number("length", 1.0)) for item in shapes.structures("sphylelems")),
    )
    for points in itertools.islice(pieces, MAX_HULLS):
        if len(points) >= 4 and (np.abs(points) < FARTHEST).all():
            yield points


def _convex(item: Properties) -> Array:
    archive = item.raw("vertexdata")
    if archive is None:
        return np.zeros((0, 3))
    return archive.floats(archive.count(12, "corners of a hull"), 3)


def _box(item: Properties) -> Array:
    half = np.array([item.number(axis, 1.0) for axis in ("x", "y", "z")]) / 2.0
    return _placed(item, CORNERS * half)


def _ball(item: Properties, length: float) -> Array:
    """A ball, or a capsule along z."""
    radius = item.number("radius", 1.0)
    around = np.arange(ROUND) * 2.0 * np.pi / ROUND
    rings = [np.array([[0.0, 0.0, 1.0]])]
    for angle in (np.pi / 6.0, np.pi / 3.0, np.pi / 2.0):
        ring = np.column_stack([np.cos(around), np.sin(around)]) * np.sin(angle)
        rings.append(np.column_stack([ring, np.full(ROUND, np.cos(angle))]))
    upper = np.concatenate(rings) * radius
    lower = upper * [1.0, 1.0, -1.0]
    middle = np.array([0.0, 0.0, length / 2.0])
    return _placed(item, np.concatenate([upper + middle, lower - middle]))


def _placed(item: Properties, points: Array) -> Array:
    """Apply the matrix `TM`: rows are the axes and the place, each stored as W, X, Y, Z."""
    archive = item.raw("tm")
    if archive is None or archive.left < 64:
        return points
    rows = archive.floats(4, 4)[:, 1:]
    return np.asarray(points @ rows[:3] + rows[3])
