"""Polygons of brushes, and the tree of convex parts that the editor has built from them.

What cannot be read is a `PackageError`.

Layouts: worlds reference 5.2. `agreement` compares two independent ways to the same answer: the
order of the brushes with the winding number of each about a point, and the tree.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from usarsim_maps.scene import Array, Brush, BrushOperation, Mask, Solidity
from usarsim_maps.unreal.archive import Archive, PackageError
from usarsim_maps.unreal.package import Export, Package
from usarsim_maps.unreal.properties import read_object

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

POINTS = 600
"""Points that are looked at in a whole level."""

MAX_BRUSHES = 2_000
"""Levels with more are not compared: it would take seconds."""


@dataclass(frozen=True, slots=True, eq=False)
class Face:
    """A polygon of a brush, in its own frame and in Unreal units."""

    points: Array  # (n, 3); their cross products point outwards
    base: Array  # origin of the texture, and its axes
    u: Array
    v: Array
    flags: int
    material: int  # object index


def faces_of_model(package: Package, model: Export) -> tuple[list[Face], int]:
    """Polygons of a brush's model, and how many senseless ones were left out."""
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
    """The parts of a model that are of use."""

    def __init__(self, package: Package, model: Export) -> None:
        package.spend(model.size)
        archive = read_object(package, model)[1]
        archive.skip(28)  # bounds
        archive.bulk(12, "vectors")
        archive.bulk(12, "points")
        begin, count = archive.bulk(NODE.itemsize, "nodes")
        self.nodes = archive.table(begin, count, NODE)  # of the tree
        archive.skip(4)  # owner
        archive.skip(SURFACE * archive.count(SURFACE, "surfaces"))
        archive.bulk(24, "vertices")
        archive.skip(4)  # shared sides
        archive.skip(24 * archive.count(24, "zones"))
        self.polys = archive.i32()  # object index of its polygons
        archive.bulk(4, "hulls of leaves")
        archive.bulk(4, "leaves")
        self.outside = archive.i32() != 0  # what is beyond all planes is empty


@dataclass(frozen=True, slots=True, eq=False)
class BuiltLevel:
    """What the editor made of the brushes when the level was built last."""

    nodes: NDArray[np.void]  # the tree
    outside: bool  # space is empty before the first brush

    def solid(self, points: Sequence[Sequence[float]] | Array) -> Mask:
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
    """The level's tree; None if it has not been built."""
    best: _Model | None = None
    for export in package.inside(level):
        if package.class_of(export) == "Model":
            model = _Model(package, export)
            if len(model.nodes) and (best is None or len(model.nodes) > len(best.nodes)):
                best = model
    return None if best is None else BuiltLevel(best.nodes, best.outside)


# ---- do the brushes give what the editor has built? ------------------------------------------


def agreement(brushes: Sequence[Brush], built: BuiltLevel, scale: float) -> tuple[int, int]:
    """How many points brushes and tree agree about, and how many were asked.

    The brushes of the level are in order and in metres, the tree is in Unreal units.
    """
    solids = [brush for brush in brushes if brush.solidity is not Solidity.NONSOLID]
    if not solids or len(solids) > MAX_BRUSHES:
        return 0, 0
    generator = np.random.default_rng(0)
    share = max(2, POINTS // len(solids))
    points = np.concatenate([_sample(brush, share, generator) for brush in solids])
    told = built.solid(points * [1.0, -1.0, 1.0] * scale)
    return int((told == _program(solids, points, not built.outside)).sum()), len(points)


def _sample(brush: Brush, count: int, generator: np.random.Generator) -> Array:
    """Points in and close to a brush."""
    corners = np.concatenate([polygon.vertices for polygon in brush.polygons])
    low, high = corners.min(axis=0), corners.max(axis=0)
    margin = 0.05 * (high - low)
    return generator.uniform(low - margin, high + margin, (count, 3))


def _program(brushes: Sequence[Brush], points: Array, filled: bool) -> Mask:
    """Carry out the brushes at some points; semisolid ones act last."""
    solid = np.full(len(points), filled)
    late = [brush for brush in brushes if brush.solidity is Solidity.SEMISOLID]
    early = [brush for brush in brushes if brush.solidity is Solidity.SOLID]
    for brush in (*early, *late):
        corners = np.concatenate([polygon.vertices for polygon in brush.polygons])
        low, high = corners.min(axis=0), corners.max(axis=0)
        near = np.flatnonzero(((points > low) & (points < high)).all(axis=1))
        if len(near):
            covered = near[inside(brush, points[near])]
            solid[covered] = brush.operation is BrushOperation.ADD
    return solid


def inside(brush: Brush, points: Array) -> Mask:
    """Whether points (n, 3) are in a brush: its faces wind about them.

    The sum of solid angles (van Oosterom and Strackee 1983) needs neither convex nor closed faces.
    """
    total = np.zeros(len(points))
    for polygon in brush.polygons:
        corners = polygon.vertices
        for k in range(1, len(corners) - 1):
            a, b, c = (corners[i] - points for i in (0, k, k + 1))
            la, lb, lc = (np.linalg.norm(v, axis=1) for v in (a, b, c))
            volume = (a * np.cross(b, c)).sum(axis=1)
            rest = la * lb * lc + (a * b).sum(axis=1) * lc
            rest += (b * c).sum(axis=1) * la + (c * a).sum(axis=1) * lb
            total += 2.0 * np.arctan2(volume, rest)
    return np.asarray(np.abs(total) > 2.0 * np.pi)
