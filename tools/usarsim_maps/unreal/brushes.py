"""Polygons of brushes, and the tree of convex parts that the editor has built from them.

Layouts: worlds reference 5.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.unreal.archive import Archive, PackageError
from usarsim_maps.unreal.package import Export, Package
from usarsim_maps.unreal.properties import read_object

Array = NDArray[np.float64]

FARTHEST = 1e7
"""UU: coordinates beyond this are nonsense (the engine's world ends at 262 144)."""

MAX_CORNERS = 1_000

NODE = np.dtype(
    [
        ("plane", "<f4", 4),
        ("pool", "<i4"),
        ("surface", "<i4"),
        ("vertex", "<i4"),
        ("component", "<u2", 2),
        ("element", "<i4"),
        ("children", "<i4", 3),
        ("bound", "<i4"),
        ("zones", "u1", 2),
        ("corners", "u1"),
        ("flags", "u1"),
        ("leaves", "<i4", 2),
    ]
)
BACK, FRONT = 0, 1
NOT_CSG = 0x01
"""Flag of nodes that separate nothing from nothing."""

SURFACE = 60
"""Bytes of one surface."""


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A polygon of a brush, in its own frame and in Unreal units.

    Attributes:
        points: (n, 3); their cross products point outwards.
        base: origin of the texture. u, v: its axes.
        flags: of the polygon. material: object index.
    """

    points: Array
    base: Array
    u: Array
    v: Array
    flags: int
    material: int


def faces_of_model(package: Package, model: Export) -> tuple[list[Face], int]:
    """Polygons of a brush's model, and how many senseless ones were left out.

    Raises:
        PackageError: the model or its polygons cannot be read.
    """
    polys = package.export(_Model(package, model).polys)
    if polys is None or package.class_of(polys) != "Polys":
        raise PackageError("a model without polygons", model.offset)
    package.spend(polys.size)
    archive = read_object(package, polys)[1]
    count, _, _ = archive.i32s(3)
    if count < 0 or count * 100 > archive.left:
        raise PackageError(f"{count} polygons in {archive.left} bytes", archive.offset)
    found = [_face(package, archive) for _ in range(count)]
    faces = [face for face in found if face is not None]
    return faces, count - len(faces)


def _face(package: Package, archive: Archive) -> Face | None:
    base, _, u, v = archive.floats(4, 3)
    corners = archive.count(12, "corners")
    points = archive.floats(corners, 3)
    flags = archive.u32()
    archive.skip(4)  # actor
    package.name(archive)  # item
    material = archive.i32()
    archive.skip(4 + 4 + 4 + 4 + 36)  # links, shadow map scale, channels, lighting
    package.name(archive)  # rule set
    if not 3 <= corners <= MAX_CORNERS or not (np.abs(points) < FARTHEST).all():
        return None
    return Face(points, base, u, v, flags, material)


class _Model:
    """The parts of a model that are of use.

    Attributes:
        polys: object index of its polygons.
        nodes: of the tree. outside: what is beyond all planes is empty.
    """

    def __init__(self, package: Package, model: Export) -> None:
        package.spend(model.size)
        archive = read_object(package, model)[1]
        archive.skip(28)  # bounds
        archive.bulk(12, "vectors")
        archive.bulk(12, "points")
        begin, count = archive.bulk(NODE.itemsize, "nodes")
        self.nodes = archive.table(begin, count, NODE)
        archive.skip(4)  # owner
        archive.skip(SURFACE * archive.count(SURFACE, "surfaces"))
        archive.bulk(24, "vertices")
        archive.skip(4)  # shared sides
        archive.skip(24 * archive.count(24, "zones"))
        self.polys = archive.i32()
        archive.bulk(4, "hulls of leaves")
        archive.bulk(4, "leaves")
        self.outside = archive.i32() != 0


@dataclass(frozen=True, slots=True, eq=False)
class BuiltLevel:
    """What the editor made of the brushes when the level was built last.

    Attributes:
        nodes: the tree.
        outside: space is empty before the first brush.
    """

    nodes: NDArray[np.void]
    outside: bool

    def solid(self, points: Sequence[Sequence[float]] | Array) -> NDArray[np.bool_]:
        """Whether points (n, 3) in Unreal units are inside something solid."""
        places = np.asarray(points, dtype=float).reshape(-1, 3)
        planes = self.nodes["plane"].astype(float)
        children = self.nodes["children"]
        csg = (self.nodes["flags"] & NOT_CSG) == 0
        free = np.full(len(places), self.outside)
        here = np.full(len(places), 0 if len(self.nodes) else -1)
        # A tree is not deeper than it has nodes; a damaged one may run in circles.
        for _ in range(len(self.nodes)):
            moving = here >= 0
            if not moving.any():
                break
            node = here[moving]
            height = (planes[node, :3] * places[moving]).sum(axis=1) - planes[node, 3]
            front = height > 0.0
            free[moving] = np.where(csg[node], front, free[moving])
            following = np.where(front, children[node, FRONT], children[node, BACK])
            here[moving] = np.where(following < len(self.nodes), following, -1)
        return ~free


def read_built_level(package: Package, level: Export) -> BuiltLevel | None:
    """The level's tree; None if it has not been built.

    Raises:
        PackageError: it cannot be read.
    """
    best: _Model | None = None
    for export in package.inside(level):
        if package.class_of(export) == "Model":
            model = _Model(package, export)
            if len(model.nodes) and (best is None or len(model.nodes) > len(best.nodes)):
                best = model
    return None if best is None else BuiltLevel(best.nodes, best.outside)
